"""A head as solids: skull, hair, and a skin between the landmarks that follows every expression."""

import numpy as np

from cospeech.people.faces import HEIGHT, TRIANGLES, normals
from cospeech.people.painting.materials import BALD, BUN, CURLS, LONG, MEDIUM

SKULL, HALF = (0.0, 0.022, -0.010), np.array([0.0745, 0.089, 0.097])  # metres, of a head of HEIGHT
HAIRLINE = (np.array([0.0, -1.0, 0.625]), -0.1)  # through forehead, ears and nape of the unit sphere
LIPS = np.array(
    [
        (48, 49, 60),
        (49, 61, 60),
        (49, 50, 61),
        (50, 62, 61),
        (50, 51, 62),
        (51, 52, 62),
        (52, 63, 62),
        (52, 53, 63),
        (53, 64, 63),
        (53, 54, 64),
        (48, 60, 59),
        (60, 67, 59),
        (67, 58, 59),
        (67, 66, 58),
        (66, 57, 58),
        (66, 56, 57),
        (66, 65, 56),
        (65, 55, 56),
        (65, 64, 55),
        (64, 54, 55),
    ]
)
GAP = np.array([(60, 61, 67), (61, 66, 67), (61, 62, 66), (62, 65, 66), (62, 63, 65), (63, 64, 65)])
WHITES = np.array(
    [(36, 37, 41), (37, 40, 41), (37, 38, 40), (38, 39, 40), (42, 43, 47), (43, 46, 47), (43, 44, 46), (44, 45, 46)]
)
FAN = np.array([(0, i, i + 1) for i in range(1, 9)])
ROUND = np.linspace(0, 2 * np.pi, 10, endpoint=False)
# Where a beard grows: corners of the skin's triangles that lie on jaw, chin and upper lip.
BEARDED = np.isin(np.arange(97), [*range(3, 14), *range(48, 68), 78, 80, 91, 93, 96])


def skull_center(head_top, head, height):
    """(N, 3) where the face's axes start, from the crown (N, 3), the head's axes (N, 3, 3) and its height (N,)."""
    return head_top + np.einsum("nij,j->ni", head, [0.0, -0.5, 0.07]) * height[:, None]


class _Head:
    """Places things given in metres in the axes of a head of HEIGHT."""

    def __init__(self, solids, bodies):
        self.solids, self.frame, self.skin = solids, bodies.head, bodies.skin
        self.center = skull_center(bodies.joint("head_top"), bodies.head, bodies.height)
        self.scale = bodies.height / HEIGHT
        self.left, self.up, self.forward = np.moveaxis(bodies.head, 2, 0)
        self.normals = normals((bodies.skin - self.center[:, None]) @ bodies.head) @ np.swapaxes(bodies.head, 1, 2)

    def shift(self, x, y, z):
        """(N, 3) a step of x, y, z metres, each a number or (N,), along the head's axes."""
        return (self.left.T * x + self.up.T * y + self.forward.T * z).T * self.scale[:, None]

    def at(self, x, y, z):
        return self.center + self.shift(x, y, z)

    def mark(self, i, lift=0.0):
        """(N, 3) point i of the skin, lifted forward by metres."""
        return self.skin[:, i] + self.shift(0, 0, lift)

    def ellipsoid(self, center, half, color, part="head"):
        self.solids.ellipsoid(self.at(*center), self.frame, np.array(half) * self.scale[:, None], color, part)

    def cone(self, start, end, radius, radius2, color, part="head", shown=True):
        first = np.where(shown, radius * self.scale, -1)
        self.solids.cone(start, end, first, radius2 * self.scale, color, part)

    def patch(self, triangles, color, lift):
        """Triangles between points of the skin, lifted off it by metres."""
        points = self.skin + self.normals * (lift * self.scale)[:, None, None]
        self.solids.mesh(points, self.normals, triangles, color, "head")


def add_head(solids, bodies, materials):
    """Add the heads of `Bodies` with `Materials` to `Solids`."""
    head = _Head(solids, bodies)
    _skull(head, materials)
    _hair(head, materials)
    head.patch(WHITES, np.clip(0.30 * materials.skin + 0.64, 0, 1), 0.0010)
    for side, lids in enumerate(((36, 37, 38, 39, 40, 41), (42, 43, 44, 45, 46, 47))):
        _iris(head, materials, lids, bodies.gaze[:, side])
    for brow in (range(17, 21), range(22, 26)):
        for i in brow:
            head.cone(head.mark(i), head.mark(i + 1), 0.0030, 0.0030, 0.8 * materials.hair + 0.1 * materials.skin)
    for a, b in ((36, 37), (37, 38), (38, 39), (42, 43), (43, 44), (44, 45)):
        head.cone(head.mark(a, 0.0005), head.mark(b, 0.0005), 0.0015, 0.0015, materials.hair * 0.4)
    _mouth(head, materials)
    _glasses(head, materials)


def _skull(head, materials):
    """Skull, the inside of the face, skin and ears. What closes the face behind lies within its skin."""
    head.ellipsoid(SKULL, HALF, materials.skin)
    jaw = head.mark(8) + head.shift(0, 0.030, -0.036)
    shadow = np.where(materials.beard[:, None], 0.45 * materials.skin + 0.45 * materials.hair, materials.skin)
    head.cone(head.at(0, -0.012, 0.004), jaw, 0.066, 0.026, materials.skin)
    for i in (4, 12):
        head.cone(head.mark(i) + head.shift(0.022 if i == 4 else -0.022, 0.014, -0.006), jaw, 0.014, 0.024, shadow)
    color = np.repeat(materials.skin[:, None], len(TRIANGLES), 1)
    color[:, BEARDED[TRIANGLES].sum(axis=1) == 3] = shadow[:, None]
    head.patch(TRIANGLES, color, 0.0)
    nose = np.clip(materials.skin * [1.0, 0.95, 0.94], 0, 1)
    head.cone(head.mark(27, -0.0095), head.mark(30, -0.0115), 0.0080, 0.0122, nose)
    for i, aside in ((31, 0.004), (35, -0.004)):
        wing = head.mark(i) + head.shift(aside, 0.004, -0.006)
        head.cone(wing, wing, 0.0080, 0, nose)
        hole = head.mark(32 if i == 31 else 34) + head.shift(0, -0.0005, 0.002)
        head.cone(hole, hole, 0.0026, 0, materials.skin * 0.35)
    for sign in (-1, 1):
        head.ellipsoid((sign * 0.075, -0.002, -0.016), (0.011, 0.031, 0.019), materials.skin * [0.98, 0.92, 0.91])


def _hair(head, materials):
    """A cap down to the hairline, and for some hair that hangs or a bun."""
    hair, style = materials.hair, materials.style
    half = HALF + np.where(style[:, None] == CURLS, 0.022, [0.004, 0.007, 0.006])
    row = head.solids.ellipsoid(
        head.at(*SKULL), head.frame, half * head.scale[:, None], hair, "hair", plane=HAIRLINE, hole=True
    )
    row[style == BALD, 15] = -1
    long = (style == LONG) | (style == MEDIUM)
    low = np.where(style == LONG, -0.20, -0.09)
    end = head.center + head.shift(0, low, -0.055)
    head.cone(head.at(0, 0.015, -0.030), end, 0.082, 0.062, hair, "hair", shown=long)
    for sign in (-1, 1):
        side = end + head.shift(sign * 0.062, 0, 0.03)
        head.cone(head.at(sign * 0.060, 0.04, 0.0), side, 0.026, 0.022, hair, "hair", shown=long)
    bun = head.at(0, 0.075, -0.095)
    head.cone(bun, bun, 0.042, 0, hair, "hair", shown=style == BUN)


def _iris(head, materials, lids, gaze):
    """Iris and pupil of one eye, cut off by its lids (indices of six landmarks)."""
    corners = head.skin[:, lids]
    middle = corners.mean(axis=1)
    height = np.einsum("nki,ni->nk", corners - middle[:, None], head.up) / head.scale[:, None]
    high, low = np.sort(height, axis=1)[:, -2:].mean(axis=1), np.sort(height, axis=1)[:, :2].mean(axis=1)
    lean = np.repeat(head.normals[:, lids].mean(axis=1)[:, None], len(ROUND), 1)
    for radius, color, lift in ((0.0066, materials.iris, 0.0026), (0.0031, materials.iris * 0.12, 0.0034)):
        x = gaze[:, :1] * 0.006 + radius * np.cos(ROUND)
        y = np.clip(gaze[:, 1:] * 0.004 + 0.001 + radius * np.sin(ROUND), low[:, None], high[:, None])
        flat = x[..., None] * head.left[:, None] + y[..., None] * head.up[:, None] + lift * head.forward[:, None]
        points = middle[:, None] + flat * head.scale[:, None, None]
        head.solids.mesh(points, lean, FAN[: len(ROUND) - 2], color, "head")


def _mouth(head, materials):
    head.patch(LIPS, np.clip(materials.lips, 0, 1), 0.0012)
    head.patch(GAP, [0.25, 0.08, 0.08], 0.0016)
    gap = np.linalg.norm(head.skin[:, 62] - head.skin[:, 66], axis=1) / head.scale
    upper = np.stack([head.mark(i, 0.0022) for i in (61, 62, 63)], axis=1)
    lower = upper + head.shift(0, -np.minimum(0.008, 0.5 * gap), 0)[:, None]
    teeth = np.array([(0, 1, 3), (1, 4, 3), (1, 2, 4), (2, 5, 4)])
    lean = np.repeat(head.forward[:, None], 6, 1)
    head.solids.mesh(np.concatenate([upper, lower], axis=1), lean, teeth, [0.93, 0.92, 0.88], "head")


def _glasses(head, materials):
    color, shown = materials.hair * 0.35, materials.glasses
    for corners, sign in (((36, 39), -1), ((42, 45), 1)):
        middle = (head.mark(corners[0], 0.012) + head.mark(corners[1], 0.012)) / 2
        rim = [middle + head.shift(0.025 * np.cos(a), 0.021 * np.sin(a) - 0.002, 0) for a in ROUND]
        for i, point in enumerate(rim):
            head.cone(point, rim[(i + 1) % len(rim)], 0.0017, 0.0017, color, shown=shown)
        outer = rim[0] if sign > 0 else rim[len(rim) // 2]
        head.cone(outer, head.at(sign * 0.077, 0.012, -0.01), 0.0017, 0.0017, color, shown=shown)
    bridge = head.mark(27, 0.010)
    head.cone(bridge + head.shift(0.008, 0, 0), bridge - head.shift(0.008, 0, 0), 0.0017, 0.0017, color, shown=shown)
