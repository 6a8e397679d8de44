"""Training windows: fixed-length stretches of valid frames, cut from clips and drawn at random."""

import numpy as np

from cospeech.errors import CospeechError

CONSTANT = 1e-4  # metres, radians or speech units: a channel that deviates less from its mean does not move


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
        self.valid = np.concatenate(valid).astype(bool)
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

    def statistics(self, name):
        """Mean and deviation (C,), (C,) over the valid frames; the deviation of a constant channel is 0."""
        return moments([self.arrays[name][self.valid]])


def moments(blocks, constant=CONSTANT):
    """Mean and deviation (C,), (C,) float32 over all rows of (n, C) blocks; a deviation up to `constant` is 0."""
    count = mean = square = 0
    for block in blocks:  # blocks are joined by their means, which loses no digits as sums of squares do
        block = block.astype(np.float64)
        own, total = block.mean(axis=0), count + len(block)
        square = square + ((block - own) ** 2).sum(axis=0) + (own - mean) ** 2 * (count * len(block) / total)
        mean = mean + (own - mean) * (len(block) / total)
        count = total
    deviation = np.sqrt(square / count)
    return mean.astype(np.float32), np.where(deviation > constant, deviation, 0.0).astype(np.float32)


def divisor(deviation):
    """What z-scoring divides by: the deviation, and 1 for a constant channel, which then is 0 throughout."""
    return np.where(deviation > 0, deviation, 1.0).astype(np.float32)
