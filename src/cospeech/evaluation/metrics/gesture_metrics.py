"""The field's metrics as pure functions. Positions are (T, 55, 3) metres in upper55, +y up; times are in seconds.

A metric that does not apply (no onset, too few frames) is NaN, never zero. Sources are named in each docstring; the
numbers refer to the publications' sections and tables.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks
from scipy.spatial.distance import pdist

from cospeech.errors import CospeechError
from cospeech.skeleton import BODY, UPPER55

WRISTS = UPPER55.joints("left_wrist", "right_wrist")
STILL = 1e-5  # an angle that changes less than this a frame (in units of pi) is rigid: what moves it is rounding


def low_pass(positions, sigma=1.5):
    """Gaussian along time, `sigma` in frames, ends held (IVA 2021: 1.5, on shown ground truth too). Same shape."""
    return gaussian_filter1d(positions, sigma, axis=0, mode="nearest") if sigma > 0 else np.asarray(positions)


# ---- distributions of latents ---------------------------------------------------------------------------------------


def frechet_distance(a, b):
    """Frechet distance of two Gaussians fitted to samples a (N, D) and b (M, D): float >= 0, symmetric.

    |mu_a - mu_b|^2 + Tr(S_a + S_b - 2 (S_a S_b)^1/2) with unbiased covariances (FGD: Yoon et al. 2020). With centred
    samples S_a = A'A and S_b = B'B the last trace is the sum of the singular values of A B', taken here from the two
    QR factors: exact, no matrix root, and nothing to regularise when N or M is smaller than D.

    Raises CospeechError unless both have at least two rows, the same width and finite values.
    """
    a, b = (np.asarray(samples, np.float64) for samples in (a, b))
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1]:
        raise CospeechError(f"frechet_distance: shapes {a.shape} and {b.shape}, expected (N, D) and (M, D)")
    if min(len(a), len(b)) < 2:
        raise CospeechError(
            f"frechet_distance: {len(a)} and {len(b)} samples, a covariance needs at least 2; give longer clips"
        )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise CospeechError("frechet_distance: the samples hold NaN or infinity")
    roots = [np.linalg.qr(x - x.mean(axis=0), mode="r") / np.sqrt(len(x) - 1) for x in (a, b)]
    spread = sum(np.sum(root**2) for root in roots) - 2 * np.linalg.svd(roots[0] @ roots[1].T, compute_uv=False).sum()
    return float(np.sum((a.mean(axis=0) - b.mean(axis=0)) ** 2) + max(spread, 0.0))


def diversity(latents, pairs=500, seed=0, norm=2):
    """Mean distance of `pairs` random pairs of different samples, (N, D) -> float (HA2G 4.3, appendix G.3).

    `norm`: 2 for Euclidean, 1 for the sum of absolute differences. Where N samples have no more pairs than asked for,
    all of them are taken and the seed does not matter. Released code draws batches instead of samples
    (`diversity_of_batches`); this is the paper's definition. Raises CospeechError for N < 2.
    """
    latents, count = np.asarray(latents, np.float64), len(latents)
    if count < 2:
        raise CospeechError(f"diversity: {count} samples, a pair needs 2; give longer clips")
    if count * (count - 1) // 2 <= pairs:
        return float(pdist(latents, "minkowski", p=norm).mean())
    rng = np.random.default_rng(seed)
    first = rng.integers(count, size=pairs)
    second = (first + rng.integers(1, count, size=pairs)) % count
    return float(np.linalg.norm(latents[first] - latents[second], ord=norm, axis=1).mean())


def diversity_of_batches(latents, batch=64, pairs=500, seed=0):
    """Diversity as released HA2G code has it, (N, D) -> float: of no use but to compare with its figures.

    The first `pairs` whole batches against as many drawn without replacement, sample by sample in their order, as sums
    of absolute differences. A batch can meet itself and count as 0; samples after the last whole batch are left out.
    NaN under one whole batch.
    """
    latents = np.asarray(latents, np.float64)
    batches = latents[: len(latents) // batch * batch].reshape(-1, batch, latents.shape[1])
    if not len(batches):
        return float("nan")
    shuffled = np.random.default_rng(seed).permutation(len(batches))[:pairs]
    return float(np.abs(batches[:pairs] - batches[shuffled]).sum(axis=-1).mean())


# ---- beats ----------------------------------------------------------------------------------------------------------


def _bones():
    """Joint pairs (parent, joint) of the bones that have a length: a hand's bones start at the wrist."""
    parent = {j: int(p) for j, p in enumerate(UPPER55.tree)}
    twin = {UPPER55.index[hand]: UPPER55.index[wrist] for hand, wrist in UPPER55.attach.items()}
    return [(twin.get(p, p), j) for j, p in parent.items() if p >= 0 and j not in twin]


BONES = np.array(_bones())  # (52, 2)
# Pairs of neighbouring bones, as rows of BONES: of body and hands, and of trunk, arms and head alone. On tracked or
# captured fingers the 40 finger angles drown the nine others' beats in noise (docs/evaluation.md).
ALL_ANGLES = np.array([(i, j) for j, (p, _) in enumerate(BONES) for i, (_, q) in enumerate(BONES) if p == q])
BODY_ANGLES = ALL_ANGLES[BONES[ALL_ANGLES[:, 1], 1] < BODY.stop]


def bone_directions(positions):
    """Unit vectors along the 52 bones of `BONES`, (T, 55, 3) -> (T, 52, 3): a pose without its bone lengths."""
    bones = positions[:, BONES[:, 1]] - positions[:, BONES[:, 0]]
    lengths = np.linalg.norm(bones, axis=-1, keepdims=True)
    return np.divide(bones, lengths, out=np.zeros_like(bones), where=lengths > 1e-9)


def angle_changes(positions, angles=BODY_ANGLES):
    """|change| from the frame before of the angle of each pair of neighbouring bones, in units of pi: (T - 1, P)."""
    directions = bone_directions(np.asarray(positions, np.float64))
    a, b = directions[:, angles[:, 0]], directions[:, angles[:, 1]]
    between = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)) / np.pi
    return np.abs(np.diff(between, axis=0))


def mean_angle_change(motions, angles=BODY_ANGLES):
    """MAAC (P,) of a list of (T, 55, 3): mean of `angle_changes` over all frames of all motions (HA2G eq. 10)."""
    return np.concatenate([angle_changes(positions, angles) for positions in motions]).mean(axis=0)


def motion_beats(positions, fps=15.0, threshold=0.03, maac=None, angles=BODY_ANGLES):
    """Times (N,) in seconds at which the motion comes to rest or turns (HA2G section 4.3, appendix E).

    The angle change rate of a frame is the mean over angles of |change| / MAAC; a beat is a local minimum that lies at
    least `threshold` under a neighbour. `maac` (P,) is the data set's; None takes this motion's own. Angles whose MAAC
    is under `STILL` do not count. `angles` (P, 2): which pairs of `BONES`. A change belongs to the middle of its two
    frames; where two equal minima stand side by side the beat is between them, and where the rate rests longer the
    beat is where the rest begins.
    """
    return beats_of(angle_changes(positions, angles), fps, threshold, maac)


def beats_of(changes, fps=15.0, threshold=0.03, maac=None):
    """`motion_beats` of any angles' |changes| (T - 1, P) from frame to frame, in units of pi."""
    rate = change_rate(changes, maac)
    middle, step = rests(rate)
    return (middle[step >= threshold] + 0.5) / fps


def change_rate(changes, maac=None):
    """Angle change rate (T - 1,): mean over the angles of |change| / MAAC (HA2G eq. 13); empty if nothing moves."""
    maac = changes.mean(axis=0) if maac is None and len(changes) else maac
    if len(changes) < 3 or not (maac > STILL).any():
        return np.zeros(0)
    moving = maac > STILL
    return np.round((changes[:, moving] / maac[moving]).mean(axis=1), 4)  # so that float noise does not break ties


def rests(rate):
    """Local minima of a change rate: where each is, in frames, and by how much its higher side rises in one frame."""
    if not len(rate):
        return np.zeros(0), np.zeros(0)
    _, plateau = find_peaks(-rate, plateau_size=1)
    left, right = plateau["left_edges"], plateau["right_edges"]
    step = np.maximum(rate[left - 1] - rate[left], rate[right + 1] - rate[right])
    return np.where(right - left > 1, left - 0.5, (left + right) / 2), step


def beat_consistency(positions, onsets, fps=15.0, sigma=0.1, threshold=0.03, maac=None, angles=BODY_ANGLES):
    """BC: mean over audio onsets (seconds) of exp(-d^2 / (2 sigma^2)), d to the nearest motion beat (HA2G eq. 11).

    1 when every onset meets a beat. Speech without onsets: NaN, the metric does not apply. Motion without beats: 0, as
    nothing meets any onset (public code leaves such clips out, which flatters still motion). `threshold`, `maac`,
    `angles`: see `motion_beats`. BC rises with the number of beats, so read it beside the mismatched row.
    """
    return onset_coverage(motion_beats(positions, fps, threshold, maac, angles), onsets, sigma)


def onset_coverage(beats, onsets, sigma=0.1):
    """The score of `beat_consistency` for given motion beats: (N,), (M,) ascending seconds -> float."""
    beats, onsets = np.asarray(beats, np.float64), np.asarray(onsets, np.float64)
    if not onsets.size:
        return float("nan")
    if not beats.size:
        return 0.0
    after = np.searchsorted(beats, onsets)
    before = np.abs(onsets - beats[np.maximum(after - 1, 0)])
    nearest = np.minimum(before, np.abs(onsets - beats[np.minimum(after, len(beats) - 1)]))
    return float(np.exp(-(nearest**2) / (2 * sigma**2)).mean())


def chance_coverage(beats, onsets, duration, sigma=0.1, shifts=50):
    """What `onset_coverage` gives by chance: its mean over `shifts` rotations of the onsets within `duration` seconds.

    The rotations are spread evenly from 1 s to `duration` - 1 s. The rhythm of both sides stays, only their timing is
    lost, so a motion that scores by its many beats alone scores here as well. NaN without onsets or under 3 s.
    """
    if duration < 3:
        return float("nan")
    rotated = ((np.asarray(onsets) + shift) % duration for shift in np.linspace(1, duration - 1, shifts))
    return float(np.mean([onset_coverage(beats, onsets, sigma) for onsets in rotated]))


# ---- kinematics -----------------------------------------------------------------------------------------------------


def wrist_heights(positions):
    """Height of the left and the right wrist above the pelvis, (T, 2) metres (thesis 5.3.4)."""
    return positions[:, WRISTS, 1] - positions[:, [UPPER55.root], 1]


def wrist_speeds(positions, fps=15.0):
    """Speed of the left and the right wrist, (T - 1, 2) metres a second: finite difference x fps (thesis 5.3.4)."""
    return np.linalg.norm(np.diff(positions[:, WRISTS], axis=0), axis=-1) * fps


def wrist_asymmetry(positions):
    """Difference of the two wrist heights, (T,) metres, 0 for symmetric (thesis 5.3.4)."""
    return np.abs(np.diff(wrist_heights(positions), axis=1))[:, 0]


def _difference_norm(positions, order, fps):
    if len(positions) <= order:
        return float("nan")
    differences = np.diff(np.asarray(positions, np.float64), order, axis=0)
    return float(np.linalg.norm(differences, axis=-1).mean() * fps**order)


def acceleration(positions, fps=15.0):
    """Mean norm of the second difference x fps^2 over joints and frames, m/s^2 (GENEA's AA); NaN under 3 frames."""
    return _difference_norm(positions, 2, fps)


def jerk(positions, fps=15.0):
    """Mean norm of the third difference x fps^3 over joints and frames, m/s^3 (GENEA's AJ); NaN under 4 frames."""
    return _difference_norm(positions, 3, fps)


def motion_variance(positions):
    """Mean over joints and coordinates of the variance over time, m^2: how much of a motion is not its mean pose."""
    return float(np.var(np.asarray(positions, np.float64), axis=0).mean())


def speed_histogram(motions, fps=15.0, width=0.05, top=10.0):
    """Share of joint speeds in bins `width` m/s wide up to `top`, over all joints and frames of a list of motions.

    GENEA's histogram, summed over joints; what is faster than `top` falls in the last bin. (bins,) summing to 1.
    """
    speeds = [np.linalg.norm(np.diff(p, axis=0), axis=-1).ravel() * fps for p in motions]
    bins = round(top / width)
    which = np.minimum((np.concatenate(speeds) / width).astype(int), bins - 1)
    return np.bincount(which, minlength=bins) / len(which)


def hellinger(p, q):
    """Hellinger distance sqrt(1 - sum sqrt(p q)) of two histograms that sum to 1: 0 equal, 1 disjoint (GENEA)."""
    return float(np.sqrt(max(0.0, 1.0 - np.sqrt(np.asarray(p) * np.asarray(q)).sum())))
