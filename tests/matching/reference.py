"""Algorithm 1 of the thesis, written straight from its pseudo-code in float64: the truth that the search is held to.

One loop per loop of the pseudo-code. Where text and pseudo-code differ, the text: the first and the last frame of a
window are tested against the mask, and s stops where the window would leave the clip.
"""

import numpy as np

N = 8


def euclidean(rows, q):
    return np.sqrt(((np.asarray(rows, np.float64) - q) ** 2).sum(axis=-1))


def cosine(rows, q):
    rows = np.asarray(rows, np.float64)
    return 1 - (rows * q).sum(axis=-1) / np.sqrt((rows**2).sum(axis=-1) * (q**2).sum())


def relrank(distances):
    """0-based position of each candidate in a stable sort."""
    ranks = [0] * len(distances)
    for position, candidate in enumerate(sorted(range(len(distances)), key=distances.__getitem__)):
        ranks[candidate] = position
    return ranks


def algorithm1(pose, audio, eligible, queries, initial, k=1, mask=None, variant="pose", excluded=None, offset=0):
    """pose (M, F, 96), audio (M, F, 112), eligible (M, F), queries (W, 112), initial (96,), mask None or (W, M, F).

    excluded (M, F) bool: windows that may not start there. offset: the compared pose is that so many frames before the
    window. A window that leaves its clip goes on in the next (where `eligible` says that it may). Where the mask leaves
    no candidate it is dropped for that window. Returns [(clip, frame, pose rank, audio rank)] of length W.
    """
    clips, frames = eligible.shape
    row = lambda array, m, s: array[m + s // frames, s % frames]
    p, steps = np.asarray(initial, np.float64), []
    for w, f in enumerate(np.asarray(queries, np.float64)):
        pose_distance, audio_distance = np.roll(euclidean(pose, p), offset, axis=1), cosine(audio, f)
        first = audio_distance if variant == "audio" else pose_distance
        for c in [None] if mask is None else [mask[w], None]:
            candidates = []
            for m in range(clips):
                r, smallest = None, np.inf
                for s in range(offset, frames):
                    allowed = eligible[m, s] and (c is None or (c[m, s] and row(c, m, s + N - 1)))
                    if excluded is not None and excluded[m, s]:
                        allowed = False
                    if allowed and first[m, s] < smallest:
                        smallest, r = first[m, s], s
                if r is not None:
                    candidates.append((m, r))
            if candidates:
                break
        pose_ranks = relrank([pose_distance[at] for at in candidates])
        audio_ranks = relrank([audio_distance[at] for at in candidates])
        if variant == "pose_only":
            audio_ranks = [0] * len(candidates)
        combined = [one + two for one, two in zip(pose_ranks, audio_ranks, strict=True)]
        order = sorted(range(len(candidates)), key=combined.__getitem__)
        i = order[min(k, len(order)) - 1]
        steps.append((*candidates[i], pose_ranks[i], audio_ranks[i]))
        m, r = candidates[i]
        p = np.asarray(row(pose, m, r + N - 1), np.float64)
    return steps
