"""The track: what a tracker saw in one video, in the tracker's own skeletons, with confidences. Raw, never edited."""

import re
from dataclasses import dataclass, field, fields
from importlib.resources import files
from pathlib import Path

import numpy as np

from cospeech import __version__
from cospeech.errors import CospeechError
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.skeleton import Skeleton

SCHEMA = "cospeech.track"
PARTS = ("body", "left_hand", "right_hand", "face_landmarks")
SPACES = ("camera", "root", "wrist", "crop")
FIELD_OF_VIEW = 50.0  # degrees over the longer side: what is assumed of a camera that nobody described


@dataclass
class Camera:
    """A pinhole camera without distortion, in pixels; `origin` says whether it was "given" or "assumed"."""

    fx: float
    fy: float
    cx: float
    cy: float
    origin: str = "assumed"

    @classmethod
    def assumed(cls, width, height):
        """The camera taken for a video of unknown origin: 50 degrees over the longer side, centre in the middle."""
        focal = max(width, height) / 2 / np.tan(np.radians(FIELD_OF_VIEW / 2))
        return cls(focal, focal, width / 2, height / 2)


@dataclass
class Points:
    """K points of one part of the body over F frames.

    Attributes
    ----------
    skeleton : name of a table `skeletons/<name>.yaml`, which names the K points.
    xy : (F, K, 2) pixels of the full upright picture, (0, 0) its upper left corner; x right, y down.
    xyz : (F, K, 3) metres (if `metric`, else the tracker's own unit), x right, y down, z away from the camera, or None
        for a tracker that sees in two dimensions only.
    score : (F, K) confidence, 0..1.
    observed : (F,) bool; False where the tracker did not find this part of the speaker: the other arrays are 0 there.
    space : what `xyz` is relative to: the "camera", the "root" point, the "wrist" of a hand, or the "crop".
    root : name of the point that is the origin of `xyz`, "" in camera space; "centre" where it is no single point.
    """

    skeleton: str
    xy: np.ndarray
    score: np.ndarray
    observed: np.ndarray
    xyz: np.ndarray | None = None
    space: str = "camera"
    root: str = ""
    metric: bool = False

    def __len__(self):
        return len(self.xy)

    @property
    def table(self):
        """The `Skeleton` that names the points."""
        return Skeleton.load(self.skeleton)

    @classmethod
    def empty(cls, skeleton, frames, depth=True, **attributes):
        """Points never observed in `frames` frames: all zero."""
        count = len(Skeleton.load(skeleton))
        zeros = lambda *shape: np.zeros((frames, count, *shape), np.float32)
        return cls(skeleton, zeros(2), zeros(), np.zeros(frames, bool), zeros(3) if depth else None, **attributes)


@dataclass
class FaceCoefficients:
    """A face as coefficients of `model`: expression (F, E), rotation (F, 3) axis-angle in radians, score (F,) 0..1.

    The rotation takes the face's own axes (x to its left, y up, z forward) to the camera turned upright (x left as the
    face sees it, y up, z towards the camera): a face that looks into the camera has rotation 0. A score of 0 means that
    no face was found in the frame; its numbers are 0 then.
    """

    expression: np.ndarray
    rotation: np.ndarray
    score: np.ndarray
    model: str = ""


@dataclass
class Track:
    """What was seen in one video (schema `cospeech.track`, version 1); see `docs/capture.md` for the file.

    Frame i of F shows the source at `start + i / fps` seconds. Parts that the tracker does not see at all are None.
    `cuts` lists the frames (int, ascending) that are the first of a new shot: motion is not continuous there.
    `refused` tells why nothing was seen, for a take that cannot be used (docs/capture.md).
    """

    fps: float
    frames: int
    width: int
    height: int
    body: Points | None = None
    left_hand: Points | None = None
    right_hand: Points | None = None
    face_landmarks: Points | None = None
    face: FaceCoefficients | None = None
    source: str = ""
    source_sha256: str = ""
    start: float = 0.0
    backend: str = ""
    backend_version: str = ""
    model_sha256: str = ""
    licence_note: str = ""
    refused: str = ""
    camera: Camera | None = None
    cuts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self):
        if self.camera is None:
            self.camera = Camera.assumed(self.width, self.height)

    def __len__(self):
        return self.frames

    @property
    def parts(self):
        """{name: Points} of the parts that are there."""
        return {name: points for name in PARTS if (points := getattr(self, name)) is not None}

    def validate(self, where="track"):
        """Raise CospeechError, naming the array, unless shapes agree and every number is finite."""
        if not self.frames > 0:
            raise CospeechError(f"{where}: the track has {self.frames} frames")
        for name in ("fps", "width", "height"):
            if not 0 < getattr(self, name) < float("inf"):
                raise CospeechError(f"{where}: {name} is {getattr(self, name)}, expected a positive number")
        for name, points in self.parts.items():
            _check_points(points, self.frames, f"{where}: {name}")
        if self.face is not None:
            width = self.face.expression.shape[-1]
            for name, shape in {"expression": (width,), "rotation": (3,), "score": ()}.items():
                _check_array(getattr(self.face, name), (self.frames, *shape), f"{where}: face/{name}")
            _check_share(self.face.score, f"{where}: face/score")
        camera = [self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy]
        if not np.isfinite(camera).all() or min(camera[:2]) <= 0 or self.camera.origin not in ("assumed", "given"):
            raise CospeechError(f"{where}: camera {camera} ({self.camera.origin}): expected focal lengths above 0")
        if len(self.cuts) and not (np.diff([0, *self.cuts, self.frames]) > 0).all():
            raise CospeechError(f"{where}: cuts are not ascending frames between 1 and {self.frames - 1}")
        return self

    def write(self, path):
        """Write the HDF5 file whole or not at all (gzip + shuffle), after `validate`."""
        self.validate()
        head = (
            {
                "fps": float(self.fps),
                "frames": self.frames,
                "width": self.width,
                "height": self.height,
                "camera": [self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy],
                "camera_origin": self.camera.origin,
                "cospeech_version": __version__,
            }
            | {name: getattr(self, name) for name in TEXTS}
            | {"start": float(self.start)}
        )
        with writing_hdf5(path, SCHEMA, **head) as file:
            for name, points in self.parts.items():
                group = file.create_group(name)
                group.attrs.update(skeleton=points.skeleton, space=points.space, root=points.root, metric=points.metric)
                for key in ("xy", "xyz", "score"):
                    if (array := getattr(points, key)) is not None:
                        put(group, key, array.astype(np.float32, copy=False))
                put(group, "observed", points.observed.astype(bool))
            if self.face is not None:
                group = file.create_group("face")
                group.attrs.update(model=self.face.model, E=self.face.expression.shape[1])
                for key in ("expression", "rotation", "score"):
                    put(group, key, getattr(self.face, key).astype(np.float32))
            put(file, "cuts", np.asarray(self.cuts, np.int64))

    @classmethod
    def read(cls, path):
        """Read and validate; CospeechError names the file and what is wrong with it."""
        with reading_hdf5(path, SCHEMA) as file:
            try:
                head = {key: v.item() if isinstance(v, np.generic) else v for key, v in file.attrs.items()}
                camera = Camera(*(float(v) for v in head["camera"]), head["camera_origin"])
                kept = {f.name for f in fields(cls)} & head.keys() - {"camera"}
                track = cls(
                    **{key: head[key] for key in kept},
                    camera=camera,
                    face=_read_face(file),
                    cuts=file["cuts"][()] if "cuts" in file else np.zeros(0, np.int64),
                    **{name: _read_points(file[name]) for name in PARTS if name in file},
                )
            except (KeyError, TypeError) as error:
                raise CospeechError(f"{path}: no complete track, something is missing: {error.args[0]!s}") from error
        return track.validate(Path(path))


TEXTS = ("source", "source_sha256", "backend", "backend_version", "model_sha256", "licence_note", "refused")


def _read_points(group):
    head = group.attrs
    return Points(
        head["skeleton"],
        group["xy"][()],
        group["score"][()],
        group["observed"][()].astype(bool),
        group["xyz"][()] if "xyz" in group else None,
        head["space"],
        head["root"],
        bool(head["metric"]),
    )


def _read_face(file):
    if "face" not in file:
        return None
    face = file["face"]
    return FaceCoefficients(face["expression"][()], face["rotation"][()], face["score"][()], face.attrs["model"])


def _check_points(points, frames, where):
    if not re.fullmatch(r"\w+", points.skeleton) or not _skeleton_file(points.skeleton).is_file():
        raise CospeechError(f"{where}: skeleton {points.skeleton!r} is none that this cospeech has a table of")
    if points.space not in SPACES:
        raise CospeechError(f"{where}: space {points.space!r} is not one of {', '.join(SPACES)}")
    count = len(points.table)
    shapes = {"xy": (frames, count, 2), "xyz": (frames, count, 3), "score": (frames, count), "observed": (frames,)}
    for name, shape in shapes.items():
        if getattr(points, name) is not None:
            _check_array(getattr(points, name), shape, f"{where}/{name}")
    _check_share(points.score, f"{where}/score")


def _skeleton_file(name):
    return files("cospeech") / "skeletons" / f"{name}.yaml"


def _check_array(array, shape, where):
    if array.shape != shape:
        raise CospeechError(f"{where} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        frame = int(np.argwhere(~np.isfinite(array))[0][0])
        raise CospeechError(f"{where} holds NaN or infinity, first in frame {frame}")


def _check_share(score, where):
    if score.size and not (score.min() >= 0 and score.max() <= 1):
        raise CospeechError(f"{where} lies between {score.min():g} and {score.max():g}, expected 0 to 1")
