"""Transcripts as recognisers, aligners and corpora ship them: one sentence, whose times are known, in each of them."""

import json
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.speech import find_words, read_words, words_of_speech, write_wav

TEXT = ["so", "the", "fish", "was", "huge"]
START, END = [0.2, 0.42, 0.52, 1.02, 1.25], [0.38, 0.5, 0.95, 1.2, 1.8]
ROWS = list(zip(TEXT, START, END, strict=True))
PLAIN = [{"word": w, "start": s, "end": e} for w, s, e in ROWS]
LATER = [{"word": "other", "start": s + 0.01, "end": e} for _, s, e in ROWS]


def ticks(seconds):
    return round(seconds * 1e7)


def google(**more):
    return [{"word": w, "startTime": f"{s:.3f}s", "endTime": f"{e:.3f}s"} | more for w, s, e in ROWS]


def azure(words):
    return {"nBest": [{"words": words}, {"words": [words[0]]}], "channel": 0}


TICKS = [{"Word": w, "Offset": ticks(s), "Duration": ticks(e - s)} for w, s, e in ROWS]
ISO = [{"word": w, "offset": f"PT{s}S", "duration": f"PT{e - s:.3f}S"} for w, s, e in ROWS]
AWS = [
    {"start_time": str(s), "end_time": str(e), "type": "pronunciation", "alternatives": [{"content": w}]}
    for w, s, e in ROWS
]
AWS.append({"type": "punctuation", "alternatives": [{"content": "."}]})
CPP = [{"text": f" {w}", "offsets": {"from": round(s * 1000), "to": round(e * 1000)}} for w, s, e in ROWS]
SECONDS = [
    {
        "word": w,
        "startTime": {"seconds": int(s), "nanos": round(s % 1 * 1e9)},
        "endTime": {"seconds": str(int(e)), "nanos": round(e % 1 * 1e9)},
    }
    for w, s, e in ROWS
]
DOCUMENTS = {
    "Whisper": {
        "text": "",
        "segments": [
            {"start": 0, "end": 1, "text": "so the", "words": PLAIN[:2]},
            {"start": 1, "end": 1, "text": "[Music]"},
            {"words": PLAIN[2:]},
        ],
    },
    "WhisperX": {"segments": [{"words": PLAIN}], "word_segments": PLAIN},
    "whisper.cpp, a word a segment": {"transcription": CPP},
    "whisper.cpp, tokens": {
        "transcription": [
            {
                "text": " so the fish was huge",
                "offsets": {},
                "tokens": [
                    {"text": "[_BEG_]", "offsets": {"from": 0, "to": 0}},
                    *CPP[:4],
                    {"text": " hu", "offsets": {"from": 1250, "to": 1500}},
                    {"text": "ge", "offsets": {"from": 1500, "to": 1800}},
                ],
            }
        ]
    },
    "Vosk": {"result": [{"conf": 1.0} | word for word in PLAIN], "text": "so the"},
    "Vosk, many": [{"result": PLAIN[:2]}, {"text": ""}, {"result": PLAIN[2:]}],
    "Google": {
        "results": [
            {"alternatives": [{"words": google()[:3]}, {"words": google()}]},
            {"alternatives": [{"words": google()[3:]}]},
        ]
    },
    "Google, speakers": {
        "results": [{"alternatives": [{"words": google()}]}, {"alternatives": [{"words": google(speakerTag=1)}]}]
    },
    "Google, an operation": {"done": True, "response": {"results": [{"alternatives": [{"words": SECONDS}]}]}},
    "Google, version 2": {
        "results": [
            {
                "alternatives": [
                    {"words": [{"word": w, "startOffset": f"{s}s", "endOffset": f"{e}s"} for w, s, e in ROWS]}
                ]
            }
        ]
    },
    "Google, a list": google(),
    "AWS": {"jobName": "talk", "results": {"transcripts": [{}], "items": AWS}},
    "Azure": {"RecognitionStatus": "Success", "NBest": [{"Words": TICKS}]},
    "Azure, many": [{"NBest": [{"Words": TICKS[:2]}]}, {"NBest": [{"Words": TICKS[2:]}]}],
    "Azure, batch": {"recognizedPhrases": [azure(ISO[:2]), azure(ISO[2:])]},
    "Azure, fast": {
        "phrases": [
            {
                "text": "",
                "words": [
                    {"text": w, "offsetMilliseconds": round(s * 1000), "durationMilliseconds": round((e - s) * 1000)}
                    for w, s, e in ROWS
                ],
            }
        ]
    },
    "Deepgram": {
        "results": {
            "channels": [{"alternatives": [{"transcript": "", "words": PLAIN}]}],
            "utterances": [{"words": PLAIN}],
        }
    },
    "AssemblyAI": {
        "audio_duration": 4,
        "words": [{"text": w, "start": round(s * 1000), "end": round(e * 1000)} for w, s, e in ROWS],
    },
    "Rev": {
        "monologues": [
            {
                "elements": [
                    *({"type": "text", "value": w, "ts": s, "end_ts": e} for w, s, e in ROWS),
                    {"type": "punct", "value": "."},
                ]
            }
        ]
    },
    "gentle": {"words": [{"startOffset": 0, "endOffset": 2, "case": "success"} | word for word in PLAIN]},
    "MFA": {"tiers": {"phones": {"entries": [[0.2, 0.3, "s"]]}, "words": {"entries": [[s, e, w] for w, s, e in ROWS]}}},
}


def grid(*tiers, comment=""):
    """A long TextGrid of (name, [(label, start, end)]) tiers."""
    head = f'File type = "ooTextFile"\nObject class = "TextGrid"\n\nxmin = 0\nxmax = 4 {comment}\ntiers? <exists>\n'
    text = head + f"size = {len(tiers)}\nitem []:\n"
    for i, (name, rows) in enumerate(tiers, 1):
        text += (
            f'item [{i}]:\nclass = "IntervalTier"\nname = "{name}"\nxmin = 0\nxmax = 4\nintervals: size = {len(rows)}\n'
        )
        text += "".join(
            f'intervals [{j}]:\nxmin = {s}\nxmax = {e}\ntext = "{w}"\n' for j, (w, s, e) in enumerate(rows, 1)
        )
    return text


PHONES = [
    (part, s + i * (e - s) / len(w), s + (i + 1) * (e - s) / len(w)) for w, s, e in ROWS for i, part in enumerate(w)
]
SENTENCE = [("so the fish was huge", 0.2, 1.8)]
CHRONOLOGICAL = '"Praat chronological TextGrid text file"\n0 4 ! Time domain.\n2 ! Number of tiers.\n'
CHRONOLOGICAL += '"IntervalTier" "words" 0 4\n"TextTier" "beats" 0 4\n\n! words:\n'
CHRONOLOGICAL += "".join(f'1 {s} {e}\n"{w}"\n\n2 {s}\n"x"\n' for w, s, e in ROWS)
CTM = "".join(f"talk {{}} {s:.2f} {e - s:.2f} {w} 0.9\n" for w, s, e in ROWS)
OTHER = CTM.replace("talk", "lecture_b").replace("fish", "bird")
BOTH = zip(
    CTM.format(*"AAAAA").splitlines(True),
    OTHER.replace("lecture_b", "talk").format(*"BBBBB").splitlines(True),
    strict=True,
)
ALTERNATIVES = "talk 1 * * <ALT_BEGIN>\ntalk 1 * * <ALT>\ntalk 1 3 1 x\ntalk 1 * * <ALT_END>\n"
IN_MS = [(w, f"{s * 1000:.0f}", f"{e * 1000:.0f}") for w, s, e in ROWS]
CUES = (
    "WEBVTT\n\n00:00.200 --> 00:01.800 align:start position:0%\nso<00:00:00.420><c> the</c><00:00:00.520><c> fish</c>"
)
TEXTS = {
    "grid of phones first.TextGrid": grid(("MAU", PHONES), ("ORT-MAU", ROWS), ("KAN-MAU", ROWS[:1])),
    "grid of a speaker.TextGrid": grid(("ada - phones", PHONES), ("ada - words", ROWS)),
    "grid of sentences first.TextGrid": grid(("TRN", SENTENCE), ("words", ROWS)),
    "grid without names.TextGrid": grid(("a", PHONES), ("b", SENTENCE), ("c", ROWS)),
    "grid of comments.TextGrid": grid(("words", ROWS), comment='! was 3.9 and "trailing" 7'),
    "chronological.TextGrid": CHRONOLOGICAL,
    "talk.ctm": OTHER.format(*"11111") + CTM.format(*"11111"),
    "two channels.ctm": "".join(a + b for a, b in BOTH),
    "alternatives.ctm": CTM.format(*"11111") + ALTERNATIVES,
    "milliseconds.tsv": "word\tstart_ms\tend_ms\n" + "".join(f"{w}\t{s}\t{e}\n" for w, s, e in IN_MS),
    "audacity.tsv": "".join(f"{s}\t{e}\t{w}\n" for w, s, e in ROWS),
    "whisper, a word a row.tsv": "start\tend\ttext\n" + "".join(f"{s}\t{e}\t{w}\n" for w, s, e in IN_MS),
    "vosk.json": "".join(json.dumps({"result": [word]}, indent=1) + "\n" for word in PLAIN),
}
TEXTS |= {f"{name}.json": json.dumps(content) for name, content in DOCUMENTS.items()}


def read(path, **options):
    """(words, notices)."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        words = read_words(path, **options)
    return words, [str(one.message) for one in caught]


@pytest.mark.parametrize("name", TEXTS)
def test_every_transcript_gives_the_sentence(tmp_path, name):
    (tmp_path / name).write_text(TEXTS[name], encoding="utf-8")
    words, notices = read(tmp_path / name, recording="talk")
    assert words.text == TEXT and not any("no times" in line for line in notices)
    assert np.allclose([words.start, words.end], [START, END], atol=1e-6)


@pytest.mark.parametrize(
    "name, told",
    [
        ("grid of phones first.TextGrid", "tier 'ORT-MAU' is read, of 'MAU', 'ORT-MAU', 'KAN-MAU'"),
        ("talk.ctm", "recording 'talk' is read, of 2"),
        ("two channels.ctm", "channel 'A' is read, of A, B"),
        ("milliseconds.tsv", "milliseconds"),
    ],
)
def test_what_was_read_is_told(tmp_path, name, told):
    (tmp_path / name).write_text(TEXTS[name])
    assert any(told in line for line in read(tmp_path / name, recording="talk")[1])


def test_what_holds_no_words_of_this_recording_is_refused_by_what_it_holds(tmp_path):
    wrong = {
        "b.ctm": (OTHER.format(*"11111") + CTM.format(*"11111"), r"2 recordings \(lecture_b, talk\), none .* 'b'"),
        "phones.TextGrid": (grid(("phones", PHONES)), "no tier of words among 'phones'"),
        "sentences.TextGrid": (grid(("MAU", PHONES), ("TRN", SENTENCE)), "no tier of words among 'MAU', 'TRN'"),
        "time.json": (json.dumps({"words": [{"word": "so", "time": "0.2"}]}), "expected start and end, found time"),
        "big.json": (f'[{{"word": "so", "start": 1{"0" * 400}, "end": 2}}]', "expected seconds"),
        "deep.json": ("[" * 100000, "nested too deeply|not valid JSON"),
        "empty.vtt": ("WEBVTT\n", "not .vtt subtitles"),
    }
    for name, (text, told) in wrong.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(CospeechError, match=told) as caught:
            read_words(tmp_path / name)
        assert len(str(caught.value)) < 400


def test_a_word_without_an_end_is_left_out(tmp_path):
    for number, last in enumerate(({"word": "huge", "start": 1.25}, {"word": "huge", "start": 1.25, "end": None})):
        (tmp_path / f"{number}.json").write_text(json.dumps({"segments": [{"words": [*PLAIN[:4], last]}]}))
        words, notices = read(tmp_path / f"{number}.json")
        assert words.text == TEXT[:4] and any("1 words have no times" in line for line in notices)
    (tmp_path / "a.tsv").write_text("so\t0.2\t0.38\nthe\t0.42\t\n")
    assert read(tmp_path / "a.tsv")[0].text == ["so"]


def test_sentences_with_times_and_words_without_give_no_words(tmp_path):
    content = {"segments": [{"start": 0.2, "end": 1.8, "text": "so the fish"}], "language": "en"}
    (tmp_path / "a.json").write_text(json.dumps(content))
    words, notices = read(tmp_path / "a.json")
    assert len(words) == 0 and any("its words have none" in line for line in notices)


def test_subtitles_are_spread_and_say_so(tmp_path):
    srt = "1\n00:00:00,500 --> 00:00:02,500\n<i>so the</i> fish\n\n"
    srt += "2\n00:00:03,000 --> 00:00:04,000\n[Music]\n- was &amp; huge\n"
    for name, text in (
        ("a.srt", srt),
        ("a.vtt", "WEBVTT\n\nNOTE\nx\n\n" + srt.replace(",", ".")),
        ("dos.srt", srt.replace("\n", "\r\n")),
    ):
        (tmp_path / name).write_text(text, newline="")
        words, notices = read(tmp_path / name)
        assert words.text == ["so", "the", "fish", "was", "&", "huge"] and any(
            "not word times" in line for line in notices
        )
        assert words.start[0] == 0.5 and words.end[2] == pytest.approx(2.5) and words.start[3] == pytest.approx(3)
        assert np.diff([words.start, words.end], axis=0)[0][:3] == pytest.approx([4 / 9, 6 / 9, 8 / 9])


def test_subtitles_with_times_inside_or_one_word_underlined_are_word_times(tmp_path):
    (tmp_path / "a.vtt").write_text(CUES + "\n\n00:01.800 --> 00:02.000\nso the fish\n")
    words, notices = read(tmp_path / "a.vtt")
    assert (
        words.text == TEXT[:3] and words.start.tolist() == START[:3] and not any("not word" in line for line in notices)
    )
    (tmp_path / "b.srt").write_text(
        "".join(
            f"{i}\n00:00:0{s:.3f} --> 00:00:0{e:.3f}\n{' '.join(f'<u>{x}</u>' if x == w else x for x in TEXT)}\n\n"
            for i, (w, s, e) in enumerate(ROWS)
        )
    )
    words, _ = read(tmp_path / "b.srt")
    assert words.text == TEXT and np.allclose([words.start, words.end], [START, END])


def test_beside_a_sound_word_times_come_before_sentences(tmp_path):
    """Whisper writes both: a table of sentences in milliseconds, and a JSON that has words."""
    (tmp_path / "talk.tsv").write_text("start\tend\ttext\n200\t1800\tso the fish was huge\n2000\t2500\tand more\n")
    with pytest.warns(CospeechNotice, match="not word times"):
        words = find_words(tmp_path / "talk.wav", 4.0)
    assert len(words) == 7 and words.end[-1] == pytest.approx(2.5)
    (tmp_path / "talk.json").write_text(TEXTS["Whisper.json"])
    with pytest.warns(CospeechNotice, match="talk.json is used"):
        assert find_words(tmp_path / "talk.wav", 4.0).start.tolist() == START


@pytest.mark.parametrize(
    "name, text",
    [
        ("talk.json", json.dumps({"names": ["jawOpen"], "frames": [{"weights": [0.3], "time": 0.0}]})),
        ("talk.json", json.dumps([[0.1, 0.2], [0.3, 0.4]])),
        ("talk.json", '{"people": [], "version": 1.3'),
        ("talk.json", json.dumps({"words": 120, "title": "talk"})),
        ("talk.tsv", "time\tpitch\n0.0\t120\n"),
        ("talk.TextGrid", 'File type = "ooTextFile"\nObject class = "Pitch 1"\n'),
    ],
)
def test_something_else_beside_a_sound_costs_a_notice(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.warns(CospeechNotice, match=f"{name}.*passed over"):
        assert find_words(tmp_path / "talk.wav") is None


@pytest.mark.parametrize("unit", [100, 1000])
def test_words_beyond_the_sound_are_another_unit(tmp_path, unit):
    (tmp_path / "talk.json").write_text(
        json.dumps([{"text": w, "start": s * unit, "stop": e * unit} for w, s, e in ROWS])
    )
    sound = np.zeros(4 * 8000, np.float32)
    write_wav(tmp_path / "talk.wav", sound, 8000)
    for path in (None, tmp_path / "talk.json"):
        with pytest.raises(CospeechError, match=rf"talk\.json: the words end at {1.8 * unit:.2f} s.* lasts 4\.00 s"):
            words_of_speech(tmp_path / "talk.wav", sound, 8000, path)


def test_a_last_word_that_ends_a_little_late_is_cut(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(PLAIN))
    with pytest.warns(CospeechNotice, match="cut there"):
        assert read_words(tmp_path / "a.json", seconds=1.5).end[-1] == 1.5
    with pytest.raises(CospeechError, match="words end"):
        read_words(tmp_path / "a.json", seconds=1.1)  # the last begins after the end


def test_an_old_praat_file_is_latin_1_and_a_japanese_one_is_not(tmp_path):
    text = grid(("words", [("grün", 0, 1)]))
    (tmp_path / "a.TextGrid").write_text(text, encoding="latin-1")
    assert read(tmp_path / "a.TextGrid")[0].text == ["grün"]
    (tmp_path / "b.TextGrid").write_text(text.replace("grün", "表示"), encoding="shift-jis")
    with pytest.raises(CospeechError, match="not text in UTF-8"):
        read_words(tmp_path / "b.TextGrid")


SEEDS = {
    ".tsv": ["whisper, a word a row.tsv", "audacity.tsv"],
    ".textgrid": ["chronological.TextGrid", "grid of a speaker.TextGrid"],
    ".ctm": ["talk.ctm", "alternatives.ctm"],
    ".json": [f"{name}.json" for name in DOCUMENTS],
    ".vtt": [CUES],
    ".srt": ["1\n00:00:00,500 --> 00:00:02,500\nso the fish\n\n2\n00:00:03,000 --> 00:00:04,000\nwas\n"],
}
PIECES = [
    "null",
    "-1",
    "1e999",
    "NaN",
    "{",
    "[",
    '"',
    "\t",
    "\n",
    "\0",
    "é",
    "-->",
    "<exists>",
    "!",
    "9" * 30,
    "[]",
    "{}",
    ":",
]


@pytest.mark.parametrize("suffix", SEEDS)
def test_mutated_files_give_words_or_one_line(tmp_path, suffix):
    path = tmp_path / f"talk{suffix}"

    @settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    @given(st.data())
    def mutated(data):
        text = data.draw(st.sampled_from(SEEDS[suffix]))
        text = TEXTS.get(text, text)
        for _ in range(data.draw(st.integers(1, 4))):
            at, cut = data.draw(st.integers(0, len(text))), data.draw(st.integers(0, 12))
            text = text[:at] + data.draw(st.sampled_from(["", *PIECES])) + text[at + cut :]
        path.write_text(text, encoding="utf-8")
        try:
            words, _ = read(path, seconds=4.0)
            assert len(words.start) == len(words.end) == len(words.text)
        except CospeechError as error:
            assert "\n" not in str(error).replace(str(path), "") and len(str(error)) < 1000

    mutated()
