"""Faces: the 68 landmarks of iBUG and the skin between them, moved by who it is and by coefficients of cospeech64."""

from importlib.resources import files

import numpy as np
from scipy.spatial import Delaunay

from cospeech.face.expressions import COSPEECH64
from cospeech.files import read_yaml

TABLE = read_yaml(files("cospeech.people") / "faces.yaml")
HEIGHT = 0.224  # metres, chin to crown, of the head that the table describes
# Each landmark's counterpart when left and right are swapped.
TWIN = np.array(
    [
        *range(16, -1, -1),
        *range(26, 16, -1),
        *range(27, 31),
        *range(35, 30, -1),
        45,
        44,
        43,
        42,
        47,
        46,
        39,
        38,
        37,
        36,
        41,
        40,
        *range(54, 47, -1),
        *range(59, 54, -1),
        *range(64, 59, -1),
        *range(67, 64, -1),
        *range(81, 94),
        *range(68, 81),
        94,
        95,
        96,
    ]
)


def _neutral():
    points = np.zeros((len(TWIN), 3))
    for half in ("right", "middle"):
        for i, point in TABLE[half].items():
            points[TWIN[i]], points[i] = np.multiply(point, [-1, 1, 1]), point
    return points / 1000


def _moves(entry, mirrored=False):
    """(97, 3) metres that an entry {landmarks: [left, up, forward] mm} moves."""
    moves = np.zeros((len(TWIN), 3))
    for landmarks, move in entry.items():
        chosen = [int(i) for i in landmarks.split()]
        moves[TWIN[chosen] if mirrored else chosen] = np.multiply(move, [-1 if mirrored else 1, 1, 1])
    return moves / 1000


def _basis():
    basis = np.zeros((len(COSPEECH64), len(TWIN), 3))
    for name, entry in TABLE["expressions"].items():
        for side in ("right", "left") if name.endswith("_side") else ("",):
            basis[COSPEECH64.index(name.replace("_side", f"_{side}"))] = _moves(entry, side == "left")
    return basis


NEUTRAL, BASIS = _neutral(), _basis()
IDENTITY = np.stack([_moves(entry) for entry in TABLE["identity"]])


def _triangles():
    """(T, 3) corners of the skin's triangles, all turned the same way, and those of its border, (97,) bool."""
    triangles = Delaunay(NEUTRAL[:, :2]).simplices
    a, b, c = np.moveaxis(NEUTRAL[triangles], 1, 0)
    turned = np.cross(b - a, c - a)[:, 2] < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return triangles, np.isin(np.arange(len(TWIN)), [*range(17), 68, 69, 70, 71, 81, 82, 83, 84, 94])


TRIANGLES, BORDER = _triangles()


def normals(points):
    """Directions (N, 97, 3) out of the skin at its points (N, 97, 3), the head's axes; at its border they lean back."""
    a, b, c = (points[:, TRIANGLES[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    total = np.zeros_like(points)
    for i in range(3):
        np.add.at(total, (slice(None), TRIANGLES[:, i]), across)
    total /= np.linalg.norm(total, axis=2, keepdims=True)
    back = points - [0.0, 0.0, 0.01]
    total += np.where(BORDER, 1.5, 0.25)[:, None] * back / np.linalg.norm(back, axis=2, keepdims=True)
    return total / np.linalg.norm(total, axis=2, keepdims=True)


def skin(face, expression):
    """(N, 97, 3) metres, the first 68 the landmarks, in the head's axes from the skull's centre, of a head of HEIGHT.

    face (N, 8) deviations of `identity` in faces.yaml; expression (N, 64) coefficients of cospeech64, 0 to 1.
    """
    return NEUTRAL + np.einsum("ni,ilx->nlx", face, IDENTITY) + np.einsum("ne,elx->nlx", expression, BASIS)


def gaze(expression):
    """(N, 2, 2): how far the right and the left eye look to the person's left and up, -1 to 1."""
    value = lambda name: expression[:, COSPEECH64.index(name)]
    gazes = []
    for side, sign in (("right", -1), ("left", 1)):
        aside = sign * (value(f"eye_look_out_{side}") - value(f"eye_look_in_{side}"))
        gazes.append(np.stack([aside, value(f"eye_look_up_{side}") - value(f"eye_look_down_{side}")], axis=1))
    return np.clip(np.stack(gazes, axis=1), -1, 1)


def draw_expression(dice):
    """Coefficients (N, 64) of people who talk, smile, frown, look about and blink."""
    weights = np.zeros((len(dice), len(COSPEECH64)))
    put = lambda value, *names: weights.__setitem__(
        (slice(None), [COSPEECH64.index(n) for n in names]), np.reshape(value, (len(dice), -1))
    )
    sides = lambda name: (f"{name}_right", f"{name}_left")
    shape = dice.choice([3, 2, 2, 1.2, 1.2, 1.5])  # closed, talking open, wide open or ee, pucker, funnel, closed smile
    put(
        np.select([shape == 0, shape == 1, shape == 2], [0.03, dice.uniform(0.1, 0.55), dice.uniform(0.2, 0.9)], 0.15)
        * dice.uniform(0.3, 1.0),
        "jaw_open",
    )
    put((shape == 3) * dice.uniform(0.4, 1), "mouth_pucker")
    put((shape == 4) * dice.uniform(0.4, 1), "mouth_funnel")
    smile = (dice.chance(0.3) | (shape == 5)) * dice.uniform(0.2, 1.0)
    put(smile[:, None] * np.clip(dice.normal(1, 0.15, 2), 0, 1.2), *sides("mouth_smile"))
    put(dice.chance(0.15) * dice.uniform(0.2, 0.9), "mouth_frown_right")
    weights[:, COSPEECH64.index("mouth_frown_left")] = weights[:, COSPEECH64.index("mouth_frown_right")]
    put((dice.chance(0.3) * dice.uniform(0, 0.8))[:, None] * [1, 1], *sides("mouth_stretch"))
    put((dice.chance(0.4) * dice.uniform(0, 0.7))[:, None] * [1, 1], *sides("mouth_upper_up"))
    put((dice.chance(0.4) * dice.uniform(0, 0.7))[:, None] * [1, 1], *sides("mouth_lower_down"))
    put(np.abs(dice.normal(0, 0.25, 1)), "mouth_left")
    raised = dice.chance(0.3) * dice.uniform(0.2, 1.0)
    put(raised[:, None] * [1, 1, 1], "brow_inner_up", *sides("brow_outer_up"))
    put((dice.chance(0.2) * dice.uniform(0.2, 1.0))[:, None] * [1, 1, 1], "brow_furrow", *sides("brow_down"))
    closed = np.where(dice.chance(0.1), dice.uniform(0.6, 1.0), np.clip(dice.normal(0.05, 0.08), 0, 1))
    put(closed[:, None] * [1, 1], *sides("eye_blink"))
    put((0.6 * smile)[:, None] * [1, 1], *sides("eye_squint"))
    aside, up = dice.normal(0, 0.3), dice.normal(0, 0.25)
    put(np.clip(aside, 0, 1)[:, None] * [1, 1], "eye_look_out_left", "eye_look_in_right")
    put(np.clip(-aside, 0, 1)[:, None] * [1, 1], "eye_look_in_left", "eye_look_out_right")
    put(np.clip(up, 0, 1)[:, None] * [1, 1], *sides("eye_look_up"))
    put(np.clip(-up, 0, 1)[:, None] * [1, 1], *sides("eye_look_down"))
    return np.clip(weights, 0, 1)
