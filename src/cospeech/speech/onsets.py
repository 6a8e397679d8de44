"""Speech onsets, the audio side of the beat consistency score."""

import numpy as np

RATE = 16000
WINDOW = 2048  # librosa's, which it wants filled


def speech_onsets(samples, rate):
    """Seconds of the onsets in `samples` (N,) floats: librosa's `onset_detect` at 16 kHz, as HA2G defines audio beats.

    Returns (K,) float64, ascending; empty for silence.
    """
    import librosa
    import soxr

    samples = np.asarray(samples, np.float32)
    if not samples.any():
        return np.zeros(0)
    samples = samples if rate == RATE else soxr.resample(samples, rate, RATE, quality="HQ")
    samples = np.pad(samples, (0, max(0, WINDOW - len(samples))))
    return np.asarray(librosa.onset.onset_detect(y=samples, sr=RATE, units="time"), np.float64)
