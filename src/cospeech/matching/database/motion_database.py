"""The matching database: the training takes cut into clips, with what the search compares (thesis 5.3.2)."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import h5py
import numpy as np

from cospeech import __version__
from cospeech.body.physique import Build
from cospeech.clip import Words
from cospeech.errors import CospeechError, notice
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.matching.control.signals import SIGNALS, Signal, StoredSignal, covered_frames, signal_values
from cospeech.matching.database.cutting import Parts, check, check_lengths, joined_parts, parts_of
from cospeech.matching.database.descriptors import (
    AUDIO_WIDTH,
    LOOKAHEAD,
    POSE_WIDTH,
    STATIC,
    WINDOW,
    Moments,
    Normalization,
)
from cospeech.matching.database.sources import stretches
from cospeech.skeleton import UPPER55

SCHEMA = "cospeech.database"
CLIP_FRAMES = 64  # T_match of Algorithm 1
WIDTHS = {"pose": (POSE_WIDTH,), "audio": (AUDIO_WIDTH,), "positions": (len(UPPER55), 3), "speech": (STATIC,)}
SMALL = (
    *("rotation", "eligible", "real", "take", "start", "word_take"),
    *("joints_after", "speech_after", "clips", "bones", "palms"),
)
GROUPS = ("normalization", "signals", "takes", "words")
# Whether a window may run on into its take's next clip, and how many frames before it the compared pose lies.
PLACEMENTS = {
    "published": (False, 0),
    "continued": (False, 1),
    "any_frame": (True, 0),
    "any_frame_continued": (True, 1),
}


@dataclass
class Database:
    """M clips of F frames (schema `cospeech.database`, version 1); see `docs/matching.md`.

    Attributes
    ----------
    pose (M, F, 96), audio (M, F, 112) f4 : z-normalised features, as they are searched. Not to be changed afterwards.
    positions (M, F, 55, 3) f4 : metres, pelvis-relative, x left, y up, z forward.
    rotation : (M, F, 3) f4 head rotation as axis-angle in radians, or None.
    eligible : (M, F) bool, frames at which a window may start: both features and the whole window are real.
    take : (M,) int32 into `takes` (list of str). start : (M,) float64, seconds of the clip's first frame in its take.
    pose_normalization, audio_normalization : from metres and speech features to `pose` and `audio`.
    words, word_take : what was said, in seconds of the take; (W,) int32 into `takes`.
    real : (M, F) bool, frames whose features look ahead to real frames only.
    signals : {name: StoredSignal}, control signals of every frame.
    speech, joints_after, speech_after, clips, bones, palms : for `extend`, see `Parts`. moments : of both features.
    match_offset : 1 where a window follows the frame that resembles the pose so far, see `placed`.
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
    real: np.ndarray
    signals: dict = field(default_factory=dict)
    speech: np.ndarray | None = None
    joints_after: np.ndarray | None = None
    speech_after: np.ndarray | None = None
    clips: np.ndarray | None = None
    bones: np.ndarray | None = None
    palms: np.ndarray | None = None
    moments: tuple = ()
    match_offset: int = 0
    kept: dict = field(default_factory=dict, repr=False, compare=False)  # by searches, for all copies of the features

    def __len__(self):
        return len(self.pose)

    @property
    def clip_frames(self):
        """F, frames per clip."""
        return self.pose.shape[1]

    @property
    def build(self):
        """The speaker's `Build`: the median over all stretches, as `cospeech.clip.speaker_build`."""
        return Build.median([Build(*both) for both in zip(self.bones, self.palms, strict=True)])

    def time(self, clip, frame):
        """Seconds in its take of frame `frame` of clip `clip` (ints or arrays)."""
        return self.start[clip] + np.asarray(frame) / self.fps

    def gestures(self, clip, frame, name="positions"):
        """The windows that start at these frames, joined: (..., W) ints -> (..., 8 W, 55, 3) metres.

        A window that leaves its clip goes on in the next one. `name` may also be "rotation": (..., 8 W, 3) radians.
        """
        frames = getattr(self, name).reshape(-1, *getattr(self, name).shape[2:])
        number = np.asarray(clip) * self.clip_frames + np.asarray(frame)
        number = np.minimum(number[..., None] + np.arange(WINDOW), len(frames) - 1)
        return frames[number.reshape(*number.shape[:-2], -1)]

    def pose_after(self, clip, frame):
        """(..., 96) float32: the pose feature at the last frame of the windows that start at these frames."""
        return self.pose[np.divmod(np.asarray(clip) * self.clip_frames + frame + WINDOW - 1, self.clip_frames)]

    def placed(self, placement):
        """The Database in which windows may start where `placement`, one of `PLACEMENTS`, says.

        "published": inside a clip, at the frame that resembles the pose so far. "continued": at the frame after that.
        "any_frame" and "any_frame_continued": the same, but at any frame of a clip from which the take goes on. The
        Database itself is as "published".
        """
        if placement not in PLACEMENTS:
            raise CospeechError(f"placement {placement!r} is not known; known: {', '.join(PLACEMENTS)}")
        if placement == "published":
            return self
        runs_on, offset = PLACEMENTS[placement]
        eligible = _window_starts(self.real)
        if runs_on:
            _, ends = stretches(self)
            number = np.arange(self.real.size).reshape(self.real.shape)
            eligible = self.real & (number + WINDOW <= ends[:, None])
        eligible[:, :offset] = False
        return replace(self, eligible=eligible, match_offset=offset)

    @classmethod
    def from_clips(cls, clips, starts=None, clip_frames=CLIP_FRAMES):
        """From `cospeech.clip.Clip`s of one frame rate; a take's name is its clip's. See `from_arrays`."""
        return cls.from_arrays(**_arrays_of(clips), clip_frames=clip_frames, starts=starts)

    @classmethod
    def from_arrays(
        cls,
        positions,
        features,
        takes,
        clip_frames=CLIP_FRAMES,
        fps=15.0,
        *,
        starts=None,
        valid=None,
        rotations=None,
        words=None,
    ):
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
        parts = _parts(positions, features, takes, clip_frames, fps, starts, valid, rotations, words)
        if not parts.real[:, : clip_frames - WINDOW + 1].any():
            raise CospeechError(
                f"database: no frame has {LOOKAHEAD} valid frames after it; give longer takes or mark fewer invalid"
            )
        return cls._assembled(parts, fps, (Moments.none(POSE_WIDTH), Moments.none(AUDIO_WIDTH)))

    def extend(self, clips, starts=None):
        """With the `Clip`s of further takes -> Database, the one that `from_clips` would make of all takes at once.

        What is kept of the old takes is used as it is. CospeechError for a take that is in it already, or that comes
        twice without `starts` to tell its stretches apart.
        """
        arrays = _arrays_of(clips)
        for i, name in enumerate(arrays["takes"]):
            if name in self.takes or (starts is None and name in arrays["takes"][:i]):
                raise CospeechError(f"database: take {name!r} is in it already; a take can be added once")
        if arrays.pop("fps") != self.fps:
            raise CospeechError(f"database: made for {self.fps:g} fps, but clip {clips[0].clip!r} has {clips[0].fps:g}")
        own = Parts(**{name: getattr(self, name) for name in Parts.__dataclass_fields__})
        new = _parts(**arrays, clip_frames=self.clip_frames, fps=self.fps, starts=starts)
        return self._assembled(joined_parts([own, new]), self.fps, self.moments, self.signals, len(self.clips))

    @classmethod
    def _assembled(cls, parts, fps, moments, signals=None, counted=0):
        """From `Parts`, of which `moments` hold the first `counted` stretches and `signals` their clips."""
        clips, frames = parts.real.shape
        pose, audio = (np.empty((clips, frames, width), np.float32) for width in (POSE_WIDTH, AUDIO_WIDTH))
        at = 0
        for stretch, raw_pose, raw_audio, real in parts.features():
            end = at + len(real)
            pose[at:end], audio[at:end], at = raw_pose, raw_audio, end
            if stretch >= counted:
                moments = moments[0].add(raw_pose[real]), moments[1].add(raw_audio[real])
        normalizations = [m.normalization() for m in moments]
        for normalization, raw in zip(normalizations, (pose, audio), strict=True):
            for clip in raw:
                clip[:] = normalization(clip)
        database = cls(
            pose,
            audio,
            parts.positions,
            parts.rotation,
            _window_starts(parts.real),
            parts.take,
            parts.takes,
            parts.start,
            float(fps),
            *normalizations,
            parts.words,
            parts.word_take,
            parts.real,
            speech=parts.speech,
            joints_after=parts.joints_after,
            speech_after=parts.speech_after,
            clips=parts.clips,
            bones=parts.bones,
            palms=parts.palms,
            moments=moments,
        )
        database._add_known_signals(signals or {})
        return database

    def _add_known_signals(self, before):
        """All of `SIGNALS`; `before`: {name: StoredSignal} of the first clips, of which new ones are computed."""
        for name in [name for name in before if name not in SIGNALS or SIGNALS[name].compute is None]:
            notice(f"database: signal {name} is left out, because its function is not installed here")
        for name, one in SIGNALS.items():
            if one.compute is not None:
                values = signal_values(name, one, self, before[name].values if name in before else ())
                self.signals[name] = StoredSignal.of(one, values, covered_frames(self.eligible))

    def add_signal(self, compute, unit, lower="low", upper="high"):
        """Keep one more control signal, under the function's name: `compute(positions (T, 55, 3) metres, fps) -> (T,)`.

        It is kept by `save` and understood in controls wherever the file is loaded, without the function.
        """
        name, one = compute.__name__, Signal.of(compute, unit, lower, upper)
        values = signal_values(name, one, self)
        self.signals[name] = StoredSignal.of(one, values, covered_frames(self.eligible))
        SIGNALS[name] = one

    def save(self, path):
        """Write the HDF5 file whole or not at all. Large arrays lie in it plainly, ready to be memory-mapped."""
        head = {
            "fps": self.fps,
            "clips": len(self),
            "clip_frames": self.clip_frames,
            "skeleton": UPPER55.name,
            "units": "m",
            "cospeech_version": __version__,
        }
        with writing_hdf5(path, SCHEMA, **head) as file:
            file.create_group("signals")
            for name in WIDTHS:
                file.create_dataset(name, data=getattr(self, name), track_times=False)
            for name in SMALL:
                if getattr(self, name) is not None:
                    put(file, name, getattr(self, name))
            for name, moments in zip(("pose", "audio"), self.moments, strict=True):
                normalization = getattr(self, f"{name}_normalization")
                put(file, f"normalization/{name}_mean", normalization.mean)
                put(file, f"normalization/{name}_std", normalization.std)
                put(file, f"normalization/{name}_square", moments.square)
                file[f"normalization/{name}_square"].attrs["count"] = moments.count
            for name, signal in self.signals.items():
                stored = file.create_dataset(f"signals/{name}", data=signal.values, track_times=False)
                stored.attrs.update({key: getattr(signal, key) for key in ("unit", "lower", "upper", "about")})
                stored.attrs["percentiles"] = [*signal.percentiles.items()]
            put(file, "words/start", self.words.start)
            put(file, "words/end", self.words.end)
            _put_strings(file, "words/text", self.words.text)
            _put_strings(file, "takes", self.takes)

    @classmethod
    def load(cls, path, fps=None):
        """Open a database; what is large in it is mapped into memory, so that this takes no time at any size.

        fps : the frame rate that the caller works at; CospeechError if the database has another.
        """
        with reading_hdf5(path, SCHEMA) as file:
            if (skeleton := file.attrs.get("skeleton")) != UPPER55.name:
                raise CospeechError(f"{path}: its skeleton is {skeleton!r}, expected {UPPER55.name!r}; build it again")
            rate = float(file.attrs.get("fps", np.nan))
            if fps is not None and rate != fps:
                raise CospeechError(f"{path}: made for {rate:g} fps, but {fps:g} fps is asked; build it again")
            if missing := [name for name in (*WIDTHS, *SMALL, *GROUPS) if name not in file and name != "rotation"]:
                raise CospeechError(f"{path}: no complete database, {', '.join(missing)} is missing; build it again")
            return cls._from_file(path, file, rate)

    @classmethod
    def _from_file(cls, path, file, fps):
        large = {name: _mapped(path, file[name]) for name in WIDTHS}
        for name, width in WIDTHS.items():
            expected = (*large["pose"].shape[:2], *width)
            if large[name].shape != expected:
                raise CospeechError(f"{path}: {name} has shape {large[name].shape}, expected {expected}")
        small = {name: file[name][()] for name in SMALL if name != "rotation" or name in file}
        normalization, moments = {}, []
        for name in ("pose", "audio"):
            mean, std, square = (file[f"normalization/{name}_{part}"] for part in ("mean", "std", "square"))
            normalization[f"{name}_normalization"] = Normalization(mean[()], std[()])
            moments.append(Moments(int(square.attrs["count"]), mean[()], square[()]))
        return cls(
            **large,
            **normalization,
            **({"rotation": None} | small),
            fps=fps,
            moments=tuple(moments),
            takes=list(file["takes"].asstr()[()]),
            signals={n: _stored(path, d) for n, d in file["signals"].items()},
            words=Words(file["words/start"][()], file["words/end"][()], list(file["words/text"].asstr()[()])),
        )


def extend(path, clips, out=None, starts=None):
    """Add takes to a database file; `out` is another file to write, else the same. Returns the new Database."""
    database = Database.load(path).extend(clips, starts)
    database.save(out or path)
    return database


def _arrays_of(clips):
    """Clips -> what `Database.from_arrays` takes of them."""
    rates = {clip.fps for clip in clips}
    if len(rates) > 1:
        raise CospeechError(f"database: clips of different rates, {sorted(rates)} fps; make them at one rate")
    rotations = [clip.rotation for clip in clips]
    return {
        "positions": [clip.positions for clip in clips],
        "features": [clip.features for clip in clips],
        "takes": [clip.clip for clip in clips],
        "fps": rates.pop() if rates else 15.0,
        "valid": [clip.valid for clip in clips],
        "words": [clip.words for clip in clips],
        "rotations": None if any(r is None for r in rotations) else rotations,
    }


def _parts(positions, features, takes, clip_frames, fps, starts=None, valid=None, rotations=None, words=None):
    """`Parts` of the stretches that `Database.from_arrays` describes, once they are checked."""
    count = len(takes)
    positions, features = [np.asarray(p) for p in positions], [np.asarray(f) for f in features]
    starts = np.zeros(count) if starts is None else np.asarray(starts, float)
    valid = [np.ones(len(p), bool) for p in positions] if valid is None else [np.asarray(v, bool) for v in valid]
    stretches = list(zip(takes, positions, features, valid, rotations or [None] * count, strict=True))
    for stretch in stretches:
        check(*stretch)
    check_lengths(takes, [len(p) for p in positions], clip_frames)
    words = words or [Words.none()] * count
    every = zip(stretches, starts, words, strict=True)
    return joined_parts([parts_of(*stretch, start, said, clip_frames, fps) for stretch, start, said in every])


def _window_starts(real):
    """(M, F) bool: frames that are real and leave room for a window inside their clip."""
    eligible = real.copy()
    eligible[:, real.shape[1] - WINDOW + 1 :] = False
    return eligible


def _stored(path, dataset):
    percentiles = {int(p) if p == int(p) else p: value for p, value in dataset.attrs["percentiles"].tolist()}
    about = {name: str(dataset.attrs[name]) for name in ("unit", "lower", "upper", "about")}
    return StoredSignal(_mapped(path, dataset), **about, percentiles=percentiles)


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
