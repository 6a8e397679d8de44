"""Meshes the figure is built of: tapered capsules, lofted rings, ellipsoids. All posed for T frames at once."""

import numba
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
    directions = np.stack(
        np.broadcast_arrays(
            np.cos(latitudes)[:, None] * np.cos(angles),
            np.cos(latitudes)[:, None] * np.sin(angles),
            np.sin(latitudes)[:, None],
        ),
        -1,
    )
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


def grid_strips(rows, columns):
    """Triangles of bands between lines of points, the first line above, each from the character's right to its left."""
    return grid_triangles(rows, columns, closed=False)[:, ::-1].copy()


def ellipsoid(half, rows, columns):
    """Points (rows * columns, 3) about the origin, with half axes (3,), and triangles."""
    latitude = np.linspace(-0.5, 0.5, rows)[:, None] * np.pi
    angle = -np.arange(columns) * 2 * np.pi / columns
    directions = np.stack(
        np.broadcast_arrays(np.cos(latitude) * np.cos(angle), np.sin(latitude), np.cos(latitude) * np.sin(angle)), -1
    )
    return directions.reshape(-1, 3) * half, grid_triangles(rows, columns)


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def vertex_normals(points, triangles):
    """Unit normals (T, V, 3) float32 of meshes (T, V, 3): the sums of those of the triangles around, by their area."""
    normals = np.zeros(points.shape, np.float32)
    for t in range(points.shape[0]):
        p, n = points[t], normals[t]
        for f in range(triangles.shape[0]):
            a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
            ux, uy, uz = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
            vx, vy, vz = p[c, 0] - p[a, 0], p[c, 1] - p[a, 1], p[c, 2] - p[a, 2]
            x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            for v in (a, b, c):
                n[v, 0] += x
                n[v, 1] += y
                n[v, 2] += z
        for v in range(n.shape[0]):
            length = np.float32(1) / max(np.sqrt(n[v, 0] ** 2 + n[v, 1] ** 2 + n[v, 2] ** 2), np.float32(1e-12))
            n[v, 0] *= length
            n[v, 1] *= length
            n[v, 2] *= length
    return normals
