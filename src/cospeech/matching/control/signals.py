"""Control signals: one number per frame, a function of the positions, to which a user adds by one function.

    from cospeech.matching.control.signals import signal

    @signal("m")
    def head_height(positions, fps):
        return positions[:, 12, 1]

An installed package adds its own through the entry-point group `cospeech.signals`, each naming such a function.
"""

from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points

import numpy as np

from cospeech.errors import CospeechError
from cospeech.matching.database.descriptors import WINDOW
from cospeech.matching.database.sources import stretches
from cospeech.skeleton import UPPER55

LEFT, RIGHT = UPPER55.joints("left_wrist", "right_wrist")
GROUP = "cospeech.signals"  # entry points of other packages
PERCENTILES = (0, 5, 10, 15, 25, 40, 50, 60, 75, 85, 90, 95, 100)  # kept with the signals of a database

SIGNALS = {}  # {name: Signal}, in the order in which they are listed


@dataclass(frozen=True)
class Signal:
    """A number per frame. `compute(positions (T, 55, 3) metres, fps) -> (T,)` in `unit`; names of both outer levels.

    compute is None for a signal that only a database tells of.
    """

    compute: object
    unit: str
    lower: str
    upper: str
    about: str = ""

    @classmethod
    def of(cls, compute, unit, lower="low", upper="high"):
        """From a function, whose docstring tells what it measures."""
        return cls(compute, unit, lower, upper, " ".join((compute.__doc__ or "").split()))

    @property
    def levels(self):
        """{level: whether it lies above its percentile}."""
        return {self.lower: False, self.upper: True}

    def __call__(self, positions, fps):
        if self.compute is None:
            raise CospeechError(
                f"control signal ({self.about}): kept in the database, but its function is not installed here"
            )
        return np.asarray(self.compute(positions, fps))


def signal(unit, lower="low", upper="high"):
    """Decorator: makes a function of continuous positions a control signal under the function's name.

    Its docstring tells lists what it measures.
    """

    def register(compute):
        SIGNALS[compute.__name__] = Signal.of(compute, unit, lower, upper)
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


def load_plugins():
    """Register the signals of installed packages; one that cannot be imported is a CospeechError that names it."""
    for entry in entry_points(group=GROUP):
        try:
            compute = entry.load()
        except (ImportError, AttributeError) as error:
            raise CospeechError(f"control signal {entry.name!r} of {entry.value!r}: {error}; reinstall it") from error
        if compute.__name__ not in SIGNALS:  # it used the decorator `signal` or, without, it is in metres
            signal("m")(compute)


load_plugins()


@dataclass(frozen=True)
class StoredSignal:
    """A signal of a database's frames: values (M, F) float32, what `Signal` tells, and {percentile: value}."""

    values: np.ndarray
    unit: str
    lower: str
    upper: str
    about: str
    percentiles: dict = field(default_factory=dict)

    @classmethod
    def of(cls, one, values, covered):
        """Of a `Signal`; percentiles over the `covered` (M, F) bool frames."""
        found = np.percentile(values[covered], PERCENTILES)
        percentiles = dict(zip(PERCENTILES, map(float, found), strict=True))
        return cls(values, one.unit, one.lower, one.upper, one.about, percentiles)

    def known(self, name):
        """Make controls of this name understood where its function is not."""
        SIGNALS.setdefault(name, Signal(None, self.unit, self.lower, self.upper, self.about))


def signal_values(name, compute, database, known=()):
    """(M, F) float32: computed on continuous stretches, so that a clip knows the frame before it.

    known : (m, F) the values of the first clips, which are kept.
    """
    values, frames = np.empty(database.eligible.shape, np.float32), database.clip_frames
    values[: len(known)] = np.reshape(known, (-1, frames))
    for first, end in dict.fromkeys(zip(*stretches(database), strict=True)):
        part = slice(first // frames, end // frames)
        if part.start < len(known):
            continue
        positions = database.positions[part].reshape(-1, *database.positions.shape[2:])
        found = np.asarray(compute(positions, database.fps))
        if found.shape != (len(positions),) or not np.isfinite(found).all():
            raise CospeechError(f"control {name}: its function must give one finite number per frame")
        values[part] = found.reshape(-1, frames)
    return values


def covered_frames(eligible):
    """(M, F) bool -> (M, F) bool: the frames that can be generated, those of every eligible window."""
    covered = eligible.copy()
    for shift in range(1, WINDOW):
        covered[:, shift:] |= eligible[:, :-shift]
    return covered


class ControlSignals:
    """The signals of every frame of a `Database` and their percentiles: as stored, else computed when first asked."""

    def __init__(self, database):
        self.database = database
        self.values = cache(self._values)
        self.percentile = cache(self._percentile)
        for name, stored in database.signals.items():
            stored.known(name)

    def _values(self, name):
        """(M, F) float32."""
        stored = self.database.signals.get(name)
        return signal_values(name, SIGNALS[name], self.database) if stored is None else stored.values

    def _percentile(self, name, percentile):
        """Over the frames that can be generated."""
        stored = self.database.signals.get(name)
        if stored is not None and percentile in stored.percentiles:
            return stored.percentiles[percentile]
        return float(np.percentile(self.values(name)[covered_frames(self.database.eligible)], percentile))
