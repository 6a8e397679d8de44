"""What the resynchroniser is trained on: the speaker's own windows, and what k-NN makes of the same speech."""

import numpy as np

from cospeech.learning.windows import Windows, moments
from cospeech.matching.resync.fakes import fake_pairs
from cospeech.skeleton import to_parent_relative

BLOCK = 512  # windows of k-NN motion that statistics gather at a time


class Pairs:
    """Windows of (features, real motion, k-NN motion), one every `stride` frames; motions parent-relative (T, 165).

    Real frames are kept once, however many windows share them, and k-NN motion is gathered when it is asked for.
    """

    def __init__(self, windows, fakes):
        self.windows, self.fakes = windows, fakes

    def __len__(self):
        return len(self.windows)

    def take(self, which):
        """Windows by number (ints or a slice) -> {"features": (n, T, 28), "motion" and "matched": (n, T, 165)}."""
        return self.windows.take(which) | {"matched": relative(self.fakes[which])}

    def sample(self, rng, count):
        """`count` random windows, drawn with replacement."""
        return self.take(rng.integers(len(self), size=count))

    def real_motion(self):
        """The real windows, block by block: (n, T, 165)."""
        for i in range(0, len(self), BLOCK):
            yield self.windows.take(slice(i, i + BLOCK))["motion"]

    def statistics(self, name):
        """Mean and deviation (C,), (C,) float32 of "features", "motion" or "matched" over all frames of all windows.

        A real frame counts once, however many windows it is in.
        """
        if name == "matched":
            blocks = (relative(self.fakes[i : i + BLOCK]) for i in range(0, len(self), BLOCK))
            return moments(block.reshape(-1, block.shape[-1]) for block in blocks)
        array = self.windows.arrays[name]
        used = np.zeros(len(array), bool)
        used[self.windows.starts[:, None] + np.arange(self.windows.frames)] = True
        return moments([array[used]])


def training_pairs(clips, database, settings, seed, starts=None):
    """The `Pairs` of the training part, all of it: a window of `settings.frames` every `settings.stride` frames.

    k-NN places its windows as `settings.placement` says.

    starts : seconds at which each clip begins in its take (None: at 0), so that with a single take in the database a
    window is not matched with itself.
    """
    sequences = [{"features": clip.features, "motion": relative(clip.positions)} for clip in clips]
    windows = Windows(sequences, [clip.valid for clip in clips], settings.frames, settings.stride)
    takes = np.concatenate([np.full(len(clip), clip.clip) for clip in clips])[windows.starts]
    clock = [np.arange(len(c)) / c.fps + start for c, start in zip(clips, starts or [0.0] * len(clips), strict=True)]
    speech = windows.take(slice(None))["features"]
    begins, placement = np.concatenate(clock)[windows.starts], settings.placement
    return Pairs(windows, fake_pairs(database, speech, takes, begins, seed=seed, placement=placement))


def relative(positions):
    """(..., 55, 3) metres -> (..., 165) float32, each joint relative to its parent."""
    moved = to_parent_relative(np.asarray(positions, np.float32))
    return moved.reshape(*moved.shape[:-2], -1)
