"""The matching database: the training takes cut into clips, with the features that the search compares (thesis 5.3.2).

Features are computed on each whole take before it is cut, so that a clip's last frames look ahead into what truly
followed. Frames past a take's last whole clip serve that look-ahead only.
"""

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from cospeech import __version__
from cospeech.clip import FEATURES, Words
from cospeech.errors import CospeechError, notice
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.matching.features import (
    AUDIO_WIDTH,
    LOOKAHEAD,
    POSE_WIDTH,
    WINDOW,
    Normalization,
    audio_features,
    pose_features,
    real_ahead,
)
from cospeech.skeleton import UPPER55

SCHEMA = "cospeech.database"
CLIP_FRAMES = 64  # T_match of Algorithm 1
LARGE = ("pose", "audio", "positions")  # stored plainly, so that they can be mapped into memory


@dataclass
class Database:
    """M clips of F frames (schema `cospeech.database`, version 1); see `docs/matching.md`.

    Attributes
    ----------
    pose (M, F, 96), audio (M, F, 112) f4 : z-normalised features, as they are searched.
    positions (M, F, 55, 3) f4 : metres, pelvis-relative, x left, y up, z forward.
    rotation : (M, F, 3) f4 head rotation as axis-angle in radians, or None.
    eligible : (M, F) bool, frames at which a window may start: both features and the whole window are real.
    take : (M,) int32 into `takes` (list of str). start : (M,) float64, seconds of the clip's first frame in its take.
    pose_normalization, audio_normalization : from metres and speech features to `pose` and `audio`.
    words, word_take : what was said, in seconds of the take; (W,) int32 into `takes`.
    """

    pose: np.ndarray
    audio: np.ndarray
    positions: np.ndarray
    rotation: np.ndarray | None
    eligible: np.ndarray
    take: np.ndarray
    takes: list
    start: np.ndarray
    fps: float
    pose_normalization: Normalization
    audio_normalization: Normalization
    words: Words
    word_take: np.ndarray

    def __len__(self):
        return len(self.pose)

    @property
    def clip_frames(self):
        """F, frames per clip."""
        return self.pose.shape[1]

    def time(self, clip, frame):
        """Seconds in its take of frame `frame` of clip `clip` (ints or arrays)."""
        return self.start[clip] + np.asarray(frame) / self.fps

    def gestures(self, clip, frame, name="positions"):
        """The windows that start at these frames, joined: (..., W) ints -> (..., 8 W, 55, 3) metres.

        `name` may also be "rotation": (..., 8 W, 3) radians.
        """
        clip, frame = np.asarray(clip)[..., None], np.asarray(frame)[..., None] + np.arange(WINDOW)
        found = getattr(self, name)[clip, frame]
        lead = clip.ndim - 2
        return found.reshape(*found.shape[:lead], -1, *found.shape[lead + 2 :])

    @classmethod
    def from_clips(cls, clips, starts=None, clip_frames=CLIP_FRAMES):
        """From `cospeech.clip.Clip`s of one frame rate; a take's name is its clip's. See `from_arrays`."""
        rates = {clip.fps for clip in clips}
        if len(rates) > 1:
            raise CospeechError(f"database: clips of different rates, {sorted(rates)} fps; make them at one rate")
        rotations = [clip.rotation for clip in clips]
        return cls.from_arrays(
            [clip.positions for clip in clips], [clip.features for clip in clips], [clip.clip for clip in clips],
            clip_frames, rates.pop() if rates else 15.0, starts=starts, valid=[clip.valid for clip in clips],
            rotations=None if any(r is None for r in rotations) else rotations, words=[clip.words for clip in clips],
        )  # fmt: skip

    @classmethod
    def from_arrays(
        cls, positions, features, takes, clip_frames=CLIP_FRAMES, fps=15.0, *, starts=None, valid=None, rotations=None,
        words=None,
    ):  # fmt: skip
        """Cut continuous stretches of speech and motion into clips that do not overlap.

        Parameters
        ----------
        positions, features : lists of (T, 55, 3) metres and (T, 28) speech features, one pair per stretch.
        takes : list of str, the take that each stretch is from; several stretches may share one.
        clip_frames : int, F. What is left of a stretch after its last whole clip is looked ahead to, but not matched.
        starts : list of float, seconds of each stretch's first frame in its take; zeros by default.
        valid : list of (T,) bool, frames that may be used; all by default.
        rotations : list of (T, 3) head rotations, axis-angle in radians, or None.
        words : list of `Words` on the stretch's own clock, or None.

        Raises CospeechError on shapes that disagree, NaN or infinity, and when no stretch holds a usable clip.
        """
        count = len(takes)
        positions, features = [np.asarray(p) for p in positions], [np.asarray(f) for f in features]
        starts = np.zeros(count) if starts is None else np.asarray(starts, float)
        valid = [np.ones(len(p), bool) for p in positions] if valid is None else [np.asarray(v, bool) for v in valid]
        stretches = list(zip(takes, positions, features, valid, rotations or [None] * count, strict=True))
        for stretch in stretches:
            _check(*stretch)
        whole = [len(p) // clip_frames for p in positions]
        _check_lengths(takes, [len(p) for p in positions], whole, clip_frames)
        cut = lambda arrays: _cut(arrays, whole, clip_frames)  # noqa: E731
        real = cut(real_ahead(v) for v in valid)
        if not real[:, : clip_frames - WINDOW + 1].any():
            raise CospeechError(
                f"database: no frame has {LOOKAHEAD} valid frames after it; give longer takes or mark fewer invalid"
            )
        pose, pose_normalization = _normalized(cut(pose_features(p) for p in positions), real)
        audio, audio_normalization = _normalized(cut(audio_features(f) for f in features), real)
        names = list(dict.fromkeys(takes))
        take = np.repeat([names.index(t) for t in takes], whole).astype(np.int32)
        start = np.concatenate([s + np.arange(n) * clip_frames / fps for s, n in zip(starts, whole, strict=True)])
        words = words or [Words.none()] * count
        return cls(
            pose, audio, cut(positions), cut(rotations) if rotations else None, _window_starts(real), take, names,
            start, float(fps), pose_normalization, audio_normalization, _join_words(words, starts),
            np.repeat([names.index(t) for t in takes], [len(w) for w in words]).astype(np.int32),
        )  # fmt: skip

    def save(self, path):
        """Write the HDF5 file whole or not at all. Large arrays lie in it plainly, ready to be memory-mapped."""
        head = {
            "fps": self.fps, "clips": len(self), "clip_frames": self.clip_frames, "skeleton": UPPER55.name,
            "units": "m", "cospeech_version": __version__,
        }  # fmt: skip
        with writing_hdf5(path, SCHEMA, **head) as file:
            for name in LARGE:
                file.create_dataset(name, data=getattr(self, name), track_times=False)
            for name in ("rotation", "eligible", "take", "start", "word_take"):
                if getattr(self, name) is not None:
                    put(file, name, getattr(self, name))
            for name in ("pose", "audio"):
                normalization = getattr(self, f"{name}_normalization")
                put(file, f"normalization/{name}_mean", normalization.mean)
                put(file, f"normalization/{name}_std", normalization.std)
            put(file, "words/start", self.words.start)
            put(file, "words/end", self.words.end)
            _put_strings(file, "words/text", self.words.text)
            _put_strings(file, "takes", self.takes)

    @classmethod
    def load(cls, path, fps=None):
        """Open a database; features and positions are mapped into memory, so that this takes no time at any size.

        fps : the frame rate that the caller works at; CospeechError if the database has another.
        """
        with reading_hdf5(path, SCHEMA) as file:
            if (skeleton := file.attrs.get("skeleton")) != UPPER55.name:
                raise CospeechError(f"{path}: its skeleton is {skeleton!r}, expected {UPPER55.name!r}; build it again")
            rate = float(file.attrs.get("fps", np.nan))
            if fps is not None and rate != fps:
                raise CospeechError(f"{path}: made for {rate:g} fps, but {fps:g} fps is asked; build it again")
            try:
                return cls._from_file(path, file, rate)
            except KeyError as error:
                raise CospeechError(f"{path}: {error.args[0]}, so it is no complete database") from error

    @classmethod
    def _from_file(cls, path, file, fps):
        large = {name: _mapped(path, file[name]) for name in LARGE}
        shape = large["pose"].shape[:2]
        for name, width in {"pose": (POSE_WIDTH,), "audio": (AUDIO_WIDTH,), "positions": (len(UPPER55), 3)}.items():
            if large[name].shape != (*shape, *width):
                raise CospeechError(f"{path}: {name} has shape {large[name].shape}, expected {(*shape, *width)}")
        normalization = lambda n: Normalization(*(file[f"normalization/{n}_{s}"][()] for s in ("mean", "std")))  # noqa: E731
        return cls(
            **large, rotation=file["rotation"][()] if "rotation" in file else None,
            eligible=file["eligible"][()].astype(bool), take=file["take"][()], takes=list(file["takes"].asstr()[()]),
            start=file["start"][()], fps=fps, pose_normalization=normalization("pose"),
            audio_normalization=normalization("audio"), word_take=file["word_take"][()],
            words=Words(file["words/start"][()], file["words/end"][()], list(file["words/text"].asstr()[()])),
        )  # fmt: skip


def _check(take, positions, features, valid, rotation):
    """CospeechError, naming the take, unless the arrays of one stretch agree in length and are finite."""
    frames = len(positions)
    arrays = {"positions": (positions, (frames, len(UPPER55), 3)), "features": (features, (frames, FEATURES))}
    arrays["valid"] = (valid, (frames,))
    if rotation is not None:
        arrays["rotation"] = (rotation, (frames, 3))
    for name, (array, shape) in arrays.items():
        if np.shape(array) != shape:
            raise CospeechError(f"database: take {take!r}: {name} has shape {np.shape(array)}, expected {shape}")
        if not np.isfinite(array).all():
            frame = int(np.argwhere(~np.isfinite(array))[0][0])
            raise CospeechError(f"database: take {take!r}: {name} holds NaN or infinity, first in frame {frame}")


def _check_lengths(takes, lengths, whole, clip_frames):
    if clip_frames < WINDOW:
        raise CospeechError(f"database: clips of {clip_frames} frames cannot hold a window of {WINDOW}")
    short = [take for take, n in zip(takes, whole, strict=True) if not n]
    if len(short) == len(takes):
        longest = max(lengths, default=0)
        raise CospeechError(
            f"database: no training clip long enough: the longest has {longest} frames, one needs {clip_frames}"
        )
    if short:
        notice(f"database: left out, shorter than one clip of {clip_frames} frames: {', '.join(sorted(set(short)))}")


def _cut(arrays, whole, clip_frames):
    """Per-stretch (T, ...) arrays -> one (M, clip_frames, ...) array; the stretches come one at a time."""
    clips, at = None, 0
    for array, n in zip(arrays, whole, strict=True):
        if clips is None:
            kind = bool if array.dtype == bool else np.float32
            clips = np.empty((sum(whole), clip_frames, *array.shape[1:]), kind)
        clips[at : at + n] = array[: n * clip_frames].reshape(n, clip_frames, *array.shape[1:])
        at += n
    return clips


def _normalized(raw, real):
    """(M, F, D) features, z-normalised in place by the frames whose features are real -> (features, Normalization)."""
    normalization = Normalization.fit(raw[real])
    for clip in raw:
        clip[:] = normalization(clip)
    return raw, normalization


def _window_starts(real):
    """(M, F) bool: frames that are real and leave room for a window inside their clip."""
    eligible = real.copy()
    eligible[:, real.shape[1] - WINDOW + 1 :] = False
    return eligible


def _join_words(words, starts):
    shifted = lambda name: np.concatenate([getattr(w, name) + s for w, s in zip(words, starts, strict=True)])  # noqa: E731
    return Words(shifted("start"), shifted("end"), [text for w in words for text in w.text])


def _put_strings(file, name, strings):
    encoded = np.array([text.encode() for text in strings], dtype=object)
    file.create_dataset(name, data=encoded, dtype=h5py.string_dtype("utf-8"), shape=(len(encoded),))


def _mapped(path, dataset):
    """A stored array as copy-on-write memory of the file; read instead if it lies there in a form that needs it."""
    offset = dataset.id.get_offset()
    plain = dataset.chunks is None and dataset.dtype == np.float32 and dataset.dtype.isnative
    if not plain or offset is None or offset % dataset.dtype.itemsize:
        return dataset[()].astype(np.float32)
    return np.asarray(np.memmap(Path(path), np.float32, mode="c", offset=offset, shape=dataset.shape))
