"""Faces as a 3D morphable model (thesis 2.1.2): V = T_s + E_s alpha_s + E_e alpha_e, equation 2.4."""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import h5py
import numpy as np

from cospeech.errors import CospeechError
from cospeech.face.expressions import COSPEECH64, LANDMARKS
from cospeech.face.layouts import arguments
from cospeech.files import put, reading_hdf5, writing_hdf5

SCHEMA = "cospeech.face_model"
EMBEDDED = "cospeech64"


@dataclass
class FaceModel:
    """A morphable model of V vertices, in metres: x to the face's own left, y up, z forward.

    Attributes
    ----------
    mean (V, 3), identity (V, 3, I), expression (V, 3, E) : template and bases; one unit of an identity coefficient is a
        standard deviation of faces. triangles (F, 3), counterclockwise seen from outside.
    landmarks (68,) : vertices of iBUG's landmarks, -1 where the model has none. lips : vertices of the lips.
    irises (2,) : vertices in the middle of the right and the left iris, or none.
    expression_names, regions {name: vertices} : empty where unknown.
    bounded : whether expressions are meant to lie between 0 and 1.
    licence_note : goes into every file made from the model.
    """

    name: str
    mean: np.ndarray
    identity: np.ndarray
    expression: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray
    lips: np.ndarray
    irises: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    expression_names: tuple = ()
    identity_names: tuple = ()
    regions: dict = field(default_factory=dict)
    bounded: bool = False
    licence_note: str = ""

    def vertices(self, expression=None, identity=None, chosen=slice(None)):
        """Equation 2.4: expression (..., E), identity (I,) -> vertices (..., V, 3) in metres; None is the mean.

        `chosen` : indices of the vertices that are wanted, by default all.
        """
        points = self.mean[chosen]
        if identity is not None:
            points = points + self.identity[chosen] @ self._checked("identity", identity)
        if expression is None:
            return points
        expression = self._checked("expression", expression)
        basis = self.expression[chosen]
        moved = expression @ basis.reshape(-1, basis.shape[-1]).T
        return points + moved.reshape(*expression.shape[:-1], *basis.shape[:2])

    def lip_vertices(self, expression, identity=None):
        """The lips' vertices in metres, head in neutral pose: expression (T, E) -> (T, L, 3)."""
        return self.vertices(expression, identity, self.lips)

    def _checked(self, what, values):
        values, width = np.asarray(values, float), getattr(self, what).shape[-1]
        if values.shape[-1] != width:
            raise CospeechError(f"face model {self.name}: {values.shape[-1]} {what} coefficients, it has {width}")
        return values

    def validate(self, where):
        """CospeechError, naming the array, unless all shapes and indices agree."""
        count = len(self.mean)
        shapes = {
            "mean": (count, 3),
            "identity": (count, 3, self.identity.shape[-1]),
            "landmarks": (LANDMARKS,),
            "expression": (count, 3, self.expression.shape[-1]),
            "triangles": (len(self.triangles), 3),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise CospeechError(f"{where}: {name} has shape {array.shape}, expected {shape}")
            if not np.isfinite(array).all():
                raise CospeechError(f"{where}: {name} holds NaN or infinity")
        for name in ("triangles", "landmarks", "lips", "irises"):
            indices = getattr(self, name)
            if indices.size and not (indices.min() >= (-1 if name == "landmarks" else 0) and indices.max() < count):
                raise CospeechError(f"{where}: {name} names vertices beyond the model's {count}")
        return self

    def write(self, path):
        """Write as HDF5 (schema `cospeech.face_model`, version 1)."""
        head = {
            "name": self.name,
            "units": "m",
            "axes": "x left, y up, z forward",
            "bounded": self.bounded,
            "licence_note": self.licence_note,
        }
        with writing_hdf5(path, SCHEMA, **head) as file:
            for key in ARRAYS:
                put(file, key, getattr(self, key))
            for key in ("expression_names", "identity_names"):
                file.create_dataset(key, data=list(getattr(self, key)), dtype=h5py.string_dtype())

    @classmethod
    def load(cls, path=EMBEDDED):
        """The embedded model (`cospeech64`), or one of the user's: HDF5 as `write` makes it, or an npz of such names.

        Other layouts are read by `convert`. Raises CospeechError for files that do not fit.
        """
        if str(path) == EMBEDDED:
            return embedded()
        if Path(path).suffix == ".npz":
            return convert(path)
        with reading_hdf5(path, SCHEMA) as file:
            try:
                arrays = {key: file[key][()] for key in ARRAYS}
                names = {key: tuple(file[key].asstr()[()]) for key in ("expression_names", "identity_names")}
                head = {key: file.attrs[key] for key in ("name", "bounded", "licence_note")}
            except KeyError as error:
                raise CospeechError(f"{path}: no complete face model: {error.args[0]}") from error
        return cls(**arrays, **names, **head).validate(path)


ARRAYS = ("mean", "identity", "expression", "triangles", "landmarks", "lips", "irises")


def convert(path, **options):
    """A `FaceModel` in another layout, as whose owner gives it; see `layouts.arguments` for what is read and asked."""
    return FaceModel(**arguments(path, **options)).validate(path)


@cache
def embedded():
    """Our own model, drawn by code: 64 named expressions and 32 ways in which faces differ. No scan, no licence."""
    from cospeech.face.bases import bases
    from cospeech.face.shape import sketch, table

    numbers = table()
    face = sketch(numbers)
    points = np.concatenate(face.points)
    identity, expression = bases(face, points, numbers, COSPEECH64)
    metres = lambda array: np.ascontiguousarray(array, np.float64) / 1000
    return FaceModel(
        EMBEDDED,
        metres(points),
        metres(identity),
        metres(expression),
        np.concatenate(face.triangles).astype(np.int32),
        _landmarks(face.strokes),
        np.array(face.regions["lips"]),
        irises=np.concatenate([face.strokes["right_iris"], face.strokes["left_iris"]]),
        expression_names=COSPEECH64,
        identity_names=tuple(numbers["identity"]),
        bounded=True,
        regions={name: np.array(vertices) for name, vertices in face.regions.items()},
    ).validate("the embedded face model")


def _landmarks(strokes):
    """(68,) the strokes' vertices in iBUG's order, which goes from the face's right to its left."""
    arc, inner = [0, 4, 8, 12], [0, 4, 6, 8, 12]
    lids = [
        strokes["right_upper_lid"][arc],
        strokes["right_lower_lid"][[7, 3]],
        strokes["left_upper_lid"][arc],
        strokes["left_lower_lid"][[7, 3]],
    ]
    outer, lower = strokes["upper_lip_outer"], strokes["lower_lip_outer"]
    mouth = [
        outer[[0, 2, 4, 6, 8, 10, 12]],
        lower[[9, 7, 5, 3, 1]],
        strokes["upper_lip_inner"][inner],
        strokes["lower_lip_inner"][[7, 5, 3]],
    ]
    return np.concatenate(
        [
            strokes["jaw"],
            strokes["right_brow"],
            strokes["left_brow"],
            strokes["bridge"],
            strokes["nostrils"],
            *lids,
            *mouth,
        ]
    )
