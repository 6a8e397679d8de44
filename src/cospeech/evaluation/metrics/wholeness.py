"""Is a motion whole, does it flow, does it move as much as the speaker? Measured as it is shown, without a low-pass.

Lengths are in millimetres, so that a body that comes apart is seen at once; FGD, which sees directions alone, cannot.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from cospeech.evaluation import columns
from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.matching.database.descriptors import WINDOW
from cospeech.skeleton import UPPER55, bone_lengths, to_parent_relative

HIPS = UPPER55.joints("left_hip", "right_hip")
HAND_ROOTS = [UPPER55.index[root] for root in UPPER55.attach]
HAND_WRISTS = [UPPER55.index[wrist] for wrist in UPPER55.attach.values()]
BONES = np.setdiff1d(np.arange(len(UPPER55)), [UPPER55.root, *HAND_ROOTS])  # every joint at the end of a bone
MILLIMETRES = 1000.0
SAME = 1e-6  # metres: a joint that moves less from frame to frame has not moved
LOG_ENERGY = 13  # of the speech features
STRESS = 0.2  # seconds after an onset in which its loudness is looked for
PROMINENCE = 0.25  # of a stroke's peak, as a share of the training part's 95th percentile of wrist speed


def window_borders(frames, trace=None, fps=15.0):
    """(T,) bool: frames that begin a window of 8 whose source is another place than where the frame before was going.

    trace : a `Trace`; None: every window begins so.
    """
    borders = np.arange(frames) % WINDOW == 0
    if trace is not None:
        take, time = trace.columns["take"], trace.columns["time"]
        borders[1:] &= (np.diff(take) != 0) | (np.abs(np.diff(time) - 1 / fps) > 0.5 / fps)
    return borders


def step_sizes(positions):
    """Mean distance in mm that a joint goes from frame to frame: (T, 55, 3) -> (T - 1,)."""
    return MILLIMETRES * np.linalg.norm(np.diff(positions, axis=0), axis=-1).mean(axis=1)


def border_step_ratio(positions, borders):
    """Mean `step_sizes` into frames that are `borders`, (T,) bool, over the mean of all others; NaN if one is none."""
    steps, at = step_sizes(positions), np.asarray(borders)[1:]
    return _ratio(steps[at], steps[~at])


def _ratio(at, elsewhere):
    if not at.size or not elsewhere.size or elsewhere.mean() <= 0:
        return float("nan")
    return float(at.mean() / elsewhere.mean())


def frozen_frames(positions, recorded):
    """How many frames equal the frame before in every joint, where the recorded motion's, (T, 55, 3) both, do not."""
    still = [np.abs(np.diff(motion, axis=0)).max(axis=(1, 2)) < SAME for motion in (positions, recorded)]
    return int((still[0] & ~still[1]).sum())


def stroke_times(positions, fps, prominence):
    """Seconds (N,) at which a wrist is fastest on its way: (T, 55, 3) metres.

    Local maxima of the faster wrist's speed that rise above the minima on both sides by `prominence`, in m/s, and are
    at least 0.2 s apart. A stroke ends a little later, where the hand stops or turns.
    """
    speed = metrics.wrist_speeds(positions, fps).max(axis=1)
    peaks, _ = find_peaks(speed, prominence=prominence, distance=max(round(0.2 * fps), 1))
    return (peaks + 0.5) / fps


def stressed_onsets(onsets, features, fps):
    """The onsets (K,), in seconds, of the louder half: by the largest log energy (T, 28) within 0.2 s after each."""
    if not len(onsets):
        return np.zeros(0)
    starts, reach = np.round(np.asarray(onsets) * fps).astype(int), round(STRESS * fps) + 1
    starts = np.minimum(starts, len(features) - 1)
    loud = np.array([features[start : start + reach, LOG_ENERGY].max() for start in starts])
    return np.asarray(onsets)[loud >= np.median(loud)]


def stroke_lags(strokes, onsets):
    """|time| from each stroke to the nearest onset: (N,), (K,) -> (N,) seconds; empty if there is no onset."""
    if not len(onsets):
        return np.zeros(0)
    return np.abs(np.asarray(strokes)[:, None] - np.asarray(onsets)[None]).min(axis=1, initial=np.inf)


@dataclass
class MotionMetrics:
    """Fitted to a training part: the speaker's body, and how fast its hands are.

    lengths : (55,) metres of the bone that ends in each joint, medians. apart : (2,) metres from each hand root to its
    wrist, medians. hips : (2, 3) their mean places, metres. sway : metres that a hip goes from there at most.
    prominence : of a stroke's peak, m/s.
    """

    lengths: np.ndarray
    apart: np.ndarray
    hips: np.ndarray
    sway: float
    prominence: float

    SIGMA = 0.0  # frames: no low-pass

    @classmethod
    def fit(cls, pieces, fps, threshold=None):
        """From the Takes of the training part."""
        del threshold
        positions = np.concatenate([piece.positions for piece in pieces]).astype(np.float64)
        apart = np.linalg.norm(positions[:, HAND_ROOTS] - positions[:, HAND_WRISTS], axis=-1)
        hips = positions[:, HIPS].mean(axis=0)
        sway = np.linalg.norm(positions[:, HIPS] - hips, axis=-1).max()
        speeds = np.concatenate([metrics.wrist_speeds(piece.positions, fps).max(axis=1) for piece in pieces])
        prominence = PROMINENCE * float(np.percentile(speeds, 95))
        return cls(bone_lengths(positions), np.median(apart, axis=0), hips, float(sway), prominence)

    def measure(self, row, takes, reference):
        """{name: Take} -> ({metric: (value, nan)} over all clips, None as none is of single clips, attributes)."""
        del row
        pieces, fps = [piece for take in takes.values() for piece in take.pieces()], reference.fps
        motions = [np.asarray(piece.positions, np.float64) for piece in pieces]
        found = self._of_body(np.concatenate(motions)) | self._of_flow(pieces, motions)
        speeds = np.concatenate([metrics.wrist_speeds(motion, fps).ravel() for motion in motions])
        frames = [max(len(motion) - 3, 0) for motion in motions]
        jerks = [metrics.jerk(motion, fps) if count else 0.0 for motion, count in zip(motions, frames, strict=True)]
        found |= {
            columns.WRIST_SPEED_P50: np.percentile(speeds, 50) if speeds.size else np.nan,
            columns.WRIST_SPEED_P95: np.percentile(speeds, 95) if speeds.size else np.nan,
            columns.JERK: np.average(jerks, weights=frames) if sum(frames) else np.nan,
            columns.STROKE_LAG: self._lag(pieces, motions, fps),
        }
        attributes = {"fps": fps, "low_pass_sigma": reference.sigma, "stroke_prominence": self.prominence}
        return {name: (float(value), np.nan) for name, value in found.items()}, None, attributes

    def _of_body(self, positions):
        """Of all frames: what is too long or too short, torn off, and displaced, in mm."""
        lengths = np.linalg.norm(to_parent_relative(positions), axis=-1)
        apart = np.linalg.norm(positions[:, HAND_ROOTS] - positions[:, HAND_WRISTS], axis=-1) - self.apart
        away = np.linalg.norm(positions[:, HIPS] - self.hips, axis=-1).max() - self.sway
        return {
            columns.BONE: MILLIMETRES * np.abs(lengths - self.lengths)[:, BONES].max(),
            columns.HAND_ROOT: MILLIMETRES * max(apart.max(), 0.0),
            columns.HIP: MILLIMETRES * max(away, 0.0),
        }

    def _of_flow(self, pieces, motions):
        steps = np.concatenate([step_sizes(motion) for motion in motions])
        borders = np.concatenate([piece.borders[1:] for piece in pieces])
        frozen = [frozen_frames(motion, piece.recorded) for piece, motion in zip(pieces, motions, strict=True)]
        ratio = _ratio(steps[borders], steps[~borders])
        return {columns.BORDER_STEP_RATIO: ratio, columns.FROZEN_FRAMES: sum(frozen)}

    def _lag(self, pieces, motions, fps):
        lags = [np.zeros(0)]
        for piece, motion in zip(pieces, motions, strict=True):
            if piece.onsets is not None and len(motion) > 2:
                onsets = stressed_onsets(piece.onsets, piece.features, fps)
                lags.append(stroke_lags(stroke_times(motion, fps, self.prominence), onsets))
        lags = np.concatenate(lags)
        return np.median(lags) if lags.size else np.nan
