"""Compiled kernels of the search: the two ranks of every clip, added, and the k-th best sum."""

import numpy as np
from numba import njit, prange

from cospeech.matching.search.keys import MASKED, exact_key, key_bound


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
def _first_ranks(keys, ranks, bound, rows, frame, shift, q, angular):
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
                exact[i - begin] = exact_key(rows[clips[i], frame[clips[i]] + shift], q, angular)
            _sort(exact, clips[begin:end])
        begin = end
    return clips[:ranks]


@njit(cache=True)
def choose(first_rows, second_rows, shift, angular, frame, keys, bound, bound_r, q, r, k, single):
    """Steps 4 and 5 of Algorithm 1 for one query: add the two ranks, take the k-th best (the last if there are fewer).

    frame (M,) and shift : the clips' best frames and how many frames later (or earlier) the second feature is compared;
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
        one = _first_ranks(keys[0], ranks, bound, first_rows, frame, 0, q, angular)
        if single:
            return one[k - 1], k - 1, 0
        two = _first_ranks(keys[1], ranks, bound_r, second_rows, frame, shift, r, not angular)
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
def choose_many(first_rows, second_rows, shift, angular, frame, keys, squares, q, norm, r, norm_r, k, single, found):
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
            bound = key_bound(first_rows.shape[2], largest, norm[b], angular)
            bound_r = key_bound(second_rows.shape[2], largest_r, norm_r[b], not angular)
            found[b] = choose(
                first_rows,
                second_rows,
                shift,
                angular,
                frames[b - begin],
                both[b - begin],
                bound,
                bound_r,
                q[b],
                r[b],
                k[b],
                single,
            )
