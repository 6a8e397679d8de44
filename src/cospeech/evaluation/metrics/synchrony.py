"""Does a motion speed up when the speech says so? A score fitted on the training part and held out on the test."""

from dataclasses import dataclass

import numpy as np

from cospeech.evaluation.metrics.gesture_metrics import WRISTS

REACH = 0.5  # seconds of speech before and after a frame that its speed may depend on
RIDGE = 1.0  # penalty, in units of the features' variance; the score is flat from 0.3 to 3
FLOOR = 0.05  # m/s, added before the logarithm: slower than that is stillness


def log_speed(positions, fps=15.0):
    """Logarithm of the mean wrist speed of each frame (central difference), (T, 55, 3) -> (T,)."""
    velocity = np.gradient(np.asarray(positions[:, WRISTS], np.float64), axis=0) * fps
    return np.log(np.linalg.norm(velocity, axis=-1).mean(axis=1) + FLOOR)


def _context(features, fps):
    """Each frame's features with those of all frames within `REACH`, ends held: (T, C) -> (T, C * (2 reach + 1))."""
    reach = round(REACH * fps)
    padded = np.pad(np.asarray(features, np.float64), ((reach, reach), (0, 0)), mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0).reshape(len(features), -1)


@dataclass
class SpeechToSpeed:
    """Ridge regression from speech features around a frame to the log wrist speed of the frame, of one speaker.

    The correlation of its prediction with a motion's own log speed, on speech it was not fitted to, says how much the
    motion's activity follows the speech in this speaker's way: near 0 for motion of other speech, whatever its beats
    (the held-out form of GENEA's CCA, which refits on every test sequence).
    """

    mean: np.ndarray
    deviation: np.ndarray
    weights: np.ndarray
    fps: float

    @classmethod
    def fit(cls, features, motions, fps=15.0):
        """From lists of (T, C) speech features and (T, 55, 3) positions."""
        context = np.concatenate([_context(f, fps) for f in features])
        speed = np.concatenate([log_speed(positions, fps) for positions in motions])
        mean, deviation = context.mean(axis=0), context.std(axis=0)
        deviation[deviation < 1e-9] = 1.0
        context = (context - mean) / deviation
        penalty = RIDGE * len(context) * np.eye(context.shape[1])
        weights = np.linalg.solve(context.T @ context + penalty, context.T @ (speed - speed.mean()))
        return cls(mean, deviation, weights, fps)

    def predict(self, features):
        """Expected log speed less its mean, (T, C) -> (T,)."""
        return (_context(features, self.fps) - self.mean) / self.deviation @ self.weights

    def synchrony(self, features, positions):
        """Pearson r of predicted and actual log speed; NaN for motion or speech that does not change."""
        expected, actual = self.predict(features), log_speed(positions, self.fps)
        if len(actual) < 3 or min(expected.std(), actual.std()) < 1e-6:
            return float("nan")
        return float(np.corrcoef(expected, actual)[0, 1])
