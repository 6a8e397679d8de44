"""The embedded face model's bases: the movements of `data/face.yaml` as displacements of every vertex."""

import numpy as np

from cospeech.face.shape import eye_center

MOUTH, CORNER = -66.0, 26.0  # mm: height of the line between the lips, and where it ends
LID = 9.0  # mm around an eye that move with its lids


class Masks:
    """Which vertices a movement takes along, and how much: calling it with a mask's name gives (V,) weights."""

    def __init__(self, face, points):
        self.points = points
        self.skin = np.zeros(len(points))
        self.skin[face.regions["skin"]] = 1.0
        self.lower = self.skin * self._below_mouth(face)
        self.regions = face.regions
        self.lids = {name: self._lid(face, name) for name in ("upper_lid", "lower_lid")}
        self.below = np.maximum(self.lower, np.isin(np.arange(len(points)), face.regions["lower_teeth"]))

    def __call__(self, name, side=1):
        """Weights (V,) of a mask; `side` chooses the eye of `eye` and `eye_shift`: 1 left, -1 right."""
        if name in ("eye", "eye_shift"):
            return self._only("left_eye" if side > 0 else "right_eye")
        if name == "tongue":
            return self._only("tongue")
        if name == "stretch":
            return np.ones(len(self.points))
        if name == "jaw":
            forward = np.clip(self.points[:, 2] / 80, 0, 1.1)
            return np.maximum(self.below, 0.8 * self._only("tongue")) * forward
        return {"skin": self.skin, "lower": self.lower, "upper": self.skin - self.lower, **self.lids}[name]

    def _only(self, region):
        weights = np.zeros(len(self.points))
        weights[self.regions[region]] = 1.0
        return weights

    def _below_mouth(self, face):
        """1 below the line between the lips, 0 above it; the further beside the mouth, the softer the change."""
        x, y = self.points[:, 0], self.points[:, 1]
        soft = 2.0 + 0.7 * np.clip(np.abs(x) - 18, 0, None)
        weights = 1 / (1 + np.exp(np.clip((y - MOUTH) / soft, -50, 50)))
        corner = 0.5 * np.clip(np.abs(x) / CORNER, 0, 1) ** 6
        for lip, value in (("upper_lip", corner), ("lower_lip", 1 - corner)):
            for stroke in (s for s in face.strokes if s.startswith(lip)):
                weights[face.strokes[stroke]] = value[face.strokes[stroke]]
        return weights

    def _lid(self, face, name):
        """The lid's edge, and the skin behind it, less the further away; the corners of the eye stay."""
        weights = np.zeros(len(self.points))
        sign = 1 if name == "upper_lid" else -1
        for side in ("left", "right"):
            edge = face.strokes[f"{side}_{name}"]
            edge = edge[1:-1] if name == "upper_lid" else edge
            gap = self.points[:, None, :2] - self.points[edge][None, :, :2]
            nearest = np.argmin((gap**2).sum(axis=-1), axis=1)
            gap = gap[np.arange(len(gap)), nearest]
            outside = sign * gap[:, 1] >= -1e-6
            weights = np.maximum(weights, self.skin * outside * np.clip(1 - np.hypot(*gap.T) / LID, 0, 1))
            weights[edge] = 1.0
        return weights


def bases(face, points, numbers, expressions):
    """Identity (V, 3, I) and expression (V, 3, E) displacements in millimetres of `points` (V, 3)."""
    masks = Masks(face, points)
    identity = [_both_sides(entry, masks, numbers) for entry in numbers["identity"].values()]
    return np.stack(identity, axis=-1), np.stack([_expression(name, masks, numbers) for name in expressions], axis=-1)


def _expression(name, masks, numbers):
    """One component; of a movement that the table has for the left only, the right one is its mirror image."""
    table = numbers["expressions"]
    left = name.removesuffix("_right") + "_left" if name.endswith("_right") else name
    if not left.endswith("_left") or left.replace("_left", "_right") in table:
        return _both_sides(table[name], masks, numbers)
    return sum(_term(term, masks, numbers, 1 if name == left else -1) for term in table[left])


def _both_sides(entry, masks, numbers):
    return sum(_term(term, masks, numbers, side) for term in entry for side in ((1, -1) if term[1] else (1,)))


def _term(term, masks, numbers, side):
    """(V, 3) displacement of one movement; `side` -1 mirrors it."""
    mask, x, y, sx, sy, *move = term
    points, weights = masks.points, masks(mask, side)
    away = [((points[:, i] - c) / s) ** 2 for i, c, s in ((0, side * x, sx), (1, y, sy)) if s]
    weights = weights * np.exp(-0.5 * sum(away)) if away else weights
    if mask == "stretch":
        return weights[:, None] * points * np.array(move) / 1000
    if mask == "eye":
        spin = np.radians(np.array(move, float) * [1, side, side])
        return weights[:, None] * np.cross(spin, points - eye_center(side, numbers))
    return weights[:, None] * np.array(move, float) * [side, 1, 1]
