"""Offline recognition against aligned transcripts of real sentences."""

import numpy as np
import pytest

from cospeech.errors import CospeechNotice
from cospeech.speech import load_audio, read_words, recognize_words, words_of_speech
from cospeech.speech.recognize import LONGEST

SENTENCES = ("LJ001-0001", "LJ001-0004")


@pytest.fixture(scope="module")
def sentences(recordings):
    """[(samples, rate, true `Words`)]."""
    folder = recordings / "speech" / "ljspeech"
    return [(*load_audio(folder / f"{name}.wav"), read_words(folder / f"{name}.TextGrid")) for name in SENTENCES]


def share_found(words, truth, late=0.0):
    """Of the true words, those that are among `words` with a start at most 0.2 s off."""
    heard = [(text, start) for text, start in zip(words.text, words.start, strict=True)]
    hits = [
        any(text == true.lower() and abs(start - late - at) <= 0.2 for text, start in heard)
        for true, at in zip(truth.text, truth.start, strict=True)
    ]
    return np.mean(hits)


def test_most_words_of_real_sentences_are_found_at_their_times_also_after_a_cut(sentences):
    """Longer than what is recognised at once, so that it is cut, in a pause."""
    (first, rate, one), (second, _, other) = sentences
    gap = np.zeros(3 * rate, np.float32)
    sound, late = np.concatenate([first, gap, second, gap]), (len(first) + len(gap)) / rate
    assert len(sound) / rate > LONGEST
    words = recognize_words(sound, rate)
    assert share_found(words, one) >= 0.6 and share_found(words, other, late) >= 0.6
    assert (np.diff(words.start) > 0).all() and (words.end > words.start).all()
    assert words.end[-1] <= len(sound) / rate and not any(set("<[(") & set(word) for word in words.text)


def test_silence_holds_no_words_and_says_so():
    with pytest.warns(CospeechNotice, match="no words"):
        words = recognize_words(np.zeros(16000, np.float32), 16000)
    assert len(words) == 0


def test_a_transcript_comes_first(tmp_path):
    (tmp_path / "talk.tsv").write_text("word\tstart\tend\nhello\t0.5\t0.9\n")
    (tmp_path / "other.tsv").write_text("word\tstart\tend\nworld\t0.5\t0.9\n")
    sound = np.zeros(16000, np.float32), 16000
    assert words_of_speech(tmp_path / "talk.wav", *sound, recognize=True).text == ["hello"]
    assert words_of_speech(tmp_path / "talk.wav", *sound, path=tmp_path / "other.tsv").text == ["world"]
    assert words_of_speech(tmp_path / "none.wav", *sound) is None
