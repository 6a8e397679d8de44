"""The step into a window: what a strict control asks of a window's first frame, given the frame made before it.

Speeds of the database's frames know the frame that was recorded before them; where a window does not go on from the one
before, that is another one.
"""

from functools import cache

import numpy as np

from cospeech.matching.control.signals import SIGNALS
from cospeech.skeleton import UPPER55

STEPS = (75, 60, 45, 30)  # percentiles (mirrored for upper bounds) that the step gives way to; then it is not tested


class StepSignals:
    """The signals of n frames (n, 55, 3) if the frame before each is `last` (55, 3); for `Wanted.frames`."""

    def __init__(self, signals, last, into):
        self.signals, self.last, self.into = signals, last, into
        self.percentile = signals.percentile

    def values(self, name):
        """(n,) in the signal's unit."""
        pairs = np.stack([np.broadcast_to(self.last, self.into.shape), self.into], axis=1)
        pairs = pairs.reshape(-1, *self.last.shape)
        return SIGNALS[name](pairs, self.signals.database.fps)[1::2].astype(np.float32)


@cache
def needs_previous(signal):
    """Whether a `Signal` depends on the frame before, as speeds do; False for one whose function is not here."""
    if signal.compute is None:
        return False
    one, other = np.random.default_rng(0).normal(size=(2, len(UPPER55), 3))
    after = [signal(np.stack([before, other]), 15.0)[1] for before in (one, other)]
    return bool(after[0] != after[1])


def tested(controls):
    """Those of `controls` that ask something of the step: strict ones with a signal that looks back."""
    bounds = lambda control: (bound for bounds in control.wanted.alternatives for bound in bounds)
    return [
        control
        for control in controls
        if control.strict and any(needs_previous(SIGNALS[b.signal]) for b in bounds(control))
    ]


def steps_kept(controls, signals, last, starts):
    """Which windows of `starts` (M, F) bool keep what the `controls` ask of the step from `last` (55, 3) into them.

    Returns (M, F) bool and the name of the step that it took to find any, "" as asked.
    """
    clips, frames = np.nonzero(starts)
    steps = StepSignals(signals, last, signals.database.positions[clips, frames])
    for widened in (None, *STEPS):
        kept = np.logical_and.reduce([control.wanted.frames(steps, widened) for control in controls])
        if kept.any():
            found = np.zeros_like(starts)
            found[clips[kept], frames[kept]] = True
            return found, f"step percentile {widened}" if widened else ""
    return starts, "step not tested"
