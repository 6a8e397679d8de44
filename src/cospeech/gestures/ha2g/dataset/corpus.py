"""The training material of HA2G and its baselines: windows of many speakers' takes, cut when they are asked for.

A window is 34 frames of motion at 15 Hz, the words that begin in them and the sound from the first frame on. What
overlaps is stored once: per take one array on each clock (frames, spectrogram columns, samples), one take behind the
other, and a window is where it begins on each.
"""

import json
from dataclasses import dataclass, field
from hashlib import sha256

import numpy as np

from cospeech.clip import put_strings
from cospeech.errors import CospeechError
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.gestures.ha2g.dataset.bones import Proportions
from cospeech.gestures.ha2g.dataset.levels import included_angles, level_table
from cospeech.gestures.ha2g.dataset.vocabulary import Vocabulary
from cospeech.speech.mel import COLUMNS, HOP, S2G_COLUMNS, S2G_HOP, column_at
from cospeech.speech.mfcc import RATE

SCHEMA = "cospeech.corpus"
FPS = 15.0
FRAMES, STRIDE, SEED_FRAMES = 34, 10, 4  # of a window, between the starts of two, and given at its beginning
SAMPLES = round(FRAMES / FPS * RATE)  # 36267
STARTS = 64  # beginnings of training windows that a model keeps to start from
KEYS = ("poses", "words", "mel", "wave", "s2g_mel", "speaker")
CLOCKS = {
    "vectors": "frame",
    "valid": "frame",
    "words": "frame",
    "mel": "column",
    "s2g_mel": "s2g_column",
    "wave": "sample",
}


@dataclass
class Corpus:
    """Windows of several speakers' takes.

    Attributes
    ----------
    levels : LevelTable. speakers : list of S names. vocabulary : Vocabulary of the training part.
    mean : (3V,) float32, of all valid frames' unit vectors. lengths : (V,) mean bone lengths of all, metres.
    figures : {speaker: Proportions}.
    takes : {"name": list of "<speaker>/<clip>", "speaker": (K,) numbers, "frame", "column", "s2g_column", "sample":
        (K,), where each take begins in the arrays of that clock}.
    window_take, window_frame : (N,) each window's take, and its first frame in that.
    arrays : {name: array}: vectors (F, V, 3) f4, valid (F,) bool, words (F,), mel (C, 128) f4, s2g_mel (C', 64) f4,
        wave (S,) i2. Those that are missing are read from `path` when first asked for.
    counts : {what: number} of takes and windows that were kept and dropped, see `filters`.
    references : {speaker: (K, side, side, 3) uint8 pictures}, or empty: the speakers are known by name alone.
    """

    levels: object
    speakers: list
    vocabulary: Vocabulary
    mean: np.ndarray
    lengths: np.ndarray
    figures: dict
    takes: dict
    window_take: np.ndarray
    window_frame: np.ndarray
    arrays: dict
    counts: dict = field(default_factory=dict)
    path: object = None
    references: dict = field(default_factory=dict)

    def __len__(self):
        return len(self.window_take)

    @property
    def speaker(self):
        """(N,) int64, who speaks in each window."""
        return self.takes["speaker"][self.window_take]

    @property
    def take(self):
        """(N,) int64, the take that each window is of."""
        return self.window_take

    @property
    def poses(self):
        """(N, 34, 3V) float32, all windows at once: `windows` for parts of them."""
        return self.windows(slice(None), ("poses",))["poses"]

    def sample(self, rng, batch, keys=KEYS):
        """`batch` random windows, drawn with replacement; see `windows`."""
        return self.windows(rng.integers(len(self), size=batch), keys)

    def windows(self, which, keys=KEYS):
        """Windows by number, {key: array} for the keys asked for.

        poses (n, 34, 3V) f4, unit vectors minus `mean`; words (n, 34) int64; mel (n, 128, 70) f4, dB; wave (n, 36267)
        f4, full scale 1; s2g_mel (n, 225, 64) f4, natural logarithm; speaker (n,) int64.
        """
        take, frame = self.window_take[which], self.window_frame[which]
        cuts = {"poses": self._poses, "words": self._words, "mel": self._mel, "wave": self._wave, "s2g_mel": self._s2g}
        cuts["speaker"] = lambda take, frame: self.takes["speaker"][take]
        if unknown := set(keys) - set(cuts):
            raise ValueError(f"unknown keys {unknown}; known: {KEYS}")
        return {key: cuts[key](take, frame) for key in keys}

    def _poses(self, take, frame):
        vectors = self._cut("vectors", take, frame, FRAMES)
        return vectors.reshape(len(take), FRAMES, -1) - self.mean

    def _words(self, take, frame):
        return self._cut("words", take, frame, FRAMES).astype(np.int64)

    def _mel(self, take, frame):
        return self._cut("mel", take, column_at(frame / FPS, HOP), COLUMNS).transpose(0, 2, 1)

    def _s2g(self, take, frame):
        return self._cut("s2g_mel", take, column_at(frame / FPS, S2G_HOP), S2G_COLUMNS)

    def _wave(self, take, frame):
        wave = self._cut("wave", take, np.rint(frame / FPS * RATE).astype(np.int64), SAMPLES)
        return wave.astype(np.float32) / 32768

    def _cut(self, name, take, start, length):
        index = (self.takes[CLOCKS[name]][take] + start)[:, None] + np.arange(length)
        return self._array(name)[index]

    def _array(self, name):
        if name not in self.arrays:
            with reading_hdf5(self.path, SCHEMA) as file:
                self.arrays[name] = file[f"arrays/{name}"][()]
        return self.arrays[name]

    def angle_statistics(self):
        """Mean and variance (P,), (P,) of the table's included angles over valid frames, as in HA2G's Table 10.

        In units of pi and of pi^2.
        """
        angles = included_angles(self._array("vectors")[self._array("valid")], self.levels)
        return angles.mean(axis=0), angles.var(axis=0)

    def starts(self, seed):
        """First poses of some training windows and who speaks in them: {"poses": (K, 4, 3V), "speaker": (K,)} lists."""
        chosen = np.random.default_rng(seed).permutation(len(self))
        speaker = self.speaker[chosen]
        # From every speaker equally many, as far as there are so many speakers' windows.
        rank = np.zeros(len(chosen), int)
        for number in range(len(self.speakers)):
            rank[speaker == number] = np.arange(np.sum(speaker == number))
        chosen = np.sort(chosen[np.argsort(rank, kind="stable")[:STARTS]])
        arrays = self.windows(chosen, ("poses", "speaker"))
        return {"poses": np.round(arrays["poses"][:, :SEED_FRAMES], 4).tolist(), "speaker": arrays["speaker"].tolist()}

    def digest(self):
        """A hexadecimal number that differs where a training's result would."""
        parts = [self._array("vectors"), self._array("words"), self._array("mel"), self.window_take, self.window_frame]
        if self.vocabulary.vectors is not None:
            parts.append(self.vocabulary.vectors)
        parts += [self.references[name] for name in self.speakers if self.references]
        digest = sha256()
        for part in parts:
            digest.update(np.ascontiguousarray(part))
        return digest.hexdigest()

    def write(self, path):
        """Write the HDF5 file (schema `cospeech.corpus`, docs/ha2g.md)."""
        head = {"levels": self.levels.name, "fps": FPS, "frames": FRAMES, "stride": STRIDE, "sample_rate": RATE}
        with writing_hdf5(path, SCHEMA, counts=json.dumps(self.counts), **head) as file:
            put_strings(file, "speakers", self.speakers)
            put_strings(file, "vocabulary/words", list(self.vocabulary.words))
            if self.vocabulary.vectors is not None:
                put(file, "vocabulary/vectors", self.vocabulary.vectors)
            put(file, "mean", self.mean)
            put(file, "lengths", self.lengths)
            for name, figure in self.figures.items():
                for part, value in vars(figure).items():
                    put(file, f"figures/{name}/{part}", value)
            for name, pictures in self.references.items():
                put(file, f"references/{name}", pictures)
            put_strings(file, "takes/name", self.takes["name"])
            for name in ("speaker", *dict.fromkeys(CLOCKS.values())):
                put(file, f"takes/{name}", self.takes[name])
            put(file, "windows/take", self.window_take)
            put(file, "windows/frame", self.window_frame)
            for name in CLOCKS:
                put(file, f"arrays/{name}", self._array(name))

    @classmethod
    def read(cls, path):
        """Read a file of `write`; the big arrays stay in it until they are asked for."""
        with reading_hdf5(path, SCHEMA) as file:
            text = lambda name: list(file[name].asstr()[()])
            vectors = file["vocabulary/vectors"][()] if "vocabulary/vectors" in file else None
            vocabulary = Vocabulary(tuple(text("vocabulary/words")), vectors)
            figures = {
                name: Proportions(**{part: value[()] for part, value in group.items()})
                for name, group in file["figures"].items()
            }
            takes = {"name": text("takes/name")} | {k: v[()] for k, v in file["takes"].items() if k != "name"}
            references = {name: pictures[()] for name, pictures in file.get("references", {}).items()}
            return cls(
                level_table(file.attrs["levels"]),
                text("speakers"),
                vocabulary,
                file["mean"][()],
                file["lengths"][()],
                figures,
                takes,
                file["windows/take"][()],
                file["windows/frame"][()],
                {},
                json.loads(file.attrs["counts"]),
                path,
                references,
            )


def check_rate(fps):
    """CospeechError unless motion runs at the rate that these networks' windows are made for."""
    if fps != FPS:
        raise CospeechError(
            f"HA2G: its windows of 34 frames and 70 columns are for {FPS:g} fps, not {fps:g}; set fps: 15"
        )
