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
    "right_elbow",
    "right_wrist",
    "left_elbow",
    "left_wrist",
    "right_index_0",
    "right_little_0",
    "left_index_0",
    "left_little_0",
)
POSE_WIDTH = 3 * len(JOINTS) * len(POSE_STEPS)  # 96
AUDIO_WIDTH = STATIC * len(AUDIO_STEPS)  # 112
CONSTANT = 1e-5  # a dimension that deviates less (metres, or MFCC units) carries no information


def pose_features(positions):
    """(T, 55, 3) metres -> (T, 96): 8 joints x 3 axes at t, t+2, t+4, t+6. Past the end the last frame is repeated."""
    return with_lookahead(joints_of(positions), POSE_STEPS)


def audio_features(features):
    """(T, 28) speech features -> (T, 112): 14 values at t, t+2, ..., t+14. Past the end the last frame is repeated."""
    return with_lookahead(features[:, :STATIC], AUDIO_STEPS)


def joints_of(positions):
    """(T, 55, 3) -> (T, 24): the searched joints."""
    return positions[:, JOINTS].reshape(len(positions), -1)


def with_lookahead(values, steps):
    """(T, C) -> (T, len(steps) C): each frame beside those so many frames after it, the last one repeated."""
    frames = np.minimum(np.arange(len(values))[:, None] + steps, len(values) - 1)
    return values[frames].reshape(len(values), -1)


def shift(frames, count):
    """(M, F) bool -> (M, F) bool: what holds `count` frames later, beyond a clip's end in the next clip; else False."""
    later = np.zeros_like(frames)
    later.flat[: frames.size - count] = frames.flat[count:]
    return later


def real_lookahead(valid):
    """(T,) bool -> (T,) bool: this frame and all LOOKAHEAD frames after it exist and are valid.

    Such a frame's two features are real, and so are the 8 frames from it and the pose feature of the last of them.
    """
    bad = np.concatenate([[0], np.cumsum(~valid)])
    last = np.arange(len(valid)) + LOOKAHEAD + 1
    return (last <= len(valid)) & (bad[np.minimum(last, len(valid))] == bad[:-1])


@dataclass(frozen=True)
class Moments:
    """Of all rows so far: their count, mean (D,) and summed squared deviations (D,), in float64.

    Rows are added stretch by stretch (Chan et al. 1979), so that adding later gives the same numbers to the last bit.
    """

    count: int
    mean: np.ndarray
    square: np.ndarray

    @classmethod
    def none(cls, width):
        return cls(0, np.zeros(width), np.zeros(width))

    def add(self, rows):
        """With (n, D) further rows -> Moments."""
        if not len(rows):
            return self
        rows = rows.astype(np.float64)
        mean, count = rows.mean(axis=0), self.count + len(rows)
        away = mean - self.mean
        square = self.square + ((rows - mean) ** 2).sum(axis=0) + away**2 * (self.count * len(rows) / count)
        return Moments(count, self.mean + away * (len(rows) / count), square)

    def normalization(self):
        """The `Normalization` by these rows."""
        std = np.sqrt(self.square / self.count)
        return Normalization(self.mean, np.where(std > CONSTANT, std, 1.0))


@dataclass(frozen=True)
class Normalization:
    """z-normalisation by the database: `mean`, `std` (D,) float64; a dimension without variance is only centred."""

    mean: np.ndarray
    std: np.ndarray

    def __call__(self, features):
        """(..., D) -> (..., D) float32."""
        return ((features - self.mean) / self.std).astype(np.float32)
