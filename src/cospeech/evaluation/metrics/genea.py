"""The objective measures of the GENEA challenges (Kucherenko et al. 2021, Yoon et al. 2022) on clips of any rate.

They work on joint positions in centimetres, here of every joint of `upper55` but the pelvis, which is the origin, and
the hand roots, which are the wrists.
"""

import numpy as np

from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.skeleton import BODY, UPPER55

JOINTS = np.array([j for j, name in enumerate(UPPER55.names) if j != UPPER55.root and name not in UPPER55.attach])
CENTIMETRES = 100.0
WIDTH = 0.05  # of the histograms' bins: cm/s and cm/s^2 (the challenge's README)
TOP = {1: 49.0, 2: 49.0}  # where the challenge's histograms end: cm/s, cm/s^2


def joints(positions):
    """(T, 55, 3) metres -> (T, 52, 3) centimetres of `JOINTS`."""
    return CENTIMETRES * np.asarray(positions, np.float64)[:, JOINTS]


def average_jerk(motions, fps=15.0):
    """AJ: mean norm of the third difference x fps^3 over joints, cm/s^3: (mean, deviation) over motions (T, 55, 3)."""
    return _over_motions([metrics.jerk(joints(positions), fps) for positions in motions])


def average_acceleration(motions, fps=15.0):
    """AA: mean norm of the second difference x fps^2 over joints, cm/s^2: (mean, deviation) over motions."""
    return _over_motions([metrics.acceleration(joints(positions), fps) for positions in motions])


def _over_motions(values):
    # Over n, not n - 1: the motions given are all there are, as in the challenge; no sample of runs.
    known = np.array([value for value in values if np.isfinite(value)])
    return (float(known.mean()), float(known.std())) if known.size else (float("nan"), float("nan"))


def distance_histogram(motions, order=1, fps=15.0, width=WIDTH, top=None):
    """HMD: shares of joint speeds (order 1, cm/s) or accelerations (2, cm/s^2) in bins of `width`, summed over joints.

    The challenge drops what lies above its last edge, 49; here it falls in the last bin, so that no motion looks
    calmer than it is. `top` None: that edge. (bins,) summing to 1.
    """
    top = TOP[order] if top is None else top
    norms = [np.linalg.norm(np.diff(joints(p), order, axis=0), axis=-1).ravel() * fps**order for p in motions]
    bins = round(top / width)
    which = np.minimum(np.concatenate(norms) / width, bins - 1).astype(int)
    return np.bincount(which, minlength=bins) / len(which)


def hellinger(motions, truth, order=1, fps=15.0, width=WIDTH, top=None):
    """Hellinger distance of two lists of motions' `distance_histogram`: 0 equal, 1 disjoint."""
    return metrics.hellinger(*(distance_histogram(m, order, fps, width, top) for m in (motions, truth)))


def canonical_correlation(a, b):
    """First canonical correlation of a (N, D) and b (N, E), 0..1; NaN when one of them does not vary.

    Exact: the largest singular value of the product of orthonormal bases of the two centred sets of columns (Bjorck and
    Golub 1973), where the challenge iterates. Directions whose spread is under a thousandth of the largest are left
    out: they hold what rigid bones and rounding leave over, not motion.
    """
    bases = []
    for samples in (a, b):
        samples = np.asarray(samples, np.float64)
        u, s, _ = np.linalg.svd(samples - samples.mean(axis=0), full_matrices=False)
        bases.append(u[:, s > max(1e-3 * s[0], 1e-9)])
    if not min(basis.shape[1] for basis in bases):
        return float("nan")
    return float(min(np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)[0], 1.0))


def cca_global(motions, truth):
    """Canonical correlation of all motions together with their truth, frame by frame: one pair of directions for all.

    motions, truth : lists of (T, 55, 3) of one speaker (with several, who speaks is a perfect correlation). The body
    without its fingers, as in the challenge of 2020. Chance alone is far above 0: read it beside the mismatched row.
    """
    return canonical_correlation(*(np.concatenate([_body(p) for p in each]) for each in (motions, truth)))


def cca_per_clip(motions, truth):
    """Mean over clips of the canonical correlation of each alone, refitted every time as in the challenge's code."""
    return _over_motions([canonical_correlation(_body(m), _body(t)) for m, t in zip(motions, truth, strict=True)])[0]


def _body(positions):
    return np.asarray(positions, np.float64)[:, BODY].reshape(len(positions), -1)
