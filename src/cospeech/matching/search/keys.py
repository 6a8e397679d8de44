"""Keys of candidates: what orders them as Algorithm 1's distances do, quick in float32 or deciding in float64.

Pose: |x - q|^2 or, for many queries, |x|^2 - 2 x.q, which only lacks the query's constant. Audio (`angular`):
-x.q / |x|, the cosine distance but for the query's constants.
"""

import numpy as np
from numba import njit

MASKED = np.float32(1e30)  # key of a frame that may not be taken; finite, as the fast kernels assume
ROUNDING = 2.0**-24
FAST = {"reassoc", "contract", "nsz", "nnan"}


@njit(cache=True)
def exact_key(x, q, angular):
    """The deciding key of row x (D,) float32 for query q (D,) float64; D is a multiple of 4.

    Squared Euclidean distance, or minus the cosine similarity times |q|: equal rows have equal keys. Four running sums,
    because a single one would wait for itself.
    """
    a = b = c = d = 0.0
    e = f = g = h = 0.0
    for i in range(0, len(x), 4):
        x0, x1, x2, x3 = np.float64(x[i]), np.float64(x[i + 1]), np.float64(x[i + 2]), np.float64(x[i + 3])
        if angular:
            a, b, c, d = a + x0 * q[i], b + x1 * q[i + 1], c + x2 * q[i + 2], d + x3 * q[i + 3]
            e, f, g, h = e + x0 * x0, f + x1 * x1, g + x2 * x2, h + x3 * x3
        else:
            x0, x1, x2, x3 = x0 - q[i], x1 - q[i + 1], x2 - q[i + 2], x3 - q[i + 3]
            a, b, c, d = a + x0 * x0, b + x1 * x1, c + x2 * x2, d + x3 * x3
    total, square = (a + b) + (c + d), (e + f) + (g + h)
    if not angular:
        return total
    return -total / np.sqrt(square) if square > 0.0 else 0.0


@njit(cache=True)
def key_bound(width, square, norm, angular):
    """Largest error of a float32 key: `width` terms added in any order, |q| = norm, |x|^2 or |x - q|^2 <= square."""
    if angular:
        return np.float32(2 * (width + 6) * ROUNDING * norm)
    return np.float32((width + 6) * ROUNDING * (square + 2 * np.sqrt(square) * norm + ROUNDING * norm * norm))


@njit(cache=True, fastmath=FAST)
def distance(x, q):
    """float32 pose key of row x: |x - q|^2."""
    total = np.float32(0)
    for i in range(len(x)):
        total += (x[i] - q[i]) * (x[i] - q[i])
    return total


@njit(cache=True, fastmath=FAST)
def cosine(x, q):
    """float32 audio key of row x: -x.q / |x|."""
    dot, square = np.float32(0), np.float32(0)
    for i in range(len(x)):
        dot += x[i] * q[i]
        square += x[i] * x[i]
    return -dot / np.sqrt(square) if square > np.float32(0) else np.float32(0)
