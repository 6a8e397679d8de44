"""The embedded face model's mesh and bases, drawn from the few curves and hills of `data/face.yaml`.

A point of the skin is laid out flat by (angle around the head, height), triangulated there with the strokes of the
landmarks, and raised onto the skull with its hills, nose and eye sockets. Millimetres here, metres in the model.
"""

from dataclasses import dataclass, field
from importlib.resources import files

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.spatial import Delaunay

from cospeech.files import read_yaml

RADIUS = 70.0  # mm of the layout's width for one radian around the head
ARC = 13  # vertices of a lid's or a lip's edge
EYEBALL, EYE_BACK = 12.0, 10.5  # radius; its centre lies so far behind the eye's opening
SPARSE, DENSE = 7.0, 4.2  # mm between vertices of the skin, and of its middle
TOP, BELOW_JAW = 95.0, 14.0  # height of the forehead's upper edge; how far the skin goes on below the jaw


@dataclass
class Sketch:
    """A mesh in the making: points (V, 3) mm, triangles (F, 3), {region: indices}, {stroke: indices}."""

    points: list = field(default_factory=list)
    triangles: list = field(default_factory=list)
    regions: dict = field(default_factory=dict)
    strokes: dict = field(default_factory=dict)
    count: int = 0

    def add(self, region, points, triangles):
        """Append one piece; returns the index of its first vertex."""
        first = self.count
        self.regions.setdefault(region, []).extend(range(first, first + len(points)))
        self.points.append(points)
        self.triangles.append(np.asarray(triangles) + first)
        self.count += len(points)
        return first


def table():
    """The numbers of `data/face.yaml`."""
    return read_yaml(files("cospeech.face") / "data" / "face.yaml")


def sketch(numbers):
    """The `Sketch` of the mean face: skin, lips, eyeballs, teeth and tongue."""
    face, strokes, curves = Sketch(), {}, []
    for name, points in _strokes(numbers).items():
        strokes[name] = np.arange(len(points)) + sum(map(len, curves))
        curves.append(points)
    flat = np.concatenate(curves)
    outline = _outline(numbers)
    holes = [np.concatenate([flat[strokes[a]], flat[strokes[b]][::-1]]) for a, b in HOLES]
    flat = np.concatenate([flat, outline, _filling(flat, outline, holes)])
    triangles = Delaunay(flat).simplices
    middle = flat[triangles].mean(axis=1)
    kept = inside(middle, outline) & ~np.any([inside(middle, hole) for hole in holes], axis=0)
    triangles = triangles[kept]
    a, b, c = (flat[triangles[:, i]] for i in range(3))
    across, up = (b - a).T, (c - a).T
    turned = across[0] * up[1] - across[1] * up[0] < 0
    triangles[turned] = triangles[turned][:, ::-1]
    face.add("skin", raise_skin(flat, numbers), triangles)
    face.strokes = strokes
    face.regions["lips"] = np.unique(np.concatenate([strokes[name] for name in strokes if "lip_" in name])).tolist()
    _mouth_inside(face)
    for side in (1, -1):
        _eyeball(face, side, numbers)
    return face


HOLES = [
    ("upper_lip_inner", "lower_lip_inner"),
    ("left_upper_lid", "left_lower_lid"),
    ("right_upper_lid", "right_lower_lid"),
]


def raise_skin(flat, numbers):
    """Layout (N, 2) -> points (N, 3) on the skull with its relief; below the jaw's edge the skin turns under it."""
    angle, y = flat[:, 0] / RADIUS, flat[:, 1]
    edge = _jaw(np.degrees(angle), numbers)
    under = np.clip((edge - y) / BELOW_JAW, 0, 1)
    at = np.maximum(y, edge)
    x = np.interp(at, numbers["height"], numbers["half_width"]) * np.sin(angle) * (1 - 0.22 * under)
    z = np.interp(at, numbers["height"], numbers["depth"]) * np.clip(np.cos(angle), 0, 1) ** 0.85
    nose = numbers["nose"]
    rise = _over(nose, "high", at) * np.exp(-0.5 * (x / _over(nose, "wide", at)) ** 2)
    for hx, hy, sx, sy, high in numbers["relief"]:
        for center in {hx, -hx}:
            rise = rise + high * np.exp(-0.5 * (((x - center) / sx) ** 2 + ((at - hy) / sy) ** 2))
    return np.stack([x, at - 5.0 * under, (z + rise) * (1 - 0.30 * under)], axis=1)


def inside(points, polygon):
    """(N,) bool: points (N, 2) inside a polygon (M, 2), by the number of its edges to their right."""
    x, y = points[:, :1], points[:, 1:]
    (ax, ay), (bx, by) = polygon.T, np.roll(polygon, -1, axis=0).T
    crosses = (ay > y) != (by > y)
    across = ax + (y - ay) / np.where(by == ay, 1.0, by - ay) * (bx - ax)
    return (crosses & (across > x)).sum(axis=1) % 2 == 1


def _over(nose, key, y):
    heights = nose["height"][::-1]
    return np.interp(y, heights, nose[key][::-1])


def _jaw(degrees, numbers):
    return np.interp(np.abs(degrees), numbers["jaw_angle"], numbers["jaw_height"])


def _flat(points, numbers):
    """Front view (N, 2) -> layout: x becomes the angle around the head."""
    x, y = np.asarray(points, float).T
    half = np.interp(y, numbers["height"], numbers["half_width"])
    return np.stack([RADIUS * np.arcsin(x / half), y], axis=1)


def _strokes(numbers):
    """{name: (n, 2) layout} of all strokes, from the face's right to its left where they cross it."""
    half = {name: np.array(numbers[name], float) for name in ("brow", "nostrils", "upper_lid", "lower_lid")}
    flip = [-1.0, 1.0]
    strokes = {"jaw": np.stack([np.radians(JAW) * RADIUS, _jaw(JAW, numbers)], axis=1)}
    strokes |= {"bridge": numbers["bridge"]}
    strokes["nostrils"] = np.concatenate([half["nostrils"], half["nostrils"][-2::-1] * flip])
    for name in ("brow", "upper_lid", "lower_lid"):
        curve = half[name] if name == "brow" else _curve(half[name], np.linspace(-46, -17, ARC))
        curve = curve if name != "lower_lid" else curve[1:-1]
        strokes |= {f"right_{name}": curve, f"left_{name}": curve[::-1] * flip}
    for lip in ("upper_lip", "lower_lip"):
        rings = {key: np.array(points, float) for key, points in numbers[lip].items()}
        for key, points in rings.items():
            whole = np.concatenate([points, points[-2::-1] * flip])
            dense = _curve(whole, np.linspace(whole[0, 0], whole[-1, 0], ARC) * 1.0)
            strokes[f"{lip}_{key}"] = dense if lip == "upper_lip" else dense[1:-1]
        halfway = (
            _curve(np.concatenate([rings["outer"], rings["outer"][-2::-1] * flip]), MIDDLE)
            + _curve(np.concatenate([rings["inner"], rings["inner"][-2::-1] * flip]), MIDDLE)
        ) / 2
        strokes[f"{lip}_middle"] = halfway
    return {name: points if name == "jaw" else _flat(points, numbers) for name, points in strokes.items()}


JAW = np.array([-86, -79, -70, -60, -49, -37, -25, -12, 0, 12, 25, 37, 49, 60, 70, 79, 86.0])
MIDDLE = np.linspace(-20, 20, 9)


def _curve(points, at):
    return np.stack([at, PchipInterpolator(*np.asarray(points, float).T)(at)], axis=1)


def _outline(numbers):
    """(M, 2) layout of the skin's edge: down the left side, below the jaw, up the right side, over the forehead."""
    angle = np.linspace(89, -89, 45)
    below = np.stack([np.radians(angle) * RADIUS, _jaw(angle, numbers) - BELOW_JAW], axis=1)
    rise = np.linspace(0.15, 1, 12)
    side = np.stack([np.full(12, below[-1, 0]), below[-1, 1] + (60 - below[-1, 1]) * rise], axis=1)
    over = np.linspace(-85, 85, 33)
    top = np.stack([np.radians(over) * RADIUS, TOP - 30 * (over / 85) ** 2], axis=1)
    return np.concatenate([below, side, top, side[::-1] * [-1, 1]])


def _filling(taken, outline, holes):
    """(n, 2) layout: a triangular grid inside the outline, dense in the middle, clear of holes and what is taken."""
    points = []
    for step, dense in ((SPARSE, False), (DENSE, True)):
        rows = np.arange(-140, 100, step * np.sqrt(3) / 2)
        x, y = np.meshgrid(np.arange(-112, 113, step), rows)
        x = x + step / 2 * (np.arange(len(rows)) % 2)[:, None]
        grid = np.stack([x.ravel(), y.ravel()], axis=1)
        middle = (np.abs(grid[:, 0]) < 58) & (grid[:, 1] < 34) & (grid[:, 1] > -98)
        points.append(grid[middle == dense])
    grid = np.concatenate(points)
    grid = grid[inside(grid, outline) & ~np.any([inside(grid, hole) for hole in holes], axis=0)]
    near = np.concatenate([taken, outline])
    distance = np.min(np.linalg.norm(grid[:, None] - near[None], axis=-1), axis=1)
    return grid[distance > 0.45 * DENSE]


def _mouth_inside(face):
    """Teeth and tongue, behind the lips."""
    x = np.linspace(-19, 19, 9)
    for region, edge in (("upper_teeth", (-58.0, -65.0)), ("lower_teeth", (-74.0, -67.5))):
        rows = [np.stack([x, np.full(9, y), 84 - 0.022 * x**2], axis=1) for y in edge]
        face.add(region, np.concatenate(rows), _grid(2, 9)[:, :: 1 if edge[0] < edge[1] else -1])
    depth = np.linspace(58, 79, 5)
    across = np.linspace(-11, 11, 5)
    tongue = np.stack(np.meshgrid(across, depth), axis=-1).reshape(-1, 2)
    arch = -69.5 - 0.012 * tongue[:, 0] ** 2 - 0.01 * (tongue[:, 1] - 68) ** 2
    face.add("tongue", np.stack([tongue[:, 0], arch, tongue[:, 1]], axis=1), _grid(5, 5)[:, ::-1])


def eye_center(side, numbers):
    """(3,) mm: centre of the left (side 1) or right (-1) eyeball."""
    lids = np.array([*numbers["upper_lid"], *numbers["lower_lid"]], float)
    x, y = -side * lids[:, 0].mean(), lids[:, 1].mean()
    front = raise_skin(_flat([[x, y]], numbers), numbers)[0, 2]
    return np.array([x, y, front - EYE_BACK])


def _eyeball(face, side, numbers):
    """The front of an eyeball: its first vertex is the middle of the iris; rings of 14 around it."""
    name, rings, around = ("left" if side > 0 else "right"), np.radians([14, 27, 45, 65, 85]), 14
    angle = np.arange(around) * 2 * np.pi / around
    ring = np.stack(
        np.broadcast_arrays(
            np.sin(rings)[:, None] * np.cos(angle), np.sin(rings)[:, None] * np.sin(angle), np.cos(rings)[:, None]
        ),
        axis=-1,
    ).reshape(-1, 3)
    points = np.concatenate([[[0.0, 0.0, 1.0]], ring]) * EYEBALL + eye_center(side, numbers)
    fan = [[0, i + 1, (i + 1) % around + 1] for i in range(around)]
    first = face.add(f"{name}_eye", points, [*fan, *(_grid(len(rings), around, closed=True) + 1)])
    face.strokes[f"{name}_iris"] = np.array([first])


def _grid(rows, columns, closed=False):
    """(F, 3) triangles of a grid of vertices, row by row; `closed` joins the last column to the first."""
    row, column = np.mgrid[: rows - 1, : columns if closed else columns - 1]
    a, b = row * columns + column, row * columns + (column + 1) % columns
    return np.concatenate(
        [np.stack(t, -1).reshape(-1, 3) for t in ((a, a + columns, b), (b, a + columns, b + columns))]
    )
