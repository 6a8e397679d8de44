"""The metrics of one speaker's summary: most of single clips, FGD and diversity of all their windows together."""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import notice
from cospeech.evaluation import columns
from cospeech.evaluation.columns import METRICS
from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.evaluation.metrics.fgd import FRAMES, OURS
from cospeech.evaluation.metrics.synchrony import SpeechToSpeed
from cospeech.formats.result_table import mean_and_deviation

# Of motion beats. The published 0.03 lets ripples through that carry no timing: at 0.1 the truth stands farther above
# chance, on motion capture and on the demo speakers alike (docs/evaluation.md).
BEAT_THRESHOLD = 0.1
DRAWS = 10  # of the pairs of diversity, as in HA2G appendix G.3


@dataclass
class SummaryMetrics:
    """Fitted to a training part: maac (P,), histogram of speeds, and the speed that speech leads one to expect."""

    maac: np.ndarray
    speeds: np.ndarray
    predictor: SpeechToSpeed
    threshold: float

    SIGMA = 1.5  # frames, the low-pass of every motion

    @classmethod
    def fit(cls, pieces, fps, threshold=None):
        """From the Takes of the training part; threshold : of motion beats."""
        motions = [piece.positions for piece in pieces]
        return cls(
            metrics.mean_angle_change(motions),
            metrics.speed_histogram(motions, fps),
            SpeechToSpeed.fit([piece.features for piece in pieces], motions, fps),
            BEAT_THRESHOLD if threshold is None else threshold,
        )

    def measure(self, row, takes, reference):
        """{name: Take} -> ({metric: (mean, deviation)} over clips or of all windows, (C, M) of clips, attributes)."""
        pieces = {name: take.pieces() for name, take in takes.items()}
        values = np.array([self._combined(parts) for parts in pieces.values()])
        found = dict(zip(METRICS, zip(*mean_and_deviation(np.ma.masked_invalid(values)), strict=True), strict=True))
        flat = [piece for parts in pieces.values() for piece in parts]
        net, (test, train) = reference.nets[OURS], reference.latents[OURS]
        own = np.concatenate([net.latents(piece.positions) for piece in flat])
        found |= _of_latents(own, test, train, reference)
        attributes = {
            "fps": reference.fps,
            "low_pass_sigma": reference.sigma,
            "beat_threshold": self.threshold,
            "window_frames": FRAMES,
            "windows": len(own),
            "test_windows": len(test),
            "train_windows": len(train),
            "feature_net_sha256": net.sha256,
        }
        return found, values, attributes

    def _combined(self, pieces):
        """The metrics of one clip (M,): of its pieces, weighted by their frames; NaN for metrics of whole sets."""
        rows = np.ma.masked_invalid([self._of_piece(piece) for piece in pieces])
        return np.ma.average(rows, axis=0, weights=[len(piece.positions) for piece in pieces]).filled(np.nan)

    def _of_piece(self, take):
        positions, fps = np.asarray(take.positions, np.float64), take.fps
        if len(positions) < 2:
            return [np.nan] * len(METRICS)
        beats = metrics.motion_beats(positions, fps, self.threshold, self.maac)
        heights, speeds = metrics.wrist_heights(positions), metrics.wrist_speeds(positions, fps)
        found = {
            columns.BEAT_RATE: len(beats) * fps / len(positions),
            columns.SYNCHRONY: self.predictor.synchrony(take.features, positions),
            columns.MOTION_VARIANCE: metrics.motion_variance(positions),
            columns.WRIST_SPEED_LEFT: speeds[:, 0].mean(),
            columns.WRIST_SPEED_RIGHT: speeds[:, 1].mean(),
            columns.WRIST_SPEED_SPREAD: speeds.std(axis=0).mean(),
            columns.WRIST_HEIGHT_LEFT: heights[:, 0].mean(),
            columns.WRIST_HEIGHT_RIGHT: heights[:, 1].mean(),
            columns.WRIST_HEIGHT_SPREAD: heights.std(axis=0).mean(),
            columns.WRIST_ASYMMETRY: metrics.wrist_asymmetry(positions).mean(),
            columns.SPEED_HELLINGER: metrics.hellinger(metrics.speed_histogram([positions], fps), self.speeds),
            columns.ACCELERATION: metrics.acceleration(positions, fps),
            columns.JERK: metrics.jerk(positions, fps),
        }
        if take.onsets is not None:
            coverage = metrics.onset_coverage(beats, take.onsets)
            found[columns.BEAT_CONSISTENCY] = coverage
            found[columns.BEAT_EXCESS] = coverage - metrics.chance_coverage(beats, take.onsets, len(positions) / fps)
        return [found.get(name, np.nan) for name in METRICS]


def _of_latents(own, test, train, reference):
    """{metric: (value, deviation)} of the metrics that compare whole sets of windows; {} if they do not apply."""
    if min(len(own), len(test)) < 2:
        notice(f"{reference.subject}: test clips hold fewer than two windows of {FRAMES} frames, so FGD does not apply")
        return {}
    draws = [metrics.diversity(own, seed=reference.seed + i) for i in range(DRAWS)]
    return {
        columns.FGD: (metrics.frechet_distance(own, test), np.nan),
        columns.FGD_TRAIN: (metrics.frechet_distance(own, train), np.nan),
        columns.DIVERSITY: mean_and_deviation(draws),
    }
