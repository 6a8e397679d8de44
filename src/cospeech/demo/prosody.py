"""Loudness, pitch and accents of the virtual speaker's speech, measured on the sound itself."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import resample_poly

LOUDNESS_WINDOW = 0.05  # s
SILENCE_DB = -70.0
PITCH_RANGE = (60.0, 450.0)  # Hz
PITCH_RATE_DIVISOR = 4  # 22.05 kHz / 4: enough for the fundamental, and four times as fast
EMPHASIS_BONUS = 0.7
SONORANTS = frozenset("mnŋlɹrwj")


@dataclass
class Prosody:
    """Prosody of a take.

    loudness (N,) dB of full scale and pitch (N,) Hz (0 where unvoiced), at the motion's frames; per word: accent_time
    (W,) s, the middle of the most stressed vowel; accent (W,) 0..1, how loud, high and emphasized that vowel is beside
    the take's others; stressed (W,) bool, the word carries primary stress.
    """

    loudness: np.ndarray
    pitch: np.ndarray
    accent_time: np.ndarray
    accent: np.ndarray
    stressed: np.ndarray


def measure_prosody(speech, frames, fps):
    """Prosody of a Speech at `frames` frames i/fps."""
    samples = speech.samples.astype(np.float32) / 32768
    loudness = loudness_track(samples, speech.rate, frames, fps)
    pitch = np.where(_voiced(speech.phonemes, frames, fps), pitch_track(samples, speech.rate, frames, fps), 0.0)
    vowel = _stressed_vowels(speech.phonemes, len(speech.words))
    start, end = speech.phonemes.start[vowel], speech.phonemes.end[vowel]
    loud, high = (_mean_between(track, start, end, fps) for track in (loudness, np.log(np.where(pitch, pitch, np.nan))))
    score = 0.5 * _standardized(loud) + 0.5 * _standardized(high) + EMPHASIS_BONUS * speech.emphasized
    accent = 1 / (1 + np.exp(-1.5 * score))
    return Prosody(loudness, pitch, (start + end) / 2, accent, speech.phonemes.stress[vowel] == 2)


def loudness_track(samples, rate, frames, fps):
    """(N,) level in dB of full scale within a window of 50 ms around each frame; never below -70 dB."""
    energy = np.concatenate([[0.0], np.cumsum(samples.astype(np.float64) ** 2)])
    centre = np.arange(frames) * rate / fps
    low = np.clip(centre - LOUDNESS_WINDOW / 2 * rate, 0, len(samples)).astype(int)
    high = np.clip(centre + LOUDNESS_WINDOW / 2 * rate, 0, len(samples)).astype(int)
    mean = (energy[high] - energy[low]) / np.maximum(high - low, 1)
    return 10 * np.log10(np.maximum(mean, 10 ** (SILENCE_DB / 10)))


def pitch_track(samples, rate, frames, fps):
    """(N,) fundamental frequency in Hz by YIN (de Cheveigne & Kawahara 2002); meaningless where nothing is voiced."""
    import librosa

    low_rate, hop = rate / PITCH_RATE_DIVISOR, 64
    slow = resample_poly(samples, 1, PITCH_RATE_DIVISOR)
    pitch = librosa.yin(slow, fmin=PITCH_RANGE[0], fmax=PITCH_RANGE[1], sr=low_rate, frame_length=256, hop_length=hop)
    nearest = np.clip(np.round(np.arange(frames) / fps * low_rate / hop).astype(int), 0, len(pitch) - 1)
    return pitch[nearest]


def _voiced(phonemes, frames, fps):
    """(N,) bool: the frame lies in a vowel or another sonorant."""
    sonorant = phonemes.vowel | np.array([p[:1] in SONORANTS for p in phonemes.ipa], bool)
    at = np.searchsorted(phonemes.start, np.arange(frames) / fps, side="right") - 1
    inside = (at >= 0) & (np.arange(frames) / fps < phonemes.end[at])
    return inside & sonorant[at]


def _stressed_vowels(phonemes, words):
    """(W,) index of each word's most stressed phoneme: stress first, then vowels before consonants, then length."""
    duration = phonemes.end - phonemes.start
    rank = phonemes.stress * 10 + phonemes.vowel * 5 + np.minimum(duration, 1)
    order = np.lexsort((rank, phonemes.word))
    last = np.searchsorted(phonemes.word[order], np.arange(words), side="right") - 1
    return order[last]


def _mean_between(track, start, end, fps):
    """Mean of a track's known values between two times, per interval; its overall mean where none is known."""
    known = np.isfinite(track)
    total = np.concatenate([[0.0], np.cumsum(np.where(known, track, 0.0))])
    count = np.concatenate([[0], np.cumsum(known)])
    a = np.clip(np.floor(start * fps).astype(int), 0, len(track) - 1)
    b = np.clip(np.ceil(end * fps).astype(int) + 1, 1, len(track))
    overall = total[-1] / max(count[-1], 1)
    return np.where(count[b] > count[a], (total[b] - total[a]) / np.maximum(count[b] - count[a], 1), overall)


def _standardized(values):
    return (values - values.mean()) / max(values.std(), 1e-6)
