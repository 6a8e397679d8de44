"""A copy of the pose features in bytes, a quarter of what a live query would have to read.

By the triangle inequality the copy tells which frames of a clip can be its nearest at all, about two of 64; only those
are read in float32. The live query is as fast as memory can be read, so this is what makes it faster.
"""

import numpy as np
from numba import njit, prange

from cospeech.matching.search.keys import FAST, MASKED, ROUNDING


@njit(cache=True, parallel=True, fastmath=FAST)
def compact(rows, centre, scale, codes, error):
    """A copy of rows (M, F, D) float32 in bytes: x = centre (M, D) + scale (M,) * codes (M, D, F) int8, within `error`.

    error (M,) : largest distance of a clip's rows from their copies.
    """
    clips, length, width = rows.shape
    for m in prange(clips):
        bytewise = np.empty((length, width), np.int8)
        low, high = np.empty(width, np.float32), np.empty(width, np.float32)
        low[:], high[:] = rows[m, 0], rows[m, 0]
        for s in range(1, length):
            for i in range(width):
                low[i], high[i] = min(low[i], rows[m, s, i]), max(high[i], rows[m, s, i])
        largest = np.float32(0)
        for i in range(width):
            centre[m, i] = (low[i] + high[i]) / 2
            largest = max(largest, high[i] - centre[m, i], centre[m, i] - low[i])
        scale[m] = largest / np.float32(127) if largest > np.float32(1e-30) else np.float32(1)
        inverse, farthest = np.float32(1) / scale[m], np.float32(0)
        for s in range(length):
            total = np.float32(0)
            for i in range(width):
                x = rows[m, s, i] - centre[m, i]
                code = np.rint(min(max(x * inverse, np.float32(-127)), np.float32(127)))
                bytewise[s, i] = np.int8(code)
                total += (x - code * scale[m]) * (x - code * scale[m])
            farthest = max(farthest, total)
        for i in range(width):
            for s in range(length):
                codes[m, i, s] = bytewise[s, i]
        error[m] = np.sqrt(farthest) + np.float32(1e-5) * (largest + np.sqrt(farthest))


@njit(cache=True, fastmath=FAST)
def near(codes, centre, scale, error, q, allowed, low, high, keys):
    """Mark the rows of one clip that may be its nearest: keys (F,) become 0 for them and `MASKED` for all others.

    By the triangle inequality a row is at most `error` nearer or farther than its copy; rounding is allowed for.
    """
    width = len(q)
    inverse, u = np.float32(1) / scale, np.empty(width, np.float32)
    square = square_q = np.float32(0)
    for i in range(width):
        u[i] = (q[i] - centre[i]) * inverse
        square += u[i] * u[i]
        square_q += q[i] * q[i]
    keys[:] = np.float32(0)
    for i in range(0, width, 4):  # four at a time, so that the keys are read and written less often
        u0, u1, u2, u3 = u[i], u[i + 1], u[i + 2], u[i + 3]
        for s in range(len(keys)):
            d0, d1 = u0 - np.float32(codes[i, s]), u1 - np.float32(codes[i + 1, s])
            d2, d3 = u2 - np.float32(codes[i + 2, s]), u3 - np.float32(codes[i + 3, s])
            keys[s] += d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3
    smallest = MASKED
    for s in range(len(keys)):
        keys[s] = keys[s] if allowed[s] and not (low <= s < high) else MASKED
        smallest = min(smallest, keys[s])
    nearest, rounding = np.sqrt(smallest), np.float32(2 * (width + 6) * ROUNDING)
    farther = 2 * (error + rounding * np.sqrt(square_q)) * inverse
    limit = nearest + farther + rounding * (nearest + farther + np.sqrt(square))
    limit *= limit
    for s in range(len(keys)):
        keys[s] = np.float32(0) if keys[s] <= limit and keys[s] < MASKED else MASKED


class Index:
    """The copy in bytes of rows (M, F, D) that a single query reads first; made once enough queries were asked."""

    AFTER = 8  # queries, from which making it pays

    def __init__(self, rows):
        self._rows, self._asked = rows, 0
        self.arrays = self.none(rows)

    @classmethod
    def none(cls, rows):
        return cls._empty(0, *rows.shape[1:])

    @staticmethod
    def _empty(clips, length, width):
        shapes = ((clips, width), "f4"), ((clips,), "f4"), ((clips, width, length), "i1"), ((clips,), "f4")
        return tuple(np.empty(shape, kind) for shape, kind in shapes)

    @classmethod
    def of(cls, database):
        """The index of a database's pose features, one for all its copies that differ in what is eligible."""
        index = database.kept.get("index")
        if index is None or index._rows is not database.pose:
            index = database.kept["index"] = cls(database.pose)
        return index

    def ask(self, queries):
        """The arrays for some more queries: of no clips while there is no copy."""
        self._asked += queries
        if self._asked > self.AFTER and not len(self.arrays[2]):
            self.arrays = self._empty(*self._rows.shape)
            compact(self._rows, *self.arrays)
        return self.arrays
