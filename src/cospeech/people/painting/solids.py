"""Collects the solids of N figures at once, as the rows that `raster.trace` paints."""

import numpy as np

from cospeech.people.painting import raster

PARTS = (
    "nothing",
    "trunk",
    "neck",
    "head",
    "hair",
    "right_upper_arm",
    "right_forearm",
    "right_hand",
    "left_upper_arm",
    "left_forearm",
    "left_hand",
    "right_thigh",
    "right_shank",
    "right_foot",
    "left_thigh",
    "left_shank",
    "left_foot",
)
CODE = {name: i for i, name in enumerate(PARTS)}  # of the person; things and other people follow
THING, BYSTANDER = 100, 200


class Solids:
    """Rows of N figures: calls add solids to each; `rows()` gives (N, P, raster.COLUMNS).

    Points (N, 3) metres in the camera's axes; radii and colours (0 to 1) one for all or one each. A radius of 0 or less
    leaves a solid out.
    """

    def __init__(self, count):
        self.count, self._rows = count, []

    def rows(self):
        return np.concatenate(self._rows, axis=1)

    def _new(self, kind, part, color, color2=None, pattern=0, period=0.1):
        row = np.zeros((self.count, raster.COLUMNS))
        row[:, raster.KIND], row[:, raster.PART] = kind, CODE.get(part, part) if isinstance(part, str) else part
        row[:, raster.COLOR] = color
        row[:, raster.COLOR2] = color if color2 is None else color2
        row[:, raster.PLANE] = [0.0, 0.0, 0.0, 1.0]
        row[:, raster.PATTERN], row[:, raster.PERIOD] = pattern, period
        self._rows.append(row[:, None])
        return row

    def cone(self, start, end, radius, radius2, color, part, *, axes=None, plane=None, hole=False, **material):
        """The hull of two spheres, or of two ellipsoids: q = axes (p - start), axes (N, 3, 3), in which radii are.

        plane (n (3,) or (N, 3), d) in q: beyond it the second colour, or nothing where `hole`.
        """
        row = self._new(raster.CONE, part, color, **material)
        row[:, raster.ORIGIN] = start
        way = end - start
        if axes is None:
            row[:, raster.AXES] = np.eye(3).ravel()
        else:
            row[:, raster.AXES] = axes.reshape(-1, 9)
            way = np.einsum("nij,nj->ni", axes, np.broadcast_to(way, (self.count, 3)))
        row[:, raster.END] = way
        row[:, 15], row[:, 16] = radius, radius2
        if plane is not None:
            row[:, 25:28], row[:, 28], row[:, raster.HOLE] = plane[0], plane[1], hole
        return row

    def ellipsoid(self, center, frame, half, color, part, **material):
        """half (3,) or (N, 3): half axes along the columns of frame (N, 3, 3); in q it is the unit sphere."""
        axes = np.swapaxes(frame, 1, 2) / np.broadcast_to(half, (self.count, 3))[..., None]
        return self.cone(center, center, 1.0, 1.0, color, part, axes=axes, **material)

    def box(self, center, frame, half, color, part, **material):
        """half (3,) or (N, 3): half sides along the columns of frame (N, 3, 3)."""
        row = self._new(raster.BOX, part, color, **material)
        row[:, raster.ORIGIN], row[:, raster.AXES] = center, np.swapaxes(frame, 1, 2).reshape(-1, 9)
        row[:, raster.END] = half
        return row

    def mesh(self, points, normals, triangles, color, part):
        """Triangles (T, 3) between points (N, V, 3), shaded smoothly by their normals (N, V, 3); color (N, 3) or
        (N, T, 3)."""
        rows = np.zeros((self.count, len(triangles), raster.COLUMNS))
        rows[:, :, raster.KIND], rows[:, :, raster.PART] = raster.TRIANGLE, CODE[part]
        color = np.broadcast_to(color, (self.count, 3)) if np.ndim(color) < 3 else color
        rows[:, :, raster.COLOR] = rows[:, :, raster.COLOR2] = color[:, None] if color.ndim == 2 else color
        for i, (corner, normal) in enumerate(raster.CORNERS):
            rows[:, :, corner], rows[:, :, normal] = points[:, triangles[:, i]], normals[:, triangles[:, i]]
        self._rows.append(rows)


def unit(v):
    """Directions of length 1: (..., 3) -> (..., 3)."""
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)
