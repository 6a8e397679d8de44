"""Meshes the figure is built of: tapered capsules, lofted rings, face-plane patches. All posed for T frames at once."""

import numpy as np


def unit(vectors):
    """Vectors (..., 3) scaled to length 1; zero vectors stay zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def grid_triangles(rows, columns, closed=True, start=0):
    """(F, 3) int32 of a rows x columns grid of vertices, row by row; `closed` joins the last column to the first."""
    row, column = np.mgrid[: rows - 1, : columns if closed else columns - 1]
    a, b = row * columns + column, row * columns + (column + 1) % columns
    faces = np.stack([np.stack([a, b, a + columns], -1), np.stack([b, b + columns, a + columns], -1)], 2)
    return (faces.reshape(-1, 3) + start).astype(np.int32)


def capsule_template(segments):
    """Unit directions (n, 3) around the axis z, end (n,) 0 or 1, and triangles of a capsule with `segments` sides."""
    angles = np.arange(segments) * 2 * np.pi / segments
    latitudes = np.radians([-90, -60, -30, 0, 0, 30, 60, 90] if segments > 8 else [-90, -45, 0, 0, 45, 90])
    directions = np.stack(np.broadcast_arrays(
        np.cos(latitudes)[:, None] * np.cos(angles), np.cos(latitudes)[:, None] * np.sin(angles),
        np.sin(latitudes)[:, None],
    ), -1)  # fmt: skip
    end = np.repeat(np.arange(len(latitudes)) >= len(latitudes) / 2, segments).astype(np.float32)
    return directions.reshape(-1, 3).astype(np.float32), end, grid_triangles(len(latitudes), segments)


def capsules(starts, ends, start_radii, end_radii, template):
    """Points and normals, each (T, P * n, 3), of P capsules between starts and ends (T, P, 3), radii (P,) metres."""
    directions, end, _ = template
    axis = unit(ends - starts)
    helper = np.where(np.abs(axis[..., 2:]) < 0.9, np.float32([0, 0, 1]), np.float32([1, 0, 0]))
    across = unit(np.cross(helper, axis))
    frame = np.stack([across, np.cross(axis, across), axis], -2)  # rows: the capsule's own x, y, z
    normals = directions @ frame
    radii = np.asarray(start_radii)[:, None] * (1 - end) + np.asarray(end_radii)[:, None] * end
    centers = starts[:, :, None] + (ends - starts)[:, :, None] * end[:, None]
    points = centers + normals * radii[..., None]
    return points.reshape(len(points), -1, 3), normals.reshape(len(points), -1, 3)


def rings(centers, left, forward, widths, depths, segments, power=2.4):
    """Points and normals, each (T, R * segments, 3), of R superelliptic rings stacked from below upwards.

    centers, left, forward (T, R, 3); widths, depths (R,) half axes in metres. The seam lies at the back.
    """
    angles = -np.pi / 2 - np.arange(segments) * 2 * np.pi / segments
    cosine, sine = np.cos(angles), np.sin(angles)
    bulge = (np.abs(cosine) ** power + np.abs(sine) ** power) ** (-1 / power)
    across = np.asarray(widths)[:, None] * (bulge * cosine)
    along = np.asarray(depths)[:, None] * (bulge * sine)
    points = centers[:, :, None] + left[:, :, None] * across[..., None] + forward[:, :, None] * along[..., None]
    around = np.roll(points, -1, 2) - np.roll(points, 1, 2)
    normals = unit(np.cross(around, np.gradient(points, axis=1)))
    return points.reshape(len(points), -1, 3), normals.reshape(len(points), -1, 3)


def strip_triangles(count, start=0):
    """Triangles of a band between two lines of `count` points, the first line above, both from right to left.

    Right to left means from the character's right to its left: towards +x.
    """
    return grid_triangles(2, count, closed=False, start=start)[:, ::-1].copy()


def fan_triangles(count, start=0):
    """Triangles of a polygon whose centre comes first, at `start`, then `count` outline points, clockwise."""
    around = np.arange(count)
    return (np.stack([np.zeros(count, int), (around + 1) % count + 1, around + 1], -1) + start).astype(np.int32)
