"""The clip: one take of one speaker on one clock. Every annotation ends as one, and every synthesis is one."""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import h5py
import numpy as np

from cospeech import __version__
from cospeech.body.physique import Build
from cospeech.errors import CospeechError
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.skeleton import UPPER55

SCHEMA = "cospeech.clip"
FEATURES = 28
AXES = "x left, y up, z forward"  # the character's own, right-handed as in glTF


def put_strings(group, name, strings):
    """Store a list of str as UTF-8."""
    encoded = np.array([string.encode() for string in strings], dtype=object)
    return group.create_dataset(name, data=encoded, dtype=h5py.string_dtype("utf-8"), shape=(len(encoded),))


@dataclass
class Words:
    """Spoken words: start, end (W,) float64 in seconds from the clip's start, ascending; text, a list of W strings."""

    start: np.ndarray
    end: np.ndarray
    text: list

    def __len__(self):
        return len(self.text)

    @classmethod
    def none(cls):
        return cls(np.zeros(0), np.zeros(0), [])


@dataclass
class Motion:
    """What a generator makes for T frames.

    positions (T, 55, 3) metres, pelvis-relative, x left, y up, z forward; rotation (T, 3) head rotation as axis-angle
    in radians, or None; expression (T, E) coefficients of `face_model`, or None; trace, where the frames are from;
    build, the speaker's, which motion gets at last (`whole`); None for the speaker's own frames.
    """

    positions: np.ndarray
    rotation: np.ndarray | None = None
    expression: np.ndarray | None = None
    face_model: str = ""
    trace: "Trace | None" = None
    build: Build | None = None

    def __len__(self):
        return len(self.positions)

    def whole(self):
        """With the speaker's build: bones and palms keep their size, hand roots lie at their wrists."""
        if self.build is None:
            return self
        return replace(self, positions=self.build.restored(self.positions).astype(np.float32))


@dataclass
class Trace:
    """Where each of T generated frames is from (group /trace of a clip; docs/control.md lists its columns).

    columns : {name: (T,) numbers}; those named in `labels` are numbers of their texts, -1 for none.
    labels : {column name: list of str}. settings : {name: number or str} that hold for all frames.
    """

    columns: dict
    labels: dict
    settings: dict = field(default_factory=dict)

    def texts(self, name):
        """A column of numbers as texts: list of T str, "" for none."""
        return [self.labels[name][i] if i >= 0 else "" for i in self.columns[name]]

    def section(self, start, stop):
        """Frames start..stop."""
        return replace(self, columns={name: column[start:stop] for name, column in self.columns.items()})

    def overlaid(self, frames, **values):
        """A Trace in which `frames` (a slice) have these numbers or texts, and -1 in all other columns."""
        columns, labels = {name: column.copy() for name, column in self.columns.items()}, dict(self.labels)
        for name, column in columns.items():
            value = values.get(name, -1)
            if isinstance(value, str):
                labels[name] = list(dict.fromkeys([*labels[name], value]))
                value = labels[name].index(value)
            column[frames] = value
        return replace(self, columns=columns, labels=labels)

    def write(self, group):
        """Into an HDF5 group: a dataset for each column, its texts in <column>_labels, settings as attributes."""
        group.attrs.update(self.settings)
        for name, column in self.columns.items():
            put(group, name, column)
        for name, texts in self.labels.items():
            put_strings(group, f"{name}_labels", texts)

    @classmethod
    def read(cls, group):
        """From such a group."""
        labels = {name.removesuffix("_labels") for name in group if name.endswith("_labels")}
        return cls(
            {name: group[name][()] for name in group if not name.endswith("_labels")},
            {name: list(group[f"{name}_labels"].asstr()[()]) for name in labels},
            {k: v.item() if isinstance(v, np.generic) else v for k, v in group.attrs.items()},
        )


@dataclass
class Clip:
    """One take (schema `cospeech.clip`, version 1); see `docs/clip.md` for the file.

    positions (T, 55, 3) f4 metres, features (T, 28) f4, valid (T,) bool are always there; the rest may be None.
    `audio` is the path of the sound, relative to the clip file's folder. `generator` is "" for a real take.
    `extra` holds further root attributes (scalars or strings), kept through write and read. `trace` tells of a
    generated clip's frames where they are from, or is None.
    """

    subject: str
    clip: str
    fps: float
    positions: np.ndarray
    features: np.ndarray
    valid: np.ndarray | None = None
    confidence: np.ndarray | None = None
    root: np.ndarray | None = None
    expression: np.ndarray | None = None
    rotation: np.ndarray | None = None
    face_confidence: np.ndarray | None = None
    face_model: str = ""
    words: Words = field(default_factory=Words.none)
    audio: str = ""
    sample_rate: int = 0
    loudness_lufs: float = float("nan")
    source: str = ""
    source_sha256: str = ""
    generator: str = ""
    extra: dict = field(default_factory=dict)
    trace: Trace | None = None

    def __post_init__(self):
        if self.valid is None:
            self.valid = np.ones(len(self.positions), bool)
        if self.confidence is None:
            self.confidence = np.ones(self.positions.shape[:2], np.float32)

    def __len__(self):
        return len(self.positions)

    @property
    def frames(self):
        """T, the number of motion frames."""
        return len(self.positions)

    @property
    def duration(self):
        """Seconds."""
        return self.frames / self.fps

    @property
    def motion(self):
        """The clip's motion without its sound, as generators exchange it."""
        return Motion(self.positions, self.rotation, self.expression, self.face_model, self.trace)

    def section(self, start, stop):
        """Frames start..stop as a clip of its own; words that lie wholly inside come along, shifted in time."""
        per_frame = (
            "positions",
            "features",
            "valid",
            "confidence",
            "root",
            "expression",
            "rotation",
            "face_confidence",
        )
        cut = {name: None if (a := getattr(self, name)) is None else a[start:stop] for name in per_frame}
        first, last = start / self.fps, stop / self.fps
        inside = [i for i in range(len(self.words)) if self.words.start[i] >= first and self.words.end[i] <= last]
        words = Words(
            self.words.start[inside] - first, self.words.end[inside] - first, [self.words.text[i] for i in inside]
        )
        trace = self.trace and self.trace.section(start, stop)
        return replace(self, words=words, trace=trace, **cut)

    def validate(self, where=None):
        """Raise CospeechError, naming the array, unless shapes agree with T and every number is finite."""
        where = where or f"clip {self.subject}/{self.clip}"
        if not self.frames:
            raise CospeechError(f"{where}: the clip has 0 frames")
        frames, joints = self.frames, len(UPPER55)
        width = None if self.expression is None else self.expression.shape[-1]
        expected = {
            "positions": (frames, joints, 3),
            "features": (frames, FEATURES),
            "valid": (frames,),
            "confidence": (frames, joints),
            "root": (frames, 3),
            "expression": (frames, width),
            "rotation": (frames, 3),
            "face_confidence": (frames,),
        }
        arrays = {name: getattr(self, name) for name in expected if getattr(self, name) is not None}
        for name, column in self.trace.columns.items() if self.trace else ():
            arrays[f"trace/{name}"], expected[f"trace/{name}"] = column, (frames,)
        for name, array in arrays.items():
            shape = expected[name]
            if array.shape != shape:
                raise CospeechError(f"{where}: {name} has shape {array.shape}, expected {shape}")
            if not np.isfinite(array).all():
                frame = int(np.argwhere(~np.isfinite(array))[0][0])
                raise CospeechError(f"{where}: {name} holds NaN or infinity, first in frame {frame}")
        if not self.fps > 0:
            raise CospeechError(f"{where}: fps is {self.fps}, expected a positive number")
        return self

    def write(self, path):
        """Write the HDF5 file whole or not at all (gzip + shuffle), after `validate`."""
        self.validate()
        head = {
            "subject": self.subject,
            "clip": self.clip,
            "fps": float(self.fps),
            "frames": self.frames,
            "units": "m",
            "axes": AXES,
            "skeleton": UPPER55.name,
            "source": self.source,
            "source_sha256": self.source_sha256,
            "generator": self.generator,
            "cospeech_version": __version__,
        }
        with writing_hdf5(path, SCHEMA, **(head | self.extra)) as file:
            audio = file.create_group("audio")
            audio.attrs.update(path=self.audio, sample_rate=self.sample_rate, loudness_lufs=self.loudness_lufs)
            put(audio, "features", self.features.astype(np.float32))
            motion = file.create_group("motion")
            put(motion, "positions", self.positions.astype(np.float32))
            put(motion, "confidence", self.confidence.astype(np.float32))
            if self.root is not None:
                put(motion, "root", self.root.astype(np.float32))
            self._write_face(file)
            words = file.create_group("words")
            put(words, "start", np.asarray(self.words.start, np.float64))
            put(words, "end", np.asarray(self.words.end, np.float64))
            put_strings(words, "text", self.words.text)
            put(file, "valid", self.valid.astype(bool))
            if self.trace:
                self.trace.write(file.create_group("trace"))

    def _write_face(self, file):
        arrays = {"expression": self.expression, "rotation": self.rotation, "confidence": self.face_confidence}
        present = {name: array for name, array in arrays.items() if array is not None}
        if not present:
            return
        face = file.create_group("face")
        face.attrs.update(model=self.face_model, E=0 if self.expression is None else self.expression.shape[1])
        for name, array in present.items():
            put(face, name, array.astype(np.float32))

    @classmethod
    def read(cls, path):
        """Read and validate; CospeechError names the file and what is wrong with it."""
        with reading_hdf5(path, SCHEMA) as file:
            try:
                clip = cls._from_file(file)
            except KeyError as error:
                raise CospeechError(f"{path}: no complete clip, something is missing: {error.args[0]!s}") from error
        if clip.extra.pop("skeleton", None) != UPPER55.name:
            raise CospeechError(f"{path}: its skeleton is not {UPPER55.name}; convert it first (docs/clip.md)")
        return clip.validate(Path(path))

    @classmethod
    def _from_file(cls, file):
        get = lambda name: file[name][()] if name in file else None
        head = {k: v.item() if isinstance(v, np.generic) else v for k, v in file.attrs.items()}
        known = {f.name for f in fields(cls)} & head.keys() | {"subject", "clip", "fps"}
        written = {"schema", "schema_version", "frames", "units", "axes", "cospeech_version"}
        extra = {k: v for k, v in head.items() if k not in known | written}
        audio, face = file["audio"].attrs, file["face"].attrs if "face" in file else {}
        words = Words.none()
        if "words" in file:
            words = Words(get("words/start"), get("words/end"), list(file["words/text"].asstr()[()]))
        return cls(
            **{k: head[k] for k in known},
            positions=file["motion/positions"][()],
            features=file["audio/features"][()],
            valid=file["valid"][()].astype(bool),
            confidence=get("motion/confidence"),
            root=get("motion/root"),
            expression=get("face/expression"),
            rotation=get("face/rotation"),
            face_confidence=get("face/confidence"),
            face_model=face.get("model", ""),
            words=words,
            audio=audio.get("path", ""),
            sample_rate=int(audio.get("sample_rate", 0)),
            loudness_lufs=float(audio.get("loudness_lufs", np.nan)),
            extra=extra,
            trace=Trace.read(file["trace"]) if "trace" in file else None,
        )


def speaker_build(clips):
    """A speaker's `Build`: of each clip's valid frames the medians, and of these the median."""
    return Build.median([Build.measure(clip.positions[clip.valid]) for clip in clips if clip.valid.any()])
