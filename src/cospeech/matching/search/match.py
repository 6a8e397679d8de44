"""What a search found: for every window of eight frames, where it is from and how well it fits."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from cospeech.matching.database.motion_database import Database

# One step of Algorithm 1: where the window starts, its ranks and distances, and whether the mask was set aside for it.
STEP = np.dtype(
    [
        ("clip", "i8"),
        ("frame", "i8"),
        ("pose_rank", "i8"),
        ("audio_rank", "i8"),
        ("pose_distance", "f4"),
        ("audio_distance", "f4"),
        ("unmasked", "?"),
    ]
)


@dataclass(frozen=True)
class Match:
    """What was found for W windows of 8 frames.

    clip, frame (W,) : where in the database each window starts.
    pose_rank, audio_rank (W,) : its 0-based ranks among the candidates; zeros where a variant does not use one.
    unmasked (W,) bool : the mask left no candidate here, so it was set aside for this window.
    frames : T, length of the speech; the last window is cut to it.
    pose_distance, audio_distance (W,) float32 : Euclidean distance of the chosen pose feature from the pose so far, and
        cosine distance (0 to 2) of the chosen audio feature from the speech, both z-normalised.
    """

    database: Database
    clip: np.ndarray
    frame: np.ndarray
    pose_rank: np.ndarray
    audio_rank: np.ndarray
    unmasked: np.ndarray
    frames: int
    pose_distance: np.ndarray = field(default=None, kw_only=True)
    audio_distance: np.ndarray = field(default=None, kw_only=True)

    @classmethod
    def of(cls, database, steps, frames):
        """From (W,) records of type `STEP`, for a speech of `frames` frames."""
        return cls(database, **{name: steps[name] for name in STEP.names}, frames=frames)

    @cached_property
    def positions(self):
        """(T, 55, 3) float32 metres, pelvis-relative: the matched windows one after the other, nothing changed."""
        return self.database.gestures(self.clip, self.frame)[: self.frames]

    @cached_property
    def rotation(self):
        """(T, 3) head rotation of the matched frames, or None."""
        if self.database.rotation is None:
            return None
        return self.database.gestures(self.clip, self.frame, "rotation")[: self.frames]

    @property
    def take(self):
        """(W,) names of the takes that the windows are from."""
        return np.array(self.database.takes, dtype=object)[self.database.take[self.clip]]

    @property
    def time(self):
        """(W,) seconds in these takes."""
        return self.database.time(self.clip, self.frame)
