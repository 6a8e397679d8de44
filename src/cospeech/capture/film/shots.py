"""Shot cuts: where the picture changes at once, by the difference of colour histograms."""

import numpy as np

BINS = 8  # a channel
GRID = 2  # histograms of the picture's quarters: a cut between similar rooms moves colours about
THRESHOLD = 0.35  # share of pixels that change their bin, over the recent course
COURSE = 4.0  # times the recent mean: fast motion and zooms change much in every picture, a cut in one
WIDTH = 96  # pixels: enough for histograms


class ShotDetector:
    """Looks at pictures in order and tells which of them begins a new shot."""

    def __init__(self):
        self._last = None
        self._course = 0.0

    def is_cut(self, rgb):
        """Whether `rgb` (height, width, 3) uint8 begins a new shot; never for the first picture."""
        histogram = colour_histogram(rgb)
        if self._last is None:
            self._last = histogram
            return False
        change = 0.5 * np.abs(histogram - self._last).sum() / GRID**2
        self._last = histogram
        cut = change > max(THRESHOLD, COURSE * self._course)
        self._course = 0.0 if cut else 0.8 * self._course + 0.2 * change
        return bool(cut)


def colour_histogram(rgb):
    """(GRID**2, BINS**3) shares of the colours in each quarter of a picture; every row adds up to 1."""
    step = max(rgb.shape[1] // WIDTH, 1)
    small = (rgb[step // 2 :: step, step // 2 :: step] >> 5).astype(np.int32)
    colour = (small[..., 0] * BINS + small[..., 1]) * BINS + small[..., 2]
    blocks = [block for row in np.array_split(colour, GRID) for block in np.array_split(row, GRID, axis=1)]
    counts = np.stack([np.bincount(block.ravel(), minlength=BINS**3) for block in blocks])
    return counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
