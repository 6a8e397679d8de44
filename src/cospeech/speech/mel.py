"""Log-mel spectrograms of HA2G and of Speech2Gesture at 16 kHz, and which of their columns a window of motion hears."""

import numpy as np

from cospeech.speech.mfcc import RATE

BINS, FFT, HOP = 128, 1024, 512  # of HA2G
RANGE = 80.0  # dB
COLUMNS = 70  # that 34 frames at 15 Hz hear: round((34 / 15 * 16000 - 1024) / 512 + 1)
S2G_BINS, S2G_FFT, S2G_WINDOW, S2G_HOP = 64, 512, 400, 160  # of Speech2Gesture
S2G_BAND = (125.0, 7500.0)  # Hz
S2G_COLUMNS = 225  # windows that lie wholly in 34 frames at 15 Hz


def log_mel(samples):
    """HA2G's spectrogram: samples (N,) at 16 kHz -> (128, 1 + N // 512) float32, dB below its loudest value, -80 to 0.

    Column i is centred on sample 512 i. Sound that is silent throughout is -80.
    """
    import librosa

    power = librosa.feature.melspectrogram(
        y=np.asarray(samples, np.float32), sr=RATE, n_fft=FFT, hop_length=HOP, n_mels=BINS, power=2.0
    )
    if not power.any():
        return np.full(power.shape, -RANGE, np.float32)
    return librosa.power_to_db(power, ref=np.max, top_db=RANGE).astype(np.float32)


def log_mel_s2g(samples):
    """Speech2Gesture's spectrogram: samples (N,) at 16 kHz, N >= 400 -> (64, 1 + (N - 400) // 160) float32.

    Natural logarithm of the mel amplitude + 1e-6; column i begins at sample 160 i.
    """
    import librosa

    amplitude = np.abs(
        librosa.stft(
            np.pad(np.asarray(samples, np.float32), (0, S2G_FFT - S2G_WINDOW)),
            n_fft=S2G_FFT,
            hop_length=S2G_HOP,
            window=np.pad(librosa.filters.get_window("hann", S2G_WINDOW), (0, S2G_FFT - S2G_WINDOW)),
            center=False,
        )
    )
    low, high = S2G_BAND
    bank = librosa.filters.mel(sr=RATE, n_fft=S2G_FFT, n_mels=S2G_BINS, fmin=low, fmax=high, htk=True, norm=None)
    return np.log(bank @ amplitude + 1e-6).astype(np.float32)


def column_at(seconds, hop):
    """The column of a spectrogram that a window beginning at `seconds` begins with; for arrays too."""
    return np.rint(np.asarray(seconds) * RATE / hop).astype(np.int64)
