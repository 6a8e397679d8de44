"""Words as numbers: the vocabulary of the training part, its vectors, and words aligned to the frames of motion."""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cospeech.errors import CospeechError, notice

SPECIAL = ("<pad>", "<s>", "</s>", "<unknown>")  # numbers 0 to 3
UNKNOWN = 3
DIMENSIONS = 300  # of a word vector, in all three publications
LATE = 0.5  # seconds that a last word may outlast its sound: rounding of the aligner
FRAME = 160  # samples at 16 kHz in which voice is looked for
VOICED = 10 ** (-30 / 20)  # of the loud frames' level
CLEARER = 0.3  # by how much more of the words than of the gaps is voiced, in a transcript of the same sound


@dataclass
class Vocabulary:
    """words : tuple of `size` strings, the first four `SPECIAL`. vectors : (size, 300) float32, or None."""

    words: tuple
    vectors: np.ndarray | None = None

    @property
    def size(self):
        return len(self.words)

    @cached_property
    def index(self):
        """{word: its number}."""
        return {word: number for number, word in enumerate(self.words)}

    @classmethod
    def of(cls, texts, least=1):
        """Of an iterable of spoken words, those that occur at least `least` times, the most frequent first."""
        counts = Counter(word for text in texts if (word := plain(text)))
        ordered = sorted(counts, key=lambda word: (-counts[word], word))
        return cls((*SPECIAL, *(word for word in ordered if counts[word] >= least)))

    def number(self, text):
        """The number of a spoken word; `UNKNOWN` where it is none of these."""
        return self.index.get(plain(text), UNKNOWN)

    def frames(self, words, frames, fps):
        """Words aligned to frames: (T,) int64, a word's number at the frame in which it begins, else 0.

        Where two begin in one frame the later stands (as in the released code).
        """
        numbers = np.zeros(frames, np.int64)
        for start, text in zip(words.start, words.text, strict=True):
            if start * fps < frames:
                numbers[int(start * fps + 1e-6)] = self.number(text)
        return numbers

    def with_vectors(self, found, seed=0):
        """The same words with the vectors of {word: (300,)}; others are drawn at random with the same deviation."""
        known = [number for number, word in enumerate(self.words) if word in found]
        if not known:
            raise CospeechError("word vectors: none of the spoken words is in the file; is it of another language?")
        given = np.array([found[self.words[number]] for number in known], np.float32)
        vectors = np.random.default_rng(seed).normal(0, given.std(), (self.size, given.shape[1])).astype(np.float32)
        vectors[known], vectors[0] = given, 0
        missing = self.size - len(SPECIAL) - len(known)
        if missing:
            notice(f"word vectors: {missing} of {self.size - len(SPECIAL)} spoken words have none and start at random")
        return Vocabulary(self.words, vectors)


def plain(text):
    """A spoken word as a vocabulary has it: lower case, without punctuation around it."""
    return re.sub(r"^\W+|\W+$", "", text).lower()


def check_words(words, duration, where):
    """CospeechError unless word times ascend within `duration` seconds; `where` names the take."""
    start, end = np.asarray(words.start), np.asarray(words.end)
    if not len(words):
        return
    if (start < 0).any() or (end < start).any():
        raise CospeechError(f"{where}: word {int(np.argmax((start < 0) | (end < start)))} ends before it starts")
    if (np.diff(start) < 0).any():
        which = int(np.argmax(np.diff(start) < 0)) + 1
        raise CospeechError(f"{where}: word {which} ({words.text[which]!r}) starts before the one above it; sort them")
    if end[-1] > duration + LATE:
        raise CospeechError(
            f"{where}: its words end at {end[-1]:.2f} s but the sound at {duration:.2f} s; whose transcript is this?"
        )


def voiced_shares(words, samples, rate):
    """How much of the time within words is voiced, and of that between them: two shares, NaN where there is none.

    Voiced are frames of 10 ms within 30 dB of the loud ones.
    """
    size = max(1, round(FRAME * rate / 16000))
    count = len(samples) // size
    level = np.sqrt(np.mean(np.asarray(samples[: count * size], np.float32).reshape(count, size) ** 2, axis=1))
    voiced = level > VOICED * np.percentile(level, 95) if count else np.zeros(0, bool)
    times = (np.arange(count) + 0.5) * size / rate
    word = np.searchsorted(words.start, times, side="right") - 1
    spoken = (word >= 0) & (times < np.append(words.end, 0.0)[word])
    share = lambda mask: float(voiced[mask].mean()) if mask.any() else float("nan")
    return share(spoken), share(~spoken)


def warn_of_other_transcript(words, samples, rate, where):
    """A notice when the voice is as loud between the words as within them: the transcript of another file."""
    within, between = voiced_shares(words, samples, rate)
    if len(words) > 3 and within < between + CLEARER:
        notice(
            f"{where}: {within:.0%} of the time within its words is voiced and {between:.0%} between them; "
            "is this the transcript of another file?"
        )
