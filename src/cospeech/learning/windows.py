"""Training windows: fixed-length stretches of valid frames, cut from clips and drawn at random."""

import numpy as np

from cospeech.errors import CospeechError


class Windows:
    """Every stretch of `frames` consecutive valid frames in a list of sequences; none straddles two sequences.

    Parameters
    ----------
    sequences : list of {name: (T, C) array}, one per clip, the same names in each.
    valid : list of (T,) bool, frames that training may use.
    frames, stride : length of a window and distance between the starts of two.

    Raises CospeechError when there is no such stretch.
    """

    def __init__(self, sequences, valid, frames=64, stride=1):
        self.frames = frames
        self.arrays = {name: np.concatenate([s[name] for s in sequences]) for name in sequences[0]}
        starts, offset = [], 0
        for mask in valid:
            run = np.convolve(mask, np.ones(frames, int), "valid") if len(mask) >= frames else np.zeros(0)
            starts.append(offset + np.flatnonzero(run == frames)[::stride])
            offset += len(mask)
        self.starts = np.concatenate(starts)
        if not len(self.starts):
            longest = max(int(mask.sum()) for mask in valid)
            raise CospeechError(
                f"training part: no {frames} valid frames in a row (the best clip has {longest}); give longer takes"
            )

    def __len__(self):
        return len(self.starts)

    def take(self, which):
        """Windows by number: (n,) ints -> {name: (n, frames, C)}."""
        index = self.starts[which][:, None] + np.arange(self.frames)
        return {name: array[index] for name, array in self.arrays.items()}

    def sample(self, rng, count):
        """`count` random windows, drawn with replacement."""
        return self.take(rng.integers(len(self), size=count))

    def statistics(self, name, floor=1e-4):
        """Mean and deviation (C,), (C,) over all frames; deviations under `floor` become 1 (constant channels)."""
        array = self.arrays[name].astype(np.float64)
        mean, deviation = array.mean(axis=0), array.std(axis=0)
        return mean.astype(np.float32), np.where(deviation > floor, deviation, 1.0).astype(np.float32)
