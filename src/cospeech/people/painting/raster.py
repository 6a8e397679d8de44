"""The painter: solids traced ray by ray through a pinhole camera into picture, depth and parts, compiled by numba.

A solid is a row of numbers (`Solid`): a sphere, a round cone (the hull of two spheres), a box or a triangle. Solids may
be stretched: they are round in their own axes, q = axes (p - origin), and what their hits cover is decided in camera
depth. So arms cross in front of trunks, desks hide laps and fingers hide faces without any order of painting.
"""

import numpy as np
from numba import njit

CONE, BOX, TRIANGLE = 0, 1, 2
PLAIN, BANDS, PINSTRIPES, CHECKS, PATCHES, OPENING = range(6)  # patterns of the second color
FAR = 1e9

# Columns of a solid. ORIGIN and AXES lead from the camera's axes to the solid's own; END is the cone's second center,
# the box's half sides. CORNERS are those of a triangle, each with its normal.
ORIGIN, AXES, END, RADIUS = slice(0, 3), slice(3, 12), slice(12, 15), slice(15, 17)
KIND, PART = 17, 18
COLOR, COLOR2 = slice(19, 22), slice(22, 25)  # RGB, 0 to 1
PLANE = slice(25, 29)  # (n, d): where n.q > d the second color begins
HOLE = 29  # 1: beyond the plane there is nothing at all
PATTERN, PERIOD = 30, 31  # metres
COLUMNS = 32
CORNERS = ((slice(0, 3), slice(6, 9)), (slice(3, 6), slice(9, 12)), (slice(12, 15), slice(25, 28)))
NEAR = 0.05  # metres from the camera; what is nearer is not drawn


@njit(cache=True)
def _inverse(m, out):
    """Inverse of the 3 x 3 matrix m[0:9] into out (3, 3)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            out[a, i] = m[3 * j + b] * m[3 * k + c] - m[3 * j + c] * m[3 * k + b]
    det = m[0] * out[0, 0] + m[1] * out[1, 0] + m[2] * out[2, 0]
    out /= det


@njit(cache=True)
def _bound(s, inverse, low, high):
    """Box low (3,), high (3,) in the camera's axes around the solid s; False for a solid without size."""
    kind = int(s[17])
    if kind == 2:
        for i in range(3):
            low[i], high[i] = min(s[i], s[3 + i], s[12 + i]), max(s[i], s[3 + i], s[12 + i])
        return high[2] > NEAR
    if (kind == 0 and s[15] <= 0.0) or (kind == 1 and min(s[12], s[13], s[14]) <= 0.0):
        return False
    _inverse(s[3:12], inverse)
    for i in range(3):
        x, y, z = inverse[i]
        if kind == 1:
            reach = abs(x * s[12]) + abs(y * s[13]) + abs(z * s[14])
            low[i], high[i] = s[i] - reach, s[i] + reach
        else:  # a unit ball of the solid's axes reaches as far as its row of the inverse is long
            reach, way = np.sqrt(x * x + y * y + z * z), x * s[12] + y * s[13] + z * s[14]
            low[i] = s[i] + min(-reach * s[15], way - reach * s[16])
            high[i] = s[i] + max(reach * s[15], way + reach * s[16])
    return high[2] > NEAR


@njit(cache=True)
def _window(low, high, camera, shape):
    """First and last + 1 column and row of the pixels whose rays can meet the box."""
    window = (0, 0, 0, 0)
    near, far = max(low[2], NEAR), high[2]
    u0 = np.floor(camera[0] * min(low[0] / near, low[0] / far) + camera[2])
    u1 = np.ceil(camera[0] * max(high[0] / near, high[0] / far) + camera[2])
    v0 = np.floor(camera[1] * min(low[1] / near, low[1] / far) + camera[3])
    v1 = np.ceil(camera[1] * max(high[1] / near, high[1] / far) + camera[3])
    if u1 >= 0 and v1 >= 0 and u0 < shape[1] and v0 < shape[0]:
        window = (int(max(u0, 0)), int(min(u1 + 1, shape[1])), int(max(v0, 0)), int(min(v1 + 1, shape[0])))
    return window


@njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _times(m, v):
    """The rows m (9 numbers) times v."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@njit(cache=True)
def _root(a, b, c, after):
    """The smallest root of a t^2 + 2 b t + c beyond `after`; FAR where there is none."""
    h = b * b - a * c
    if h < 0.0 or a == 0.0:
        return FAR
    h = np.sqrt(h)
    one, two = (-b - h) / a, (-b + h) / a
    if one > two:
        one, two = two, one
    return one if one > after else (two if two > after else FAR)


@njit(cache=True)
def _cone(o, d, b, ra, rb):
    """First hit t of the ray o + t d with the round cone from 0 to b, and where on its axis (0 to 1) that belongs to.

    Its side is where |q|^2 - ra^2 = (q.b - ra (ra - rb))^2 / (|b|^2 - (ra - rb)^2), the envelope of the spheres between
    its ends; the end spheres close it, and lie wholly within the endless cone.
    """
    dd, od, oo = _dot(d, d), _dot(o, d), _dot(o, o)
    bb, ob, db = _dot(b, b), _dot(o, b), _dot(d, b)
    e, y = bb - (ra - rb) ** 2, ob - ra * (ra - rb)
    t, at = FAR, 0.0
    if e > 1e-12:
        first, half, last = e * dd - db * db, e * od - y * db, e * (oo - ra * ra) - y * y
        h = half * half - first * last
        if h < 0.0 or first == 0.0:
            return FAR, 0.0
        h = np.sqrt(h)
        one, two = (-half - h) / first, (-half + h) / first
        if one > two:
            one, two = two, one
        for root in (one, two):
            share = (y + root * db) / e
            if root > NEAR and 0.0 <= share <= 1.0:
                t, at = root, share
                break
    root = _root(dd, od, oo - ra * ra, NEAR)
    if root < t:
        t, at = root, 0.0
    if bb > 0.0:
        root = _root(dd, od - db, oo - 2.0 * ob + bb - rb * rb, NEAR)
        if root < t:
            t, at = root, 1.0
    return t, at


@njit(cache=True)
def _box(o, d, half):
    """First hit t of the ray o + t d with the box of half sides `half`, and the side (0, 1, 2) that is hit."""
    enter, leave, side = -FAR, FAR, 0
    for i in range(3):
        if abs(d[i]) < 1e-12:
            if abs(o[i]) > half[i]:
                return FAR, 0
            continue
        a, b = (-half[i] - o[i]) / d[i], (half[i] - o[i]) / d[i]
        if a > b:
            a, b = b, a
        if a > enter:
            enter, side = a, i
        leave = min(leave, b)
    return (enter, side) if NEAR < enter < leave else (FAR, 0)


@njit(cache=True)
def _triangle(s, dx, dy, dz):
    """Depth at which the ray t d meets a triangle, and the shares of its second and third corner there."""
    ax, ay, az = s[3] - s[0], s[4] - s[1], s[5] - s[2]
    bx, by, bz = s[12] - s[0], s[13] - s[1], s[14] - s[2]
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    det = ax * px + ay * py + az * pz
    if abs(det) < 1e-15:
        return FAR, 0.0, 0.0
    tx, ty, tz = -s[0], -s[1], -s[2]
    u = (tx * px + ty * py + tz * pz) / det
    qx, qy, qz = ty * az - tz * ay, tz * ax - tx * az, tx * ay - ty * ax
    v = (dx * qx + dy * qy + dz * qz) / det
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return FAR, 0.0, 0.0
    return (bx * qx + by * qy + bz * qz) / det, u, v


@njit(cache=True)
def _second_color(pattern, period, x, y, z, along):
    """Whether a pattern shows its second color at a place in the solid's own axes."""
    if pattern == 1:
        return np.floor(along / period) % 2.0 == 1.0
    if pattern == 2:
        return np.floor(x / period) % 3.0 == 1.0
    if pattern == 3:
        return (np.floor(along / period) + np.floor(x / period)) % 2.0 == 1.0
    if pattern == 4:
        wave = np.sin(6.1 * x / period) + np.sin(4.7 * along / period + 2.1 * np.sin(3.3 * x / period))
        return wave + np.sin(5.3 * z / period) > 0.6
    return abs(x) < period and z > 0.0  # an open jacket


@njit(cache=True)
def trace(solids, camera, light, color, depth, part):
    """Paint solids (P, COLUMNS) in place: color (H, W, 3) float32 0 to 1, depth (H, W) float32, part (H, W) uint8.

    camera : fx, fy, cx, cy. light : direction to the light (3,), its strength, ambient light's, darkening of outlines.
    Depth is that along the camera's axis. The nearest solids come first, so that most hidden pixels are never computed.
    """
    count = len(solids)
    low, high, inverse = np.empty((count, 3)), np.empty((count, 3)), np.empty((3, 3))
    for p in range(count):
        if not _bound(solids[p], inverse, low[p], high[p]):
            low[p, 2] = FAR
    for p in np.argsort(low[:, 2], kind="mergesort"):
        if low[p, 2] == FAR:
            break
        u0, u1, v0, v1 = _window(low[p], high[p], camera, depth.shape)
        if u0 < u1 and v0 < v1:
            _paint(solids[p], low[p, 2], u0, u1, v0, v1, camera, light, color, depth, part)


@njit(cache=True)
def _normal(s, kind, place, at, side, second, third):
    """Direction out of a solid, in its own axes, of any length. place : of the hit, in the same axes."""
    x, y, z = place
    if kind == CONE:
        return x - at * s[12], y - at * s[13], z - at * s[14]
    if kind == BOX:
        return x * (side == 0), y * (side == 1), z * (side == 2)
    first = 1.0 - second - third
    return (
        first * s[6] + second * s[9] + third * s[25],
        first * s[7] + second * s[10] + third * s[26],
        first * s[8] + second * s[11] + third * s[27],
    )


@njit(cache=True)
def _shade(normal, ray, light):
    """Brightness of a surface: ambient light, the key light's cosine, and darker towards the outline."""
    size = 1.0 / max(np.sqrt(_dot(normal, normal)), 1e-12)
    lit = max(0.0, _dot(normal, light) * size)
    facing = max(0.0, -_dot(normal, ray) * size / np.sqrt(_dot(ray, ray)))
    return light[4] + light[3] * lit - light[5] * (1.0 - facing) ** 2


@njit(cache=True)
def _paint(s, nearest, u0, u1, v0, v1, camera, light, color, depth, part):
    """Paint one solid inside a window of pixels."""
    fx, fy, cx, cy = camera
    kind, pattern, hole = int(s[17]), int(s[30]), s[29] > 0.0
    m = (s[3], s[4], s[5], s[6], s[7], s[8], s[9], s[10], s[11])
    turned = (s[3], s[6], s[9], s[4], s[7], s[10], s[5], s[8], s[11])  # a normal goes back by the transposed axes
    b, ra, rb = (s[12], s[13], s[14]), s[15], s[16]
    plane, beyond_at, length = (s[25], s[26], s[27]), s[28], np.sqrt(_dot(b, b))
    o = _times(m, (-s[0], -s[1], -s[2]))
    for v in range(v0, v1):
        for u in range(u0, u1):
            if depth[v, u] <= nearest:
                continue
            ray = ((u - cx) / fx, (v - cy) / fy, 1.0)
            at, side, second, third = 0.0, 0, 0.0, 0.0
            d = _times(m, ray)
            if kind == CONE:
                t, at = _cone(o, d, b, ra, rb)
            elif kind == BOX:
                t, side = _box(o, d, b)
            else:
                t, second, third = _triangle(s, ray[0], ray[1], 1.0)
            if t >= depth[v, u] or t < NEAR:
                continue
            place = (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
            beyond = kind != TRIANGLE and _dot(plane, place) > beyond_at
            if beyond and hole:
                continue
            normal = _normal(s, kind, place, at, side, second, third)
            if kind != TRIANGLE:
                normal = _times(turned, normal)
            if pattern > 0 and not beyond:
                along = at * length if kind == CONE and length > 0.0 else place[1]
                beyond = _second_color(pattern, s[31], place[0], place[1], place[2], along)
            shade = _shade(normal, ray, light)
            for i in range(3):
                color[v, u, i] = (s[22 + i] if beyond else s[19 + i]) * shade
            depth[v, u], part[v, u] = t, int(s[18])
