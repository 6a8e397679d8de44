"""Compiled kernels of the search: every clip's best frame. Only `matcher` imports this, when a job is large enough to
pay for numba's start.

Exact and fast: float32 passes give every candidate a key and a bound on that key's error; where two keys are nearer
than their bounds allow to tell, `exact_key` decides in float64. So every kernel, batch size and number of threads gives
the same clip, frame and ranks.
"""

import numpy as np
from numba import njit, prange

from cospeech.learning.multiply import COLUMNS, ROWS, multiply_tile
from cospeech.matching.database.descriptors import WINDOW
from cospeech.matching.search.compact import near
from cospeech.matching.search.keys import FAST, MASKED, cosine, distance, exact_key, key_bound
from cospeech.matching.search.ranks import choose, choose_many

BLOCK = 64  # clips that a thread takes at a time
FEW = 3  # queries up to which one after the other is faster than together


@njit(cache=True)
def _excluded(clip, take, start, exclude):
    """Range of frames of this clip, (from, to), at which a window would touch the excluded (take, from, to) frames."""
    if take[clip] != exclude[0]:
        return 0, 0
    return exclude[1] - start[clip] - WINDOW + 1, exclude[2] - start[clip]


@njit(cache=True)
def _smallest_two(keys):
    """Smallest and second smallest key, and the smallest's place."""
    best, second, chosen = MASKED, MASKED, 0
    for i in range(len(keys)):
        second = min(second, max(best, keys[i]))
        if keys[i] < best:
            best, chosen = keys[i], i
    return best, second, chosen


@njit(cache=True)
def _decide(rows, keys, limit, q, angular):
    """Of the rows whose key is at most `limit`, the first with the smallest exact key."""
    best, chosen = np.inf, 0
    for i in range(len(keys)):
        if keys[i] <= limit:
            key = exact_key(rows[i], q, angular)
            if key < best:
                best, chosen = key, i
    return chosen


@njit(cache=True, parallel=True, fastmath=FAST)
def scan_one(
    first_rows,
    second_rows,
    shift,
    angular,
    index,
    allowed,
    take,
    start,
    exclude,
    q,
    q32,
    norm,
    r32,
    frame,
    keys,
    squares,
):
    """One query: per clip the best frame by the first feature, and the keys of both features there.

    first_rows (M, F, D), second_rows (M, F, E) float32; shift: the second feature is that of so many frames later;
    `angular`: the first is audio; index: what `compact` made of first_rows, or arrays of no clips; q (D,) float64, q32
    and r32 (E,) its and the second query's float32. Fills frame (M,), -1 where no frame is allowed, keys (2, M) and
    squares (2, M): the two keys, and the squares that bound their errors.
    """
    clips, length, _ = first_rows.shape
    centre, scale, codes, error = index
    for block in prange((clips + BLOCK - 1) // BLOCK):
        begin, end = block * BLOCK, min(clips, (block + 1) * BLOCK)
        marks = np.empty((BLOCK, length), np.float32)
        for m in range(begin, end):  # one loop after the other, so that reads from memory wait together
            row, (low, high) = marks[m - begin], _excluded(m, take, start, exclude)
            if len(codes):
                near(codes[m], centre[m], scale[m], error[m], q32, allowed[m], low, high, row)
            else:
                for s in range(length):
                    row[s] = np.float32(0) if allowed[m, s] and not (low <= s < high) else MASKED
        for m in range(begin, end):
            frame[m], keys[0, m], squares[0, m] = _best(first_rows[m], marks[m - begin], angular, q, q32, norm)
        for m in range(begin, end):
            keys[1, m], squares[1, m] = MASKED, 0
            if frame[m] >= 0 and angular:
                keys[1, m] = squares[1, m] = distance(second_rows[m, frame[m] + shift], r32)
            elif frame[m] >= 0:
                keys[1, m] = cosine(second_rows[m, frame[m] + shift], r32)


@njit(cache=True)
def _best(rows, row, angular, q, q32, norm):
    """The best of the marked rows of one clip: frame, key, and the square that bounds its error; -1 without any.

    row (F,) : 0 where marked, else `MASKED`; keys are written into it.
    """
    largest = np.float32(0)
    for s in range(len(row)):
        if row[s] < MASKED:
            row[s] = cosine(rows[s], q32) if angular else distance(rows[s], q32)
            largest = max(largest, row[s])
    best, second, chosen = _smallest_two(row)
    if best >= MASKED:
        return -1, MASKED, np.float32(0)
    bound = key_bound(rows.shape[1], largest, norm, angular)
    if second - best <= 2 * bound:
        chosen = _decide(rows, row, best + 2 * bound, q, angular)
    return chosen, best, best


@njit(cache=True, parallel=True, fastmath=FAST)
def scan_many(
    first_rows, second_rows, shift, angular, allowed, take, start, exclude, q, panels, norm, r32, frame, keys, squares
):
    """`scan_one` for B queries at once: matrix products per clip, whose rows stay in the cache until all is decided.

    q (B, D) float64, panels (P, D, COLUMNS) float32: the queries as columns, COLUMNS at a time, the last filled up;
    r32 (B, E) float32, norm (B,), exclude (B, 3); frame (M, B), keys (2, M, B), squares (2, M).
    """
    clips, length, width = first_rows.shape
    padded = (length + ROWS - 1) // ROWS * ROWS
    for block in prange((clips + BLOCK - 1) // BLOCK):
        rows, tile = np.zeros((padded, width), np.float32), np.empty((padded, COLUMNS), np.float32)
        frames, offset, factor = np.empty(length, np.int64), np.empty(length, np.float32), np.empty(length, np.float32)
        best, second = np.empty(COLUMNS, np.float32), np.empty(COLUMNS, np.float32)
        chosen = np.empty(COLUMNS, np.int32)
        for m in range(block * BLOCK, min(clips, (block + 1) * BLOCK)):
            count, largest = _gather(first_rows[m], allowed[m], angular, rows, frames, offset, factor)
            heaviest = np.float32(0)
            for panel in range(len(panels)):
                for i in range(0, count, ROWS):
                    multiply_tile(rows, i, panels[panel], tile)
                _smallest_two_each(tile[:count], offset, factor, best, second, chosen)
                for c in range(min(COLUMNS, len(q) - panel * COLUMNS)):
                    b = panel * COLUMNS + c
                    low, high = _excluded(m, take, start, exclude[b])
                    if low < high:
                        _leave_out(tile[:count, c], frames, low, high)
                        best[c], second[c], chosen[c] = _smallest_two(tile[:count, c])
                    if best[c] >= MASKED:
                        frame[m, b], keys[0, m, b], keys[1, m, b] = -1, MASKED, MASKED
                        continue
                    bound = key_bound(width, largest, norm[b], angular)
                    if second[c] - best[c] <= 2 * bound:
                        chosen[c] = _decide(rows, tile[:count, c], best[c] + 2 * bound, q[b], angular)
                    s = frames[chosen[c]]
                    frame[m, b], keys[0, m, b] = s, best[c]
                    if angular:
                        keys[1, m, b] = distance(second_rows[m, s + shift], r32[b])
                        heaviest = max(heaviest, keys[1, m, b])
                    else:
                        keys[1, m, b] = cosine(second_rows[m, s + shift], r32[b])
            squares[0, m], squares[1, m] = largest, heaviest


@njit(cache=True, fastmath=FAST)
def _gather(source, allowed, angular, rows, frames, offset, factor):
    """Copy the allowed rows of a clip together; key = offset + factor * x.q. Returns their number and largest |x|^2."""
    count, largest = 0, np.float32(0)
    for s in range(len(source)):
        if not allowed[s]:
            continue
        square = np.float32(0)
        for i in range(source.shape[1]):
            rows[count, i] = source[s, i]
            square += source[s, i] * source[s, i]
        frames[count] = s
        largest = max(largest, square)
        if angular:
            offset[count] = 0
            factor[count] = -1 / np.sqrt(square) if square > np.float32(0) else np.float32(0)
        else:
            offset[count], factor[count] = square, -2
        count += 1
    return count, largest


@njit(cache=True, fastmath=FAST)
def _smallest_two_each(tile, offset, factor, best, second, chosen):
    """Turn products (n, C) into keys in place; per column the smallest, the second smallest and the smallest's row."""
    best[:], second[:], chosen[:] = MASKED, MASKED, 0
    for i in range(len(tile)):
        plus, times = offset[i], factor[i]
        for b in range(tile.shape[1]):
            key = plus + times * tile[i, b]
            tile[i, b] = key
            second[b] = min(second[b], max(best[b], key))
            chosen[b] = i if key < best[b] else chosen[b]
            best[b] = min(best[b], key)


@njit(cache=True)
def _leave_out(keys, frames, low, high):
    for i in range(len(keys)):
        if low <= frames[i] < high:
            keys[i] = MASKED


def select(rows, index, variant, allowed, take, start, exclude, queries, k):
    """Steps 2 to 5 of Algorithm 1 for B queries.

    rows : (first (M, F, D), second (M, F, E), shift, angular), see `scan_one`. index : `Index.ask`. variant :
    "pose_only" orders by the first feature alone. queries : (B, D), (B, E) float64. Others as in `scan_many`.

    Returns (B, 4): clip, frame of the first feature, and the ranks by the first feature and by the second; clip -1
    without a candidate.
    """
    clips, count, single = len(rows[0]), len(k), variant == "pose_only"
    q, r = (np.ascontiguousarray(query, np.float64) for query in queries)
    q32, r32 = q.astype(np.float32), r.astype(np.float32)
    norm, norm_r = np.linalg.norm(q, axis=1), np.linalg.norm(r, axis=1)
    squares, found = np.empty((2, clips), np.float32), np.zeros((count, 3), np.int64)
    frame, keys = np.empty((clips, count), np.int32), np.empty((2, clips, count), np.float32)
    first, second, angular = rows[0], rows[1], rows[3]
    where = allowed, take, start
    if count > FEW:
        scan_many(*rows, *where, exclude, q, _panels(q32), norm, r32, frame, keys, squares)
        choose_many(*rows, frame, keys, squares, q, norm, r, norm_r, k, single, found)
        return np.column_stack([found[:, 0], frame[found[:, 0], np.arange(count)], found[:, 1:]])
    frame, keys = frame.T.copy(), np.moveaxis(keys, 2, 0).copy()
    for b in range(count):
        scan_one(*rows, index, *where, exclude[b], q[b], q32[b], norm[b], r32[b], frame[b], keys[b], squares)
        bound = key_bound(first.shape[2], squares[0].max(), norm[b], angular)
        bound_r = key_bound(second.shape[2], squares[1].max(), norm_r[b], not angular)
        found[b] = choose(*rows, frame[b], keys[b], bound, bound_r, q[b], r[b], k[b], single)
    return np.column_stack([found[:, 0], frame[np.arange(count), found[:, 0]], found[:, 1:]])


def _panels(q):
    """(B, D) -> (P, D, COLUMNS) float32."""
    panels = np.zeros((-(-len(q) // COLUMNS), q.shape[1], COLUMNS), np.float32)
    for i, panel in enumerate(panels):
        part = q[i * COLUMNS : (i + 1) * COLUMNS]
        panel[:, : len(part)] = part.T
    return panels
