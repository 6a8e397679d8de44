"""What the search compares: where hands and arms go next, and what is about to be said (thesis 5.3.1.2)."""

from dataclasses import dataclass

import numpy as np

from cospeech.skeleton import UPPER55

WINDOW = 8  # N of Algorithm 1: frames copied at each step
POSE_STEPS = (0, 2, 4, 6)  # frames ahead that a pose feature holds, 0.5 s at 15 fps
AUDIO_STEPS = (0, 2, 4, 6, 8, 10, 12, 14)  # frames ahead that an audio feature holds, 1 s at 15 fps
LOOKAHEAD = max(AUDIO_STEPS)
STATIC = 14  # 13 MFCC and the log energy lead the 28 speech features; their derivatives are not searched
JOINTS = UPPER55.joints(
    "right_elbow", "right_wrist", "left_elbow", "left_wrist",
    "right_index_0", "right_little_0", "left_index_0", "left_little_0",
)  # fmt: skip
POSE_WIDTH = 3 * len(JOINTS) * len(POSE_STEPS)  # 96
AUDIO_WIDTH = STATIC * len(AUDIO_STEPS)  # 112
CONSTANT = 1e-5  # a dimension that deviates less (metres, or MFCC units) carries no information


def pose_features(positions):
    """(T, 55, 3) metres -> (T, 96): 8 joints x 3 axes at t, t+2, t+4, t+6. Past the end the last frame is repeated."""
    return _ahead(positions[:, JOINTS].reshape(len(positions), -1), POSE_STEPS)


def audio_features(features):
    """(T, 28) speech features -> (T, 112): 14 values at t, t+2, ..., t+14. Past the end the last frame is repeated."""
    return _ahead(features[:, :STATIC], AUDIO_STEPS)


def _ahead(values, steps):
    frames = np.minimum(np.arange(len(values))[:, None] + steps, len(values) - 1)
    return values[frames].reshape(len(values), -1)


def real_ahead(valid):
    """(T,) bool -> (T,) bool: this frame and all LOOKAHEAD frames after it exist and are valid.

    Such a frame's two features are real, and so are the 8 frames from it and the pose feature of the last of them.
    """
    bad = np.concatenate([[0], np.cumsum(~valid)])
    last = np.arange(len(valid)) + LOOKAHEAD + 1
    return (last <= len(valid)) & (bad[np.minimum(last, len(valid))] == bad[:-1])


@dataclass(frozen=True)
class Normalization:
    """z-normalisation by the database: `mean`, `std` (D,) float64; a dimension without variance is only centred."""

    mean: np.ndarray
    std: np.ndarray

    @classmethod
    def fit(cls, rows):
        """From (n, D) rows; sums are kept in float64 and no copy of the rows is made."""
        blocks = range(0, len(rows), 65536)
        mean = sum(rows[i : i + 65536].sum(axis=0, dtype=np.float64) for i in blocks) / len(rows)
        square = sum(((rows[i : i + 65536] - mean) ** 2).sum(axis=0) for i in blocks) / len(rows)
        std = np.sqrt(square)
        return cls(mean, np.where(std > CONSTANT, std, 1.0))

    def __call__(self, features):
        """(..., D) -> (..., D) float32."""
        return ((features - self.mean) / self.std).astype(np.float32)
