"""Word times from every format, and a line that names the row for every mistake in one."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.speech import audio_duration, find_words, read_words

EXPECTED = (["so", "this", "is", "\u00bbfun\u00ab"], [0.1, 0.35, 0.6, 1.25], [0.35, 0.6, 0.7, 1.75])

TIER = """
        class = "IntervalTier"
        name = "{name}"
        xmin = 0
        xmax = 2
        intervals: size = {size}
"""
HEAD = 'File type = "ooTextFile"\nObject class = "TextGrid"\n\n'
HEAD += "xmin = 0\nxmax = 2\ntiers? <exists>\nsize = {size}\nitem []:\n"


def intervals():
    """The words with the gaps between them, as a TextGrid holds them."""
    rows = list(zip(EXPECTED[1], EXPECTED[2], EXPECTED[0], strict=True))
    return [(0, 0.1, ""), *rows[:3], (0.7, 1.25, "sil"), rows[3], (1.75, 2, "<eps>")]


def long_textgrid(name="words"):
    """A tier of phones, one of points, then the words."""
    phones = (
        TIER.format(name="phones", size=1) + '        intervals [1]:\n  xmin = 0\n  xmax = 2\n  text = "1.5 ""a"""\n'
    )
    points = '        class = "TextTier"\n name = "beats"\n xmin = 0\n xmax = 2\n points: size = 1\n'
    points += ' points [1]:\n number = 0.5\n mark = "x"\n'
    words = TIER.format(name=name, size=len(intervals()))
    for i, (start, end, text) in enumerate(intervals(), 1):
        words += f'        intervals [{i}]:\n  xmin = {start}\n  xmax = {end}\n  text = "{text}" \n'
    return HEAD.format(size=3) + f"    item [1]:{phones}    item [2]:\n{points}    item [3]:{words}"


def short_textgrid():
    rows = "\n".join(f'{start}\n{end}\n"{text}"' for start, end, text in intervals())
    head = 'File type = "ooTextFile short"\n"TextGrid"\n\n0\n2\n<exists>\n1\n'
    return head + f'"IntervalTier"\n"Word"\n0\n2\n{len(intervals())}\n{rows}\n'


def tsv(order=("word", "start", "end"), header=False):
    words, starts, ends = EXPECTED
    cells = {"word": words, "start": starts, "end": ends}
    rows = [order] if header else []
    rows += [tuple(str(cells[name][i]) for name in order) for i in range(len(words))]
    return "\n".join("\t".join(row) for row in rows) + "\n"


def json_words(word_key="word", **extra):
    return [{word_key: w, "start": s, "end": e} | extra for w, s, e in zip(*EXPECTED, strict=True)]


def write_all(folder):
    """One file per format and dialect, all of the same words."""
    missed = {"word": "gone", "case": "not-found-in-audio"}
    whisper = [{"text": "so this", "words": json_words()[:2]}, {"text": "is fun", "words": json_words()[2:]}]
    ctm = "".join(f"talk 1 {s} {round(e - s, 6)} {w} 0.98\n" for w, s, e in zip(*EXPECTED, strict=True))
    texts = {
        "plain.tsv": tsv(),
        "header.tsv": tsv(("start", "end", "word"), header=True),
        "windows.tsv": "\ufeff" + tsv(header=True).replace("\n", "\r\n") + "\r\n",
        "long.TextGrid": long_textgrid(),
        "first.TextGrid": HEAD.format(size=1) + long_textgrid(name="Silben").split("item [3]:")[1],
        "short.textgrid": short_textgrid(),
        "a.ctm": f";; made by\n{ctm}",
        "list.json": json.dumps(json_words("text")),
        "whisper.json": json.dumps({"segments": whisper}),
        "gentle.json": json.dumps({"transcript": "...", "words": [*json_words(case="success"), missed]}),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="")
    for encoding in ("utf-16", "utf-16-le", "utf-16-be"):
        (folder / f"{encoding}.TextGrid").write_text(long_textgrid(), encoding=encoding)
    return sorted(folder.iterdir())


@pytest.mark.filterwarnings("ignore:.*1 words have no times", "ignore:.*tier 'words' is read, of")
def test_every_format_gives_the_same_words(tmp_path):
    paths = write_all(tmp_path)
    assert len(paths) == 13
    for path in paths:
        words = read_words(path)
        assert words.text == EXPECTED[0], path
        assert np.allclose([words.start, words.end], EXPECTED[1:], atol=1e-9), path
        assert words.start.dtype == words.end.dtype == np.float64


@settings(max_examples=30, deadline=None)
@given(st.lists(st.text(st.characters(codec="utf-8", exclude_characters='"'), min_size=1), max_size=9))
def test_a_textgrid_survives_any_label(tmp_path_factory, texts):
    """Labels that look like numbers, flags or whole lines of the format are labels still; doubled quotes are one."""
    path = tmp_path_factory.getbasetemp() / "labels.TextGrid"
    rows = "".join(f'{i}\n{i + 1}\n"-{text} """\n' for i, text in enumerate(texts))
    tier = f'"IntervalTier"\n"words"\n0\n9\n{len(texts) + 1}\n{rows}9\n10\n"end"\n'
    path.write_bytes(f'File type = "ooTextFile"\nObject class = "TextGrid"\n\n0\n9\n<exists>\n1\n{tier}'.encode())
    assert read_words(path).text == [*(f'-{text} "' for text in texts), "end"]


MISTAKES = {  # rows of a TSV -> what the line must say
    "so\t0.1\t0.2\nthis\tx\t0.4": r"line 2: start is 'x', expected seconds as a number",
    "so\t0.1\t0.2\nthis\t0,3\t0,4": r"line 2: start is '0,3'.*decimal point",
    "so\t0.1\tnan": r"line 1: end is 'nan'",
    "so\t-0.1\t0.2": r"line 1 \('so'\): from -0.1 s to 0.2 s; expected 0 <= start <= end",
    "so\t0.3\t0.2": r"line 1 \('so'\): from 0.3 s to 0.2 s",
    "word\tstart\tend\nso\t0.5\t0.6\n\nthis\t0.1\t0.2": r"line 4 \('this'\): starts at 0.1 s, before the word above",
    "so\t0.1\t0.5\nthis\t0.4\t0.6": r"line 2 \('this'\): starts at 0.4 s, but the word above ends at 0.5 s",
    "so\t0.1": r"line 1: 2 columns, expected word, start, end between tabs",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_mistakes_name_file_and_row(tmp_path, text):
    (tmp_path / "a.tsv").write_text(text)
    with pytest.raises(CospeechError, match=rf"a\.tsv: {MISTAKES[text]}") as caught:
        read_words(tmp_path / "a.tsv")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("a.TextGrid", "hello", "incomplete or damaged"),
        ("a.TextGrid", 'File type = "ooTextFile"\nObject class = "Pitch 1"\n', "does not begin as a Praat TextGrid"),
        ("a.TextGrid", long_textgrid()[:-40], "incomplete or damaged"),
        ("a.TextGrid", HEAD.format(size=0), "no interval tier"),
        ("a.TextGrid", long_textgrid().replace("xmin = 1.25", "xmin = 1.9"), r"tier 'words', interval 6 .*from 1.9 s"),
        ("a.ctm", "talk 1 0.5 so", "line 1: 4 columns"),
        ("a.ctm", "talk 1 0.5 long so", "line 1: duration is 'long'"),
        ("a.json", "{", "not valid JSON"),
        ("a.json", '{"title": "talk"}', "holds no words"),
        ("a.json", "[1]", "word 1: expected an object"),
        ("a.json", '[{"word": "so", "start": 0.1, "end": null}]', "word 1: end is None"),
        ("a.srt", "1", r"not \.srt"),
    ],
)
def test_damaged_files_get_one_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(CospeechError, match=words) as caught:
        read_words(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name)) and "\n" not in str(caught.value)


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(CospeechError, match="no such file"):
        read_words(tmp_path / "a.tsv")
    (tmp_path / "a.tsv").write_bytes(b"so\xff\xfe\x00\t1")
    with pytest.raises(CospeechError, match="not text"):
        read_words(tmp_path / "a.tsv")


def test_small_overlaps_are_cut_with_a_notice(tmp_path):
    (tmp_path / "a.tsv").write_text("so\t0.1\t0.33\nthis\t0.3\t0.4\nis\t0.4\t0.4\n")
    with pytest.warns(CospeechNotice, match="1 words overlapped"):
        words = read_words(tmp_path / "a.tsv")
    assert words.end.tolist() == [0.3, 0.4, 0.4]


def test_a_file_without_words_is_noticed(tmp_path):
    (tmp_path / "a.tsv").write_text("word\tstart\tend\n")
    with pytest.warns(CospeechNotice, match="holds no words"):
        assert len(read_words(tmp_path / "a.tsv")) == 0


def test_words_beside_the_audio(tmp_path):
    audio = tmp_path / "talk.one.wav"
    assert find_words(audio) is None and find_words(tmp_path / "nowhere" / "a.wav") is None
    (tmp_path / "talk.tsv").write_text("other\t0\t1\n")
    (tmp_path / "talk.one.TextGrid").write_text(long_textgrid())
    assert find_words(audio).text == EXPECTED[0]
    (tmp_path / "talk.one.tsv").write_text("mine\t0\t1\n")
    with pytest.warns(CospeechNotice, match=r"2 files .* talk\.one\.tsv is used"):
        assert find_words(audio).text == ["mine"]


def test_real_textgrids(recordings):
    for audio in sorted(recordings.glob("speech/ljspeech/*.wav")):
        words = find_words(audio)
        assert 10 < len(words) < 40 and "sp" not in words.text
        assert words.end[-1] <= audio_duration(audio) + 1e-6
    assert find_words(recordings / "speech/ljspeech/LJ001-0001.wav").text[:4] == ["printing", "in", "the", "only"]
    assert find_words(recordings / "speech/jfk/jfk.flac") is None
