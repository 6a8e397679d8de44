"""What a face model leaves out of a head: skull, hair, ears, throat, and the drawn lines of brows, lashes and mouth.

Metres in the frame of the embedded face model: x to the head's left, y up, z forward, the origin between the ears at
the height of the eyes. A piece stays where it is, or it follows vertices of the face: its points are linear in those.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from cospeech.render.character.mesh import ellipsoid, grid_strips, grid_triangles, vertex_normals

CENTER, POWER = np.array([0.0, 0.020, 0.0]), 2.4
HALF = {"side": 0.0745, "height": 0.098, "front": 0.095, "back": 0.108}  # of the superelliptic skull
# The hairline: degrees from the front, and its height; it goes around the ears.
HAIRLINE = np.array(
    [
        [0, 0.074],
        [28, 0.072],
        [46, 0.062],
        [58, 0.046],
        [67, 0.020],
        [76, -0.008],
        [83, -0.006],
        [88, 0.024],
        [104, 0.024],
        [112, -0.026],
        [132, -0.060],
        [180, -0.066],
    ]
)
HAIR = [(0.0, -0.004), (0.04, 0.0055), (0.3, 0.0085), (1.0, 0.0125)]  # share of the way to the crown, thickness
ABOVE = {"brow": 0.0020, "lash": 0.0008}  # metres that lines stand above the skin
BROWS, LIDS = ((17, 22), (22, 27)), ((36, 40), (42, 46))  # iBUG landmarks, each from the face's right to its left
EYES, NOSTRILS = ((36, 39), (42, 45)), (32, 34)
UPPER_LIP = (range(48, 55), range(60, 65))  # its outer and its inner landmarks, from the face's right to its left
LOWER_LIP = ((48, 59, 58, 57, 56, 55, 54), (60, 67, 66, 65, 64))
# A lip's rows: share of the way from the outer to the inner landmarks, and how far they stand out (metres).
LIP = ((0.0, 0.0008), (0.2, 0.0028), (0.6, 0.0032), (0.9, 0.0020), (1.0, 0.0002), (1.0, -0.006))


@dataclass
class Piece:
    """points (n, 3), triangles (f, 3), what it is; it moves by weights (n, k) with the face's vertices ids (k,)."""

    kind: str
    points: np.ndarray
    triangles: np.ndarray
    weights: np.ndarray | None = None
    ids: np.ndarray | None = None


def around_face(face):
    """[Piece] of a FaceModel; of one that is a whole head already, the drawn lines alone."""
    skin = face.mean[face.regions.get("skin", slice(None))]
    marks = face.landmarks
    pieces = []
    if (marks >= 0).all():
        pieces += [_line("brow", face, marks[slice(*part)], _brow_edges) for part in BROWS]
        pieces += [_line("lash", face, marks[slice(*part)], _lash_edges) for part in LIDS]
        pieces += [_lip(face, *(marks[list(part)] for part in lip), lip is UPPER_LIP) for lip in (UPPER_LIP, LOWER_LIP)]
        pieces += [_nostril(face, marks[[at]]) for at in NOSTRILS]
        mouth = face.mean[marks[list(UPPER_LIP[1])]].mean(0) + np.array([0, -0.010, -0.025])
        pieces.append(_hollow("gullet", (0.029, 0.031, 0.022), mouth))
        eyes = [face.mean[marks[list(corners)]].mean(0) - np.array([0, 0, 0.011]) for corners in EYES]
        pieces += [_hollow("socket", (0.020, 0.016, 0.015), eye) for eye in eyes]
    if skin[:, 2].min() > -0.05:
        pieces += [_cranium(skin), _hair(), _throat(face, skin), *_ears()]
    return pieces


# ------------------------------------------------------------------------------------------------------------- solids


def _onto_skull(angle, latitude, thick=0.0):
    """Points on the skull, or outside by `thick`, at angles from +x towards +z and at latitudes."""
    way = np.stack(
        np.broadcast_arrays(np.cos(latitude) * np.cos(angle), np.sin(latitude), np.cos(latitude) * np.sin(angle)),
        axis=-1,
    )
    deep = np.where(way[..., 2] > 0, HALF["front"], HALF["back"])
    sizes = np.stack(np.broadcast_arrays(HALF["side"], HALF["height"], deep), axis=-1)
    radius = (np.abs(way / sizes) ** POWER).sum(-1) ** (-1 / POWER)
    return CENTER + way * (radius + thick)[..., None]


def _grid_angles(columns):
    return -np.pi / 2 - np.arange(columns) * 2 * np.pi / columns  # the seam lies at the back


def _cranium(skin, rows=17, columns=32):
    """The skull where there is no face: behind it, and above its upper edge."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rows)[:, None]
    points = _onto_skull(_grid_angles(columns), latitude).reshape(-1, 3)
    turn, of = np.arctan2(points[:, 0], points[:, 2]), np.arctan2(skin[:, 0], skin[:, 2])
    top = np.array([skin[np.abs(of - a) < 0.15, 1].max(initial=-1.0) for a in turn])
    behind = (points[:, 2] < np.where(points[:, 1] < 0, 0.030, 0.015)) | (points[:, 1] > top - 0.012)
    triangles = grid_triangles(rows, columns)
    return Piece("skin", points, triangles[behind[triangles].all(1)])


def _hair(columns=48):
    """A cap from the hairline to the crown, thin at its edge."""
    angle = _grid_angles(columns)
    from_front = np.degrees(np.abs(np.arctan2(np.cos(angle), np.sin(angle))))
    line = np.interp(from_front, *HAIRLINE.T)
    steps = np.linspace(-1.4, np.pi / 2, 200)[:, None]
    heights = _onto_skull(angle, steps)[..., 1]
    low = np.array([np.interp(y, column, steps[:, 0]) for y, column in zip(line, heights.T, strict=True)])
    share = np.array([0, 0.03, 0.08, 0.16, 0.26, 0.36, 0.46, 0.56, 0.66, 0.76, 0.85, 0.93, 1.0])[:, None]
    points = _onto_skull(angle, low + (np.pi / 2 - low) * share, np.interp(share, *np.transpose(HAIR)))
    return Piece("hair", points.reshape(-1, 3), grid_triangles(len(share), columns))


def _throat(face, skin, columns=25):
    """From the lower edge of the face, ear to ear below the jaw, inwards into the neck."""
    of = np.arctan2(skin[:, 0], skin[:, 2])
    turn = np.linspace(-1.5, 1.5, columns)
    chosen = [np.flatnonzero(np.abs(of - a) < 0.08) for a in turn]
    chosen = np.array([near[skin[near, 1].argmin()] for near in chosen if len(near)])
    edge, turn = skin[chosen], of[chosen]
    neck = np.stack([0.040 * np.sin(1.3 * turn), np.full(len(turn), -0.062), -0.022 + 0.040 * np.cos(1.3 * turn)], 1)
    share = np.array([0, 0.35, 0.7, 1.0])[:, None, None]
    points = edge + (neck - edge) * share
    points[1:3, :, 1] -= 0.004
    weights = (np.eye(len(edge)) * (1 - share)).reshape(-1, len(edge))
    ids = np.arange(len(face.mean))[face.regions.get("skin", slice(None))][chosen]
    return Piece("throat", points.reshape(-1, 3), grid_strips(4, len(edge)), weights, ids)


def _ears():
    for side in (1, -1):
        points, triangles = ellipsoid((0.007, 0.031, 0.019), rows=9, columns=12)
        tilt = np.array([[1, 0.12 * side, -0.45 * side], [0, 1, -0.2], [0.25 * side, 0.2, 1]])
        points = points @ tilt.T + [side * 0.0765, -0.014, -0.010]
        yield Piece("skin", points, triangles)


# -------------------------------------------------------------------------------------------------------------- lines


def _along(face, ids, count):
    """(count, len(ids)) weights of points evenly along a smooth curve through the vertices `ids`."""
    steps = np.linalg.norm(np.diff(face.mean[ids], axis=0), axis=1)
    place = np.concatenate([[0], np.cumsum(steps)]) / max(steps.sum(), 1e-9)
    return CubicSpline(place, np.eye(len(ids)), bc_type="natural")(np.linspace(0, 1, count))


def _line(kind, face, ids, edges, count=11):
    """A band along landmarks `ids`; `edges` gives its upper and lower edge from the share of the way outwards."""
    weights = _along(face, ids, count)
    points = face.mean[None].astype(np.float32)
    middle = weights @ (face.mean + ABOVE[kind] * vertex_normals(points, face.triangles)[0])[ids]
    along = np.linspace(0, 1, count)
    outwards = along if middle[0, 0] > 0 else 1 - along
    points = np.concatenate([middle + edge for edge in edges(outwards)])
    return Piece(kind, points, grid_strips(2, count), np.tile(weights, (2, 1)), ids)


def _brow_edges(outwards):
    thick = 0.0030 * np.sqrt(np.clip(1.15 - outwards, 0, 1)) * np.clip(8 * outwards + 0.55, 0, 1)
    return (np.stack([0 * outwards, sign * thick, -0.0004 * sign + 0 * outwards], 1) for sign in (1, -1))


def _lash_edges(outwards):
    thick = 0.0022 * np.clip(np.minimum(outwards, 1.2 - outwards) * 6, 0.25, 1)
    return (
        np.stack([0.0015 * (outwards - 0.5), edge, 0.0010 * np.ones_like(edge)], 1)
        for edge in (thick, -0.0004 * np.ones_like(thick))
    )


def _lip(face, outer, inner, upper, count=17):
    """A lip as a bulging band from its outer to its inner landmarks, and on into the mouth."""
    ends = _along(face, outer, count), _along(face, inner, count)
    weights = np.concatenate([np.concatenate([(1 - share) * ends[0], share * ends[1]], 1) for share, _ in LIP])
    ids = np.concatenate([outer, inner])
    taper = np.sqrt(np.clip(1 - np.linspace(-1, 1, count) ** 8, 0, 1))
    points = weights @ face.mean[ids]
    points[:, 2] += np.concatenate([np.where(forward > 0, 0.25 + 0.75 * taper, 1) * forward for _, forward in LIP])
    points[-count:, 1] += -0.0008 if upper else 0.0008  # closed lips touch each other behind
    triangles = grid_strips(len(LIP), count)
    return Piece("lips", points, triangles if upper else triangles[:, ::-1].copy(), weights, ids)


def _hollow(kind, half, place):
    """What is seen of the inside through a mouth or beside an eyeball."""
    points, triangles = ellipsoid(half, rows=9, columns=14)
    return Piece(kind, points + place, triangles[:, ::-1].copy())


def _nostril(face, ids):
    points, triangles = _disc(0.0030, 0.0014)
    return Piece("nostril", points + face.mean[ids] + [0, 0.0014, 0.0016], triangles, np.ones((len(points), 1)), ids)


def _disc(width, height, count=16):
    """Points and triangles of a flat ellipse that looks forward, its middle first."""
    around = np.arange(count)
    angle = -around * 2 * np.pi / count
    rim = np.stack([width * np.cos(angle), height * np.sin(angle), np.zeros(count)], 1)
    triangles = np.stack([np.zeros(count, int), (around + 1) % count + 1, around + 1], 1)
    return np.concatenate([np.zeros((1, 3)), rim]), triangles
