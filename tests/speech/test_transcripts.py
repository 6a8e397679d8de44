"""Transcripts as recognisers, aligners and corpora ship them: one sentence, whose times are known, in each of them."""

import json
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.speech import find_words, read_words, words_of_speech, write_wav
from tests.speech.sentence import (
    CTM,
    CUES,
    DOCUMENTS,
    END,
    OTHER,
    PHONES,
    PLAIN,
    ROWS,
    SENTENCE,
    START,
    TEXT,
    TEXTS,
    grid,
)


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
        "utterances.TextGrid": (grid(("ada", SENTENCE)), "no tier of words among 'ada'"),
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
