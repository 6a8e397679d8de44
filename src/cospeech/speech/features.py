"""The 28 speech features of every motion frame (thesis 4.3.3 and 5.3.1)."""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.speech.loudness import TARGET, normalize_loudness
from cospeech.speech.mfcc import CHUNK, COEFFICIENTS, HOP, RATE, WINDOW, cepstra, windows

STATIC = COEFFICIENTS + 1  # and the log energy
VARIANTS = ("averaged", "published")


def speech_features(waveform, sample_rate, fps=15.0, frames=None, *, variant="averaged", loudness=TARGET):
    """Speech features at the motion's frame rate.

    waveform (N,) floats, full scale 1, at any `sample_rate` (Hz). Returns (T, 28) float32, always finite: 13 Sphinx
    MFCC, the log energy log(1 + mean(x^2)) of 16 bit samples, then the time derivatives of these 14 (per frame, central
    differences). T = `frames`, or round(N / sample_rate * fps); longer sound is cut, shorter is followed by zeros.

    The waveform is brought to `loudness` LUFS by a pure gain first (None leaves its level) and resampled to 16 kHz.
    Frame i looks at the sound around sample round(i * 16000 / fps), so nothing drifts however long the sound is.
    variant "averaged": as many windows of 25.6 ms every 10 ms as reach to the neighboring frames, their values
    averaged, so no sound goes unheard. "published": one window at each frame; at 15 Hz it skips 41 of every 67 ms.
    """
    waveform = _checked(waveform, sample_rate, fps, variant)
    frames = round(len(waveform) * fps / sample_rate) if frames is None else frames
    if loudness is not None:
        waveform = normalize_loudness(waveform, int(sample_rate), loudness)
    starts = _window_starts(frames, fps, len(waveform) / sample_rate, variant)
    samples = _resample(waveform, sample_rate)
    step = max(1, CHUNK // starts.shape[1])
    parts = [_static(samples, starts[i : i + step]) for i in range(0, frames, step)]
    static = np.concatenate([np.zeros((0, STATIC)), *parts])
    change = np.gradient(static, axis=0) if frames > 1 else np.zeros_like(static)
    return np.concatenate([static, change], axis=1).astype(np.float32)


def _checked(waveform, sample_rate, fps, variant):
    waveform = np.asarray(waveform, np.float32)
    if waveform.ndim != 1:
        raise CospeechError(f"speech features: the waveform has shape {waveform.shape}, expected one channel (N,)")
    if not np.isfinite(waveform).all():
        first = int(np.argmin(np.isfinite(waveform)))
        raise CospeechError(f"speech features: the waveform holds NaN or infinity, first at sample {first}")
    if not sample_rate > 0 or not fps > 0:
        raise CospeechError(f"speech features: sample rate {sample_rate} and fps {fps} must be positive")
    if variant not in VARIANTS:
        raise CospeechError(f"speech features: variant {variant!r} is unknown, expected one of {', '.join(VARIANTS)}")
    return waveform


def _window_starts(frames, fps, duration, variant):
    """(T, K) first samples of each frame's K windows; K is odd."""
    hops = RATE / fps / HOP  # from one motion frame to the next
    reach = 0 if variant == "published" else max(0, int(np.ceil((hops - 1) / 2)))
    centers = np.rint(np.arange(frames)[:, None] * RATE / fps) + np.arange(-reach, reach + 1) * HOP
    # Windows centered outside the clip would average a floor of pure zeros into its first and last frames.
    length = max(duration, frames / fps) * RATE
    return np.clip(centers, 0, max(round(length) - 1, 0)).astype(np.int64) - WINDOW // 2


def _static(samples, starts):
    """(T, 14) coefficients and log energy, averaged over the K windows of `starts` (T, K)."""
    plain, emphasized = windows(samples, starts.ravel())
    energy = np.log1p(np.mean(plain**2, axis=1, keepdims=True))
    return np.concatenate([cepstra(emphasized), energy], axis=1).reshape(*starts.shape, STATIC).mean(axis=1)


def _resample(waveform, sample_rate):
    if sample_rate == RATE or not len(waveform):
        return waveform
    import soxr

    return soxr.resample(waveform, sample_rate, RATE, quality="HQ")
