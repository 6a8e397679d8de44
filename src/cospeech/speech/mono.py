"""One channel of what was recorded: the downmix, channels that would cancel, a constant offset."""

from dataclasses import dataclass

import numpy as np

# ITU-R BS.775, downmix of 3/2 to 1/0; the low-frequency channel is left out. Other loudspeakers count as surround.
FRONT, CENTRE, SURROUND = 0.7071, 1.0, 0.5
WEIGHTS = {"FL": FRONT, "FR": FRONT, "FC": CENTRE, "LFE": 0.0, "LFE2": 0.0}
UNNAMED = {"NONE", "UNK", "UNSD"}
OPPOSITE = -0.5  # correlation with the loudest channel; that of wide stereo stays above -0.3
OFFSET = 2e-4  # of full scale, 7 steps of 16 bit: less leaves the log energy's correlation above 0.99
BLOCK = 0.1  # seconds; whole periods of 50 and 60 Hz hum
QUIET = 0.1  # share of the blocks that are the pauses
HIDDEN = 0.05  # of the pauses' own deviation: adds a quarter of a percent to their energy


@dataclass
class Downmix:
    """Channels to one. signs (C,) turns channels; None turns none. It keeps what it sees of their products (C, C)."""

    signs: np.ndarray | None = None
    products: np.ndarray | None = None

    def __call__(self, channels, names):
        """(N,) float32 of `channels` (C, N) float32, whose loudspeakers have FFmpeg's `names`; the weights sum to 1."""
        if len(channels) == 1:
            return channels[0]
        products = np.cov(channels, bias=True) * channels.shape[1]  # about the block's mean: an offset is no likeness
        if self.products is None:
            self.products = products
        elif self.products.shape == products.shape:
            self.products += products
        if self.signs is not None and len(self.signs) == len(channels):
            channels = channels * self.signs[:, None]
        weights = np.array([1.0 if name in UNNAMED else WEIGHTS.get(name, SURROUND) for name in names], np.float32)
        if not weights.any() or np.ptp(weights) == 0:
            return channels.mean(axis=0, dtype=np.float32)
        return (weights / weights.sum()) @ channels

    def opposite(self):
        """(signs (C,) that keep channels of opposite phase from cancelling, their lowest correlation), or None."""
        if self.products is None:
            return None
        power = np.diag(self.products)
        loudest = int(power.argmax())
        likeness = self.products[loudest] / np.sqrt(np.maximum(power * power[loudest], 1e-30))
        if not (likeness < OPPOSITE).any():
            return None
        return np.where(likeness < OPPOSITE, -1, 1).astype(np.float32), float(likeness.min())


def offset_of(samples, rate, scale=1.0):
    """The constant offset of (N,) samples, full scale `scale`; 0.0 where there is none to speak of.

    Measured in the pauses, as it is there that it is heard: the median of the means of the quietest blocks, where it
    stands out of their spread. The mean of all would be that of the voice too, whose pulses have one side.
    """
    size = round(BLOCK * rate)
    blocks = samples[: len(samples) // size * size].reshape(-1, size) if size else samples[:0, None]
    blocks = blocks[blocks.any(axis=1)]  # exact zeros were put there by a decoder or an editor
    if not len(blocks):
        return 0.0
    deviation = blocks.std(axis=1)
    quiet = np.argsort(deviation, kind="stable")[: max(5, round(QUIET * len(blocks)))]
    means = blocks[quiet].mean(axis=1, dtype=np.float64)
    offset = float(np.median(means))
    least = max(OFFSET * scale, 2 * means.std(), HIDDEN * np.median(deviation[quiet]))
    return offset if abs(offset) > least else 0.0
