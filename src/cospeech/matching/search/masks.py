"""Masks over the database: which frames a window may start with, window by window."""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.matching.database.descriptors import WINDOW, shift


class Masks:
    """The frames at which a window may start, window by window: eligible, and in the mask with its first and last.

    mask : None, (M, F) or (W, M, F) bool, or a function of the window's number that gives (M, F) bool or None.
    windows : W, or None when nobody knows it yet.
    """

    def __init__(self, database, mask, windows):
        self.database, self.restrict = database, mask is not None
        self._each = self._one = None
        if mask is None:
            self._one = database.eligible
        elif callable(mask):
            self._each = mask
        else:
            self._take(np.asarray(mask), windows)

    def _take(self, mask, windows):
        shape = self.database.eligible.shape
        count = len(mask) if windows is None and mask.ndim == 3 else windows
        if mask.dtype != bool or mask.shape not in (shape, (count, *shape)):
            self._refuse(mask, f" or {('windows' if windows is None else int(windows), *shape)}")
        if mask.ndim == 2:
            self._one = self._both_ends(mask)
        else:
            self._each = lambda window: _row(mask, window)

    def _refuse(self, mask, alternative=""):
        expected = f"bool of shape {self.database.eligible.shape}{alternative}"
        raise CospeechError(f"mask: {mask.dtype} of shape {mask.shape}, expected {expected}")

    def allowed(self, window):
        """(M, F) bool for the given window."""
        if self._one is not None:
            return self._one
        mask = self._each(window)
        if mask is None:
            return self.database.eligible
        mask = np.asarray(mask)
        if mask.dtype != bool or mask.shape != self.database.eligible.shape:
            self._refuse(mask, f" for window {window}")
        return self._both_ends(mask)

    def _both_ends(self, mask):
        return self.database.eligible & mask & shift(mask, WINDOW - 1)


def _row(mask, window):
    if window >= len(mask):
        raise CospeechError(f"mask: made for {len(mask)} windows, but the speech goes on")
    return mask[window]
