"""Words as numbers: vocabulary, alignment to frames, vectors from files, and what is wrong with transcripts."""

import json
from pathlib import Path

import numpy as np
import pytest

from cospeech.clip import Words
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.gestures.ha2g.dataset.embeddings import fnv, parts, read_embeddings
from cospeech.gestures.ha2g.dataset.vocabulary import SPECIAL, Vocabulary, check_words, plain, warn_of_other_transcript

HERE = Path(__file__).parent


def test_vocabulary_counts_plain_words():
    vocabulary = Vocabulary.of(["The", "cat,", "the", "«Dog»", "dog", "the", "it's", "--"])
    assert vocabulary.words == (*SPECIAL, "the", "dog", "cat", "it's")
    assert [vocabulary.number(word) for word in ("THE!", "bird")] == [4, 3]
    assert Vocabulary.of(["a", "b", "a"], least=2).words[4:] == ("a",)
    assert plain("“Don't…”") == "don't"


def test_a_word_stands_at_the_frame_in_which_it_begins():
    vocabulary = Vocabulary.of(["one", "two", "three"])
    words = Words(np.array([0.0, 0.5, 0.52, 5.0]), np.array([0.4, 0.51, 0.6, 5.1]), ["one", "two", "three", "one"])
    frames = vocabulary.frames(words, 30, 15.0)
    assert {int(i): vocabulary.words[frames[i]] for i in np.flatnonzero(frames)} == {0: "one", 7: "three"}
    # Every frame's own time falls in that frame, in spite of binary fractions.
    exact = Words(np.arange(300) / 15, np.arange(300) / 15, ["one"] * 300)
    assert (vocabulary.frames(exact, 300, 15.0) == vocabulary.number("one")).all()


def test_fasttext_binary_gives_what_fasttext_gives():
    """Against Facebook's own program (make_fasttext_tiny.py): known words, unknown ones, and beyond ASCII."""
    truth = json.loads((HERE / "fasttext_tiny.json").read_text())
    found = read_embeddings(HERE / "fasttext_tiny.bin", truth, 5)
    assert set(found) == set(truth) and {"straße", "xylophone"} <= set(truth)
    for word, vector in truth.items():
        np.testing.assert_allclose(found[word], vector, atol=1e-7)


def test_character_ngrams_of_the_publication():
    assert set(parts("where", 3, 3)) == {b"<wh", b"whe", b"her", b"ere", b"re>"}  # Bojanowski et al. 2017, section 3.2
    assert fnv(b"") == 0x811C9DC5 and fnv(b"foobar") == 0xBF9CF968  # published test vectors of FNV-1a


@pytest.mark.parametrize("head", ["3 4\n", ""], ids=["fastText", "GloVe"])
def test_text_files_are_read(tmp_path, head):
    file = tmp_path / "v.vec"
    file.write_text(head + "cat 1 2 3 4\nstraße 0.5 -1e-3 0 1\nthe 9 9 9 9\n", encoding="utf-8")
    found = read_embeddings(file, {"straße", "the", "dog"}, 4)
    np.testing.assert_allclose(found["straße"], [0.5, -0.001, 0, 1])
    assert set(found) == {"straße", "the"}


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"2 50\ncat 1 2\n", "vectors of 50 dimensions, the networks are made for 300"),
        (b"cat 1 2 3\n", "vectors of 3 dimensions"),
        ("1 300\ncat eins zwei\n".encode("utf-16"), "expected a word and 300 numbers"),
        (b"1 300\ncat one two\n", "line 2: expected numbers after the word"),
        (b"1 300\ncat 1 2\n", "line 2: not 300 finite numbers"),
        (b"\x1f\x8b\x08\x00", "is a gzip file; unpack it"),
        (b"PK\x03\x04", "is a zip file"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, content, line):
    file = tmp_path / "words.vec"
    file.write_bytes(content)
    with pytest.raises(CospeechError, match=line) as error:
        read_embeddings(file, {"cat"})
    assert str(error.value).startswith(str(file)) and "\n" not in str(error.value)


def test_a_truncated_binary_is_refused(tmp_path):
    whole = (HERE / "fasttext_tiny.bin").read_bytes()
    for size in (6, 60, 200, len(whole) - 1000):
        (tmp_path / "cut.bin").write_bytes(whole[:size])
        with pytest.raises(CospeechError, match="truncated or damaged"):
            read_embeddings(tmp_path / "cut.bin", {"the"}, 5)
    with pytest.raises(CospeechError, match="vectors of 5 dimensions"):
        read_embeddings(HERE / "fasttext_tiny.bin", {"the"})


def test_words_without_a_vector_start_at_random_and_are_counted():
    vocabulary = Vocabulary.of(["cat", "dog", "emu"])
    with pytest.warns(CospeechNotice, match="2 of 3 spoken words have none"):
        made = vocabulary.with_vectors({"dog": np.linspace(-2, 2, 300)}, seed=1)
    assert made.vectors.shape == (7, 300) and not made.vectors[0].any()
    np.testing.assert_allclose(made.vectors[made.number("dog")], np.linspace(-2, 2, 300), rtol=1e-6)
    assert 0.8 < made.vectors[made.number("cat")].std() / np.linspace(-2, 2, 300).std() < 1.2
    with pytest.raises(CospeechError, match="another language"):
        vocabulary.with_vectors({"kot": np.ones(300)})


@pytest.mark.parametrize(
    ("start", "end", "line"),
    [
        ([0.1, 9.0], [0.2, 9.6], "end at 9.60 s but the sound at 5.00 s"),
        ([2.0, 1.0], [2.1, 1.1], "sort them"),
        ([1.0, 2.0], [1.5, 1.9], "word 1 ends before it starts"),
    ],
)
def test_wrong_times_are_one_line(start, end, line):
    with pytest.raises(CospeechError, match=f"calm/take01: .*{line}"):
        check_words(Words(np.array(start), np.array(end), ["a", "b"]), 5.0, "calm/take01")


def spoken(words, seconds=20.0, rate=16000):
    """Noise as loud as speech within the words, and the hiss of a microphone elsewhere."""
    rng, time = np.random.default_rng(0), np.arange(round(seconds * rate)) / rate
    within = np.any([(time >= a) & (time < b) for a, b in zip(words.start, words.end, strict=True)], axis=0)
    return (rng.normal(size=len(time)) * np.where(within, 0.1, 0.0005)).astype(np.float32)


def test_another_files_transcript_is_noticed(recwarn):
    starts = np.cumsum(np.random.default_rng(1).uniform(0.3, 1.2, 25))
    own = Words(starts, starts + 0.25, ["la"] * 25)
    samples = spoken(own)
    warn_of_other_transcript(own, samples, 16000, "here")
    assert not recwarn.list
    others = np.cumsum(np.random.default_rng(2).uniform(0.3, 1.2, 25))
    with pytest.warns(CospeechNotice, match="here: .* is this the transcript of another file"):
        warn_of_other_transcript(Words(others, others + 0.25, ["la"] * 25), samples, 16000, "here")
