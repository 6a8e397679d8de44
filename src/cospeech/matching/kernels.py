"""Compiled kernels of the search. Only `search.py` imports this, when a job is large enough to pay for numba's start.

Exact and fast: one float32 pass gives every candidate a key and a bound on that key's error; where two keys are nearer
than their bounds allow to tell, `exact_key` decides in float64. So every kernel, batch size and number of threads gives
the same clip, frame and ranks.

A key orders candidates as Algorithm 1's distances do. Pose: |x - q|^2 or, for many queries, |x|^2 - 2 x.q, which only
lacks the query's constant. Audio (`angular`): -x.q / |x|, the cosine distance but for the query's constants.
"""

import numpy as np
from numba import njit, prange

from cospeech.matching.features import WINDOW

MASKED = np.float32(1e30)  # key of a frame that may not be taken; finite, as the fast kernels assume
ROUNDING = 2.0**-24
BLOCK = 64  # clips that a thread takes at a time
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


@njit(cache=True, fastmath=FAST)
def _distance(x, q):
    """float32 pose key of row x: |x - q|^2."""
    total = np.float32(0)
    for i in range(len(x)):
        total += (x[i] - q[i]) * (x[i] - q[i])
    return total


@njit(cache=True, fastmath=FAST)
def _cosine(x, q):
    """float32 audio key of row x: -x.q / |x|."""
    dot, square = np.float32(0), np.float32(0)
    for i in range(len(x)):
        dot += x[i] * q[i]
        square += x[i] * x[i]
    return -dot / np.sqrt(square) if square > np.float32(0) else np.float32(0)


@njit(cache=True)
def _bound(width, square, norm, angular):
    """Largest error of a float32 key: `width` terms added in any order, |q| = norm, |x|^2 or |x - q|^2 <= square."""
    if angular:
        return np.float32(2 * (width + 6) * ROUNDING * norm)
    return np.float32((width + 6) * ROUNDING * (square + 2 * np.sqrt(square) * norm + ROUNDING * norm * norm))


@njit(cache=True)
def _excluded(clip, take, first, exclude):
    """Range of frames of this clip, (from, to), at which a window would touch the excluded (take, from, to) frames."""
    if take[clip] != exclude[0]:
        return 0, 0
    return exclude[1] - first[clip] - WINDOW + 1, exclude[2] - first[clip]


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
def scan_one(first_rows, second_rows, angular, allowed, take, start, exclude, q, q32, norm, r32, frame, keys, squares):
    """One query: per clip the best frame by the first feature, and the keys of both features there.

    first_rows (M, F, D), second_rows (M, F, E) float32; `angular`: the first is audio; q (D,) float64, q32 and r32 (E,)
    its and the second query's float32. Fills frame (M,), -1 where no frame is allowed, keys (2, M) and squares (2, M):
    the two keys and the squares that bound their errors.
    """
    clips, length, width = first_rows.shape
    for block in prange((clips + BLOCK - 1) // BLOCK):
        row = np.empty(length - WINDOW + 1, np.float32)
        for m in range(block * BLOCK, min(clips, (block + 1) * BLOCK)):
            low, high = _excluded(m, take, start, exclude)
            row[:] = MASKED
            largest = np.float32(0)
            if angular:
                for s in range(len(row)):
                    if allowed[m, s] and not (low <= s < high):
                        row[s] = _cosine(first_rows[m, s], q32)
            else:
                for s in range(len(row)):
                    if allowed[m, s] and not (low <= s < high):
                        row[s] = _distance(first_rows[m, s], q32)
                        largest = max(largest, row[s])
            best, second, chosen = _smallest_two(row)
            frame[m], keys[0, m], keys[1, m] = -1, MASKED, MASKED
            squares[:, m] = 0
            if best >= MASKED:
                continue
            bound = _bound(width, largest, norm, angular)
            if second - best <= 2 * bound:
                chosen = _decide(first_rows[m], row, best + 2 * bound, q, angular)
            frame[m], keys[0, m], squares[0, m] = chosen, best, best
            if angular:
                keys[1, m] = squares[1, m] = _distance(second_rows[m, chosen], r32)
            else:
                keys[1, m] = _cosine(second_rows[m, chosen], r32)


@njit(cache=True, parallel=True, fastmath=FAST)
def scan_many(first_rows, second_rows, angular, allowed, take, start, exclude, q, qt, norm, r32, frame, keys, squares):
    """`scan_one` for B queries at once: a matrix product per clip, whose rows stay in the cache until all is decided.

    q (B, D) float64, qt (D, B) and r32 (B, E) float32, norm (B,), exclude (B, 3); frame (M, B), keys (2, M, B),
    squares (2, M). np.dot inside the threads needs a single-threaded BLAS.
    """
    clips, length, width = first_rows.shape
    queries = len(q)
    for block in prange((clips + BLOCK - 1) // BLOCK):
        rows, tile = np.empty((length, width), np.float32), np.empty((length, queries), np.float32)
        frames, offset, scale = np.empty(length, np.int64), np.empty(length, np.float32), np.empty(length, np.float32)
        best, second = np.empty(queries, np.float32), np.empty(queries, np.float32)
        chosen = np.empty(queries, np.int32)
        for m in range(block * BLOCK, min(clips, (block + 1) * BLOCK)):
            count, largest = _gather(first_rows[m], allowed[m], angular, rows, frames, offset, scale)
            if not count:
                frame[m, :], keys[0, m, :], keys[1, m, :] = -1, MASKED, MASKED
                squares[:, m] = 0
                continue
            np.dot(rows[:count], qt, tile[:count])
            _smallest_two_each(tile[:count], offset, scale, best, second, chosen)
            heaviest = np.float32(0)
            for b in range(queries):
                low, high = _excluded(m, take, start, exclude[b])
                if low < high:
                    _leave_out(tile[:count, b], frames, low, high)
                    best[b], second[b], chosen[b] = _smallest_two(tile[:count, b])
                if best[b] >= MASKED:
                    frame[m, b], keys[0, m, b], keys[1, m, b] = -1, MASKED, MASKED
                    continue
                bound = _bound(width, largest, norm[b], angular)
                if second[b] - best[b] <= 2 * bound:
                    chosen[b] = _decide(rows, tile[:count, b], best[b] + 2 * bound, q[b], angular)
                s = frames[chosen[b]]
                frame[m, b], keys[0, m, b] = s, best[b]
                if angular:
                    keys[1, m, b] = _distance(second_rows[m, s], r32[b])
                    heaviest = max(heaviest, keys[1, m, b])
                else:
                    keys[1, m, b] = _cosine(second_rows[m, s], r32[b])
            squares[0, m], squares[1, m] = largest, heaviest


@njit(cache=True, fastmath=FAST)
def _gather(source, allowed, angular, rows, frames, offset, scale):
    """Copy the allowed rows of a clip together; key = offset + scale * x.q. Returns their number and largest |x|^2."""
    count, largest = 0, np.float32(0)
    for s in range(len(source) - WINDOW + 1):
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
            scale[count] = -1 / np.sqrt(square) if square > np.float32(0) else np.float32(0)
        else:
            offset[count], scale[count] = square, -2
        count += 1
    return count, largest


@njit(cache=True, fastmath=FAST)
def _smallest_two_each(tile, offset, scale, best, second, chosen):
    """Turn products (n, B) into keys in place; per column the smallest, the second smallest and the smallest's row."""
    best[:], second[:], chosen[:] = MASKED, MASKED, 0
    for i in range(len(tile)):
        plus, times = offset[i], scale[i]
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


@njit(cache=True)
def _sort(keys, clips):
    """Shell sort in place by (key, clip)."""
    gap = 1
    while gap < len(keys) // 3:
        gap = 3 * gap + 1
    while gap:
        for i in range(gap, len(keys)):
            key, clip, j = keys[i], clips[i], i
            while j >= gap and (keys[j - gap] > key or (keys[j - gap] == key and clips[j - gap] > clip)):
                keys[j], clips[j] = keys[j - gap], clips[j - gap]
                j -= gap
            keys[j], clips[j] = key, clip
        gap //= 3


@njit(cache=True)
def _limit(keys, ranks):
    """A key that at least `ranks` of the keys under MASKED do not exceed, and few more: from a histogram."""
    low, high = MASKED, -MASKED
    for key in keys:
        if key < MASKED:
            low, high = min(low, key), max(high, key)
    bins = np.zeros(1024, np.int64)
    scale = 1023 / (high - low) if high > low else 0.0
    for key in keys:
        if key < MASKED:
            bins[int((key - low) * scale)] += 1
    count = last = 0
    while count < ranks:
        count += bins[last]
        last += 1
    if last == 1024 or scale == 0.0:
        return high
    limit = low
    for key in keys:
        if key < MASKED and int((key - low) * scale) < last:
            limit = max(limit, key)
    return limit


@njit(cache=True)
def _first_ranks(keys, ranks, bound, rows, frame, q, angular):
    """The first `ranks` clips in the exact order of (key, clip); `keys` (M,) float32 are right within `bound`."""
    limit = _limit(keys, ranks) + 2 * bound
    clips, near = np.empty(len(keys), np.int64), np.empty(len(keys))
    count = 0
    for m in range(len(keys)):
        if keys[m] <= limit and keys[m] < MASKED:
            clips[count], near[count] = m, keys[m]
            count += 1
    clips, near = clips[:count], near[:count]
    _sort(near, clips)
    begin = 0
    while begin < min(ranks, count):
        end = begin + 1
        while end < count and near[end] - near[end - 1] <= 2 * bound:
            end += 1
        if end - begin > 1:
            exact = np.empty(end - begin)
            for i in range(begin, end):
                exact[i - begin] = exact_key(rows[clips[i], frame[clips[i]]], q, angular)
            _sort(exact, clips[begin:end])
        begin = end
    return clips[:ranks]


@njit(cache=True)
def choose(first_rows, second_rows, angular, frame, keys, bound, bound_r, q, r, k, single):
    """Steps 4 and 5 of Algorithm 1 for one query: add the two ranks, take the k-th best (the last if there are fewer).

    keys (2, M) right within the two bounds, q and r the two queries in float64; `single`: order by the first alone.
    Returns (clip, rank by the first feature, rank by the second); (-1, 0, 0) without any candidate.

    Only a clip that is among the first R in both orders can have a rank sum under R: the first R of each are enough as
    soon as the k-th best sum among them is smaller than R.
    """
    clips, candidates = len(frame), 0
    for m in range(clips):
        candidates += frame[m] >= 0
    if not candidates:
        return -1, 0, 0
    k = min(k, candidates)
    ranks = k if single else min(candidates, int(2 * np.sqrt(2.0 * k * candidates)) + 16)
    place = np.full(clips, -1, np.int64)
    while True:
        one = _first_ranks(keys[0], ranks, bound, first_rows, frame, q, angular)
        if single:
            return one[k - 1], k - 1, 0
        two = _first_ranks(keys[1], ranks, bound_r, second_rows, frame, r, not angular)
        for i in range(ranks):
            place[one[i]] = i
        sums, both, count = np.empty(ranks), np.empty(ranks, np.int64), 0
        for j in range(ranks):
            if place[two[j]] >= 0:
                sums[count], both[count] = place[two[j]] + j, two[j]
                count += 1
        _sort(sums[:count], both[:count])
        if count >= k and (sums[k - 1] < ranks or ranks == candidates):
            clip = both[k - 1]
            return clip, place[clip], int(sums[k - 1]) - place[clip]
        ranks = min(candidates, 4 * ranks)


@njit(cache=True, parallel=True)
def choose_many(first_rows, second_rows, angular, frame, keys, squares, q, norm, r, norm_r, k, single, found):
    """`choose` for B queries: frame (M, B), keys (2, M, B) -> found (B, 3). Columns are gathered 16 at a time."""
    clips, queries = frame.shape
    largest, largest_r = squares[0].max(), squares[1].max()
    group = min(queries, 16)
    for block in prange((queries + group - 1) // group):
        begin, end = block * group, min(queries, block * group + group)
        frames, both = np.empty((group, clips), frame.dtype), np.empty((group, 2, clips), np.float32)
        for m in range(clips):
            for b in range(begin, end):
                frames[b - begin, m] = frame[m, b]
                both[b - begin, 0, m], both[b - begin, 1, m] = keys[0, m, b], keys[1, m, b]
        for b in range(begin, end):
            bound = _bound(first_rows.shape[2], largest, norm[b], angular)
            bound_r = _bound(second_rows.shape[2], largest_r, norm_r[b], not angular)
            found[b] = choose(
                first_rows, second_rows, angular, frames[b - begin], both[b - begin], bound, bound_r, q[b], r[b], k[b],
                single,
            )  # fmt: skip


def select(first_rows, second_rows, angular, allowed, take, start, exclude, q, r, k, single):
    """Steps 2 to 5 of Algorithm 1 for B queries q (B, D), r (B, E) float64.

    Returns frame (B,) and (B, 3): clip, its rank by the first feature and by the second; clip -1 without a candidate.
    """
    clips, queries = len(first_rows), len(q)
    q32, r32 = q.astype(np.float32), r.astype(np.float32)
    norm, norm_r = np.linalg.norm(q, axis=1), np.linalg.norm(r, axis=1)
    squares, found = np.empty((2, clips), np.float32), np.zeros((queries, 3), np.int64)
    frame, keys = np.empty((clips, queries), np.int32), np.empty((2, clips, queries), np.float32)
    shared = first_rows, second_rows, angular, allowed, take, start
    if queries > 1:
        scan_many(*shared, exclude, q, np.ascontiguousarray(q32.T), norm, r32, frame, keys, squares)
        choose_many(first_rows, second_rows, angular, frame, keys, squares, q, norm, r, norm_r, k, single, found)
    else:
        frame, keys = frame[:, 0], keys[:, :, 0]
        scan_one(*shared, exclude[0], q[0], q32[0], norm[0], r32[0], frame, keys, squares)
        bound = np.float32(_bound(first_rows.shape[2], squares[0].max(), norm[0], angular))
        bound_r = np.float32(_bound(second_rows.shape[2], squares[1].max(), norm_r[0], not angular))
        found[0] = choose(
            first_rows, second_rows, angular, frame, keys, bound, bound_r, q[0], r[0], int(k[0]), single
        )  # fmt: skip
        return frame[found[:, 0]], found
    return frame[found[:, 0], np.arange(queries)], found
