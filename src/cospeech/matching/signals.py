"""Control signals: one number per frame, a function of the positions, to which a user adds by one function."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from cospeech.errors import CospeechError
from cospeech.matching.features import WINDOW
from cospeech.skeleton import UPPER55

LEFT, RIGHT = UPPER55.joints("left_wrist", "right_wrist")

SIGNALS = {}  # {name: Signal}, in the order in which they are listed


@dataclass(frozen=True)
class Signal:
    """A number per frame. `compute(positions (T, 55, 3) metres, fps) -> (T,)` in `unit`; names of both outer levels."""

    compute: object
    unit: str
    lower: str
    upper: str

    @property
    def levels(self):
        """{level: whether it lies above its percentile}."""
        return {self.lower: False, self.upper: True}

    @property
    def about(self):
        """What it measures, for lists: the function's docstring."""
        return " ".join((self.compute.__doc__ or "").split())

    def __call__(self, positions, fps):
        return np.asarray(self.compute(positions, fps))


def signal(unit, lower="low", upper="high"):
    """Decorator: makes a function of continuous positions a control signal under the function's name."""

    def register(compute):
        SIGNALS[compute.__name__] = Signal(compute, unit, lower, upper)
        return compute

    return register


@signal("m")
def left_wrist_height(positions, fps):
    """height of the left wrist above the pelvis"""
    return positions[:, LEFT, 1]


@signal("m")
def right_wrist_height(positions, fps):
    """height of the right wrist above the pelvis"""
    return positions[:, RIGHT, 1]


@signal("m/s", "slow", "fast")
def left_wrist_speed(positions, fps):
    """how fast the left wrist moves"""
    return speed(positions[:, LEFT], fps)


@signal("m/s", "slow", "fast")
def right_wrist_speed(positions, fps):
    """how fast the right wrist moves"""
    return speed(positions[:, RIGHT], fps)


@signal("m", "symmetric", "asymmetric")
def symmetry(positions, fps):
    """difference of the wrists' heights, without sign"""
    return np.abs(positions[:, LEFT, 1] - positions[:, RIGHT, 1])


@signal("m")
def hand_distance(positions, fps):
    """distance between the wrists"""
    return np.linalg.norm(positions[:, LEFT] - positions[:, RIGHT], axis=-1)


@signal("m")
def reach(positions, fps):
    """how far the farther wrist is from the vertical line through the pelvis"""
    return np.linalg.norm(positions[:, [LEFT, RIGHT]][..., [0, 2]], axis=-1).max(axis=1)


def speed(points, fps):
    """(T, 3) metres -> (T,) metres per second since the frame before; the first frame has the second one's speed.

    Backward, because the frames after a take's last clip are not in the database, those before its other clips are.
    """
    moved = np.linalg.norm(np.diff(points, axis=0), axis=-1) * fps
    return np.concatenate([moved[:1], moved]) if len(moved) else np.zeros(len(points))


class ControlSignals:
    """The signals of every frame of a `Database` and their percentiles, computed when first asked for."""

    def __init__(self, database):
        self.database = database
        self.values = cache(self._values)
        self.percentile = cache(self._percentile)

    def _values(self, name):
        """(M, F) float32: computed on continuous stretches, so that a clip's first frame knows the one before it."""
        database = self.database
        frames, values = database.clip_frames, np.empty(database.eligible.shape, np.float32)
        follows = (np.diff(database.take) == 0) & np.isclose(np.diff(database.start) * database.fps, frames, atol=0.5)
        for stretch in np.split(np.arange(len(database)), np.flatnonzero(~follows) + 1):
            part = slice(stretch[0], stretch[-1] + 1)
            positions = database.positions[part].reshape(-1, *database.positions.shape[2:])
            found = SIGNALS[name](positions, database.fps)
            if found.shape != (len(positions),) or not np.isfinite(found).all():
                raise CospeechError(f"control {name}: its function must give one finite number per frame")
            values[part] = found.reshape(-1, frames)
        return values

    def _percentile(self, name, percentile):
        """Over the frames that can be generated, those of every eligible window."""
        usable = self.database.eligible.copy()
        for ahead in range(1, WINDOW):
            usable[:, ahead:] |= self.database.eligible[:, :-ahead]
        return float(np.percentile(self.values(name)[usable], percentile))
