"""The character's head: the mesh of a face model, moved by its expression, with skull and hair around it."""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.face.model import EMBEDDED, FaceModel, embedded
from cospeech.face.shape import inside
from cospeech.render.character.mesh import unit, vertex_normals
from cospeech.render.character.skull import around_face

HEIGHT = 0.240  # metres from chin to crown, of a character whose trunk is 0.5 m
# Blue, green, red of the parts; the skin is the figure's.
COLORS = {
    "hair": (52, 58, 72),
    "brow": (54, 62, 84),
    "lash": (44, 42, 54),
    "lips": (110, 118, 196),
    "gullet": (40, 28, 62),
    "nostril": (84, 96, 132),
    "throat": (148, 168, 202),
    "upper_teeth": (232, 238, 240),
    "tongue": (112, 108, 190),
    "lower_teeth": (220, 227, 230),
    "white": (244, 246, 246),
    "iris": (116, 88, 56),
    "pupil": (32, 26, 24),
    "socket": (168, 172, 204),
}
IRIS, PUPIL = 0.0060, 0.0032  # metres of an eyeball's vertices from the middle of the iris
IN_MOUTH = {"upper_teeth": 2, "lower_teeth": 2, "tongue": 1}  # regions, and the axis that they face along
LIMITS = -0.2, 1.2  # beyond which expressions of a bounded model are not drawn
JAW, CORNERS, OUTER_LIPS = (slice(2, 15), [36, 39, 42, 45], slice(48, 60))  # landmarks: jaw, of eyes and mouth


def face_of(clip, face=None):
    """The FaceModel that a clip's head is drawn with, and its expression (T, E), None where the head is neutral.

    face : a FaceModel or the file of one, for clips made with it; by default the embedded model, and then the face of a
    clip of another model stays neutral, as does that of a clip without one. CospeechError for a given model of other
    dimensions than the clip's.
    """
    given = face is not None
    face = face if isinstance(face, FaceModel) else FaceModel.load(face if given else EMBEDDED)
    if clip.expression is None or not (given or clip.face_model == face.name):
        return face, None
    found, known = clip.expression.shape[1], face.expression.shape[2]
    if found != known:
        raise CospeechError(
            f"{clip.clip}: has {found} expression coefficients of the face model {clip.face_model!r}, "
            f"but {face.name} has {known}; give the model that they are of"
        )
    return face, clip.expression


class Head:
    """The head's mesh. triangles (F, 3) int32 and unlit colors (F, 3), of each triangle, as in `Character`.

    All vertices are linear in the expression: mean (V, 3) + expression @ basis (E, V * 3), metres, in the frame of the
    embedded face model.
    """

    def __init__(self, face, skin):
        pieces = around_face(aligned := _aligned(face))
        starts = np.cumsum([len(aligned.mean), *(len(piece.points) for piece in pieces)])
        self.bounded = face.bounded
        self.mean = np.concatenate([aligned.mean, *(piece.points for piece in pieces)]).astype(np.float32)
        moves = [face.expression, *(_moved(piece, face.expression) for piece in pieces)]
        self.basis = np.ascontiguousarray(np.concatenate(moves).reshape(len(self.mean) * 3, -1).T, np.float32)
        triangles = _shown(face)
        painted = _painted(face, triangles, skin)
        self.triangles = np.concatenate(
            [triangles, *(piece.triangles + start for piece, start in zip(pieces, starts, strict=False))]
        ).astype(np.int32)
        around = [np.tile(COLORS.get(piece.kind, skin), (len(piece.triangles), 1)) for piece in pieces]
        self.colors = np.concatenate([painted, *around]).astype(np.float32)

    def place(self, joints, rotation, scale):
        """Place (T, 3) of the head's origin and its axes (T, 3, 3), columns left, up, forward."""
        neck, top = joints["neck"], joints["head_top"]
        if rotation is not None:
            axes = Rotation.from_rotvec(rotation).as_matrix().astype(np.float32)
        else:
            up = unit(top - neck)
            forward = unit(np.cross(joints["left_shoulder"] - joints["right_shoulder"], up))
            axes = np.stack([np.cross(up, forward), up, forward], -1)
        size = HEIGHT * scale
        length = np.maximum(np.median(np.linalg.norm(top - neck, axis=-1)), 1.1 * size)
        return neck + unit(top - neck) * (length - size / 2) + axes[..., 2] * (0.10 * size), axes

    def shape(self, frames, expression=None):
        """Points (T, V, 3) metres in the head's own frame."""
        if expression is None:
            return np.repeat(self.mean[None], frames, 0)
        expression = np.asarray(expression, np.float32)
        expression = np.clip(expression, *LIMITS) if self.bounded else expression
        return self.mean + (expression @ self.basis).reshape(len(expression), -1, 3)

    def pose(self, center, axes, scale, expression=None):
        """Points and normals, each (T, V, 3), of the head at `center` (T, 3) with `axes` (T, 3, 3)."""
        shape = self.shape(len(center), expression)
        turn = np.swapaxes(axes, 1, 2).astype(np.float32)
        points = shape @ (turn * np.float32(scale)) + center[:, None].astype(np.float32)
        return points, vertex_normals(points, self.triangles)


def _aligned(face):
    """The face with its eyes where the embedded model's are, and teeth that show below the lip."""
    model, mean = embedded(), face.mean.copy()
    if (face.landmarks[CORNERS] >= 0).all():
        mean += model.mean[model.landmarks[CORNERS]].mean(0) - face.mean[face.landmarks[CORNERS]].mean(0)
    if "skin" in face.regions:
        mean = _smoothed(face, mean)
    if "upper_teeth" in face.regions:
        teeth = face.regions["upper_teeth"]
        mean[teeth] *= [0.8, 1, 1]
        mean[teeth[mean[teeth, 1] < mean[teeth, 1].mean()], 1] -= 0.005
    return replace(face, mean=mean)


def _smoothed(face, mean, near=0.016, rounds=8):
    """The skin with its fold below the jaw rounded off; its edge stays where it is."""
    count, jaw = len(mean), mean[face.landmarks[JAW]]
    edges = np.concatenate([face.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    both = coo_array((np.ones(2 * len(edges)), np.concatenate([edges, edges[:, ::-1]]).T), (count, count)).tocsr()
    rim = np.asarray((both == 1).sum(1)).ravel() > 0  # an inner edge belongs to two triangles
    gap = np.linalg.norm(mean[:, None] - jaw, axis=-1).min(1)
    chosen = np.isin(np.arange(count), face.regions["skin"]) & ~rim & (gap < near)
    share = np.clip(2 - 2 * gap / near, 0, 0.7)[chosen, None]
    mean = mean.copy()
    for _ in range(rounds):
        around = (both @ mean) / np.maximum(both.sum(1), 1)[:, None]
        mean[chosen] += share * (around[chosen] - mean[chosen])
    return mean


def _moved(piece, basis):
    """(n, 3, E): how a piece moves with the face."""
    if piece.weights is None:
        return np.zeros((*piece.points.shape, basis.shape[-1]))
    return np.tensordot(piece.weights, basis[piece.ids], 1)


def _shown(face):
    """(F, 3) triangles of the face, all facing outwards, without those below the bands of the lips."""
    triangles = face.triangles.copy()
    mouth = np.zeros(len(triangles), bool)
    for name, axis in IN_MOUTH.items():
        part = np.isin(triangles, face.regions.get(name, [])).all(1)
        a, b, c = face.mean[triangles[part]].transpose(1, 0, 2)
        if np.cross(b - a, c - a)[:, axis].sum() < 0:
            triangles[part] = triangles[part][:, ::-1]
        mouth |= part
    if (face.landmarks < 0).any():
        return triangles
    outline = face.mean[face.landmarks[OUTER_LIPS]]
    wider = (face.mean - outline.mean(0)) * 1.04 + outline.mean(0)
    hidden = inside(wider[:, :2], outline[:, :2]) & (face.mean[:, 2] > outline[:, 2].min() - 0.006)
    return triangles[mouth | ~hidden[triangles].all(1)]


def _painted(face, triangles, skin):
    """(F, 3) colours of the face's triangles by the regions that all their vertices lie in."""
    colors = np.tile(np.array(skin, float), (len(triangles), 1))
    regions = dict(face.regions) | {"lips": face.lips}
    if (face.landmarks >= 0).all():
        del regions["lips"]  # they are drawn as bands
    for name, vertices in regions.items():
        if name in COLORS:
            colors[np.isin(triangles, vertices).all(1)] = COLORS[name]
    for iris, eye in zip(face.irises, ("right_eye", "left_eye"), strict=False):
        ball = np.isin(triangles, face.regions.get(eye, [])).all(1)
        away = np.linalg.norm(face.mean[triangles] - face.mean[iris], axis=-1).max(1)
        for limit, name in ((np.inf, "white"), (IRIS, "iris"), (PUPIL, "pupil")):
            colors[ball & (away < limit)] = COLORS[name]
    return colors
