"""What a search is asked: speech features and options, checked; and what is told when a mask leaves nothing."""

import numpy as np

from cospeech.clip import FEATURES
from cospeech.errors import CospeechError, notice

VARIANTS = ("pose", "audio", "pose_only")


def checked(features, empty=False):
    """The speech features as an array; CospeechError unless they are finite and (T, 28)."""
    features = np.asarray(features)
    if features.ndim != 2 or features.shape[1] != FEATURES or not (empty or len(features)):
        raise CospeechError(f"speech features: shape {features.shape}, expected (frames, {FEATURES})")
    if not np.isfinite(features).all():
        frame = int(np.argwhere(~np.isfinite(features))[0][0])
        raise CospeechError(f"speech features: NaN or infinity, first in frame {frame}")
    return features


def check_options(k, variant):
    """CospeechError unless every k (an array) counts from 1 and the variant is one of `VARIANTS`."""
    if (k < 1).any():
        raise CospeechError(f"k is {k.min()}, but candidates are counted from 1, the best")
    if variant not in VARIANTS:
        raise CospeechError(f"variant {variant!r} is not known; known: {', '.join(VARIANTS)}")


def tell(unmasked, first=0):
    """Notice of the windows, counted from `first`, for which the mask was set aside."""
    windows = np.flatnonzero(unmasked) + first
    if len(windows):
        shown = ", ".join(map(str, windows[:8])) + (", ..." if len(windows) > 8 else "")
        notice(f"mask: it leaves nothing to match in window {shown}; set aside there")
