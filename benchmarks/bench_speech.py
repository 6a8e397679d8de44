"""Speed of the speech room beside the obvious alternatives: `python benchmarks/bench_speech.py [seconds]`.

Each row: how many times faster than real time ours is, and its ratio to the alternative in the same run (above 1: ours
is faster). Best of three, CPU time of this process.
"""

import sys
import tempfile
from functools import partial
from pathlib import Path

import librosa
import numpy as np
from timing import PROCESSOR, fastest

from cospeech.speech import audio_duration, integrated_loudness, load_audio, speech_features, speech_onsets, write_wav
from cospeech.speech.mfcc import cepstra, mfcc, windows

best = partial(fastest, times=3, clock=PROCESSOR, warm=True)


def one_by_one(samples, starts):
    """The loop over windows that the vectorized MFCC replaces."""
    return np.concatenate([cepstra(windows(samples, [start])[1]) for start in starts])


def librosa_features(samples):
    """The off-the-shelf features at 100 Hz (not Sphinx's: other scale, correlation 0.92 to 0.99)."""
    return librosa.feature.mfcc(y=samples, sr=16000, n_mfcc=13, n_fft=512, hop_length=160, n_mels=40)


def rows(samples, rate, path):
    """(what, ours, name of the alternative, alternative) of every hot path."""
    starts = np.arange(0, len(samples) - 410, 160)
    yield (
        "features, averaged",
        lambda: speech_features(samples, rate),
        "librosa MFCC, 100 Hz",
        lambda: librosa_features(samples),
    )
    published = lambda: speech_features(samples, rate, variant="published")
    yield "features, published", published, "averaged", lambda: speech_features(samples, rate)
    yield "MFCC, 100 Hz", lambda: mfcc(samples, starts), "a loop over windows", lambda: one_by_one(samples, starts)
    loudness = lambda: integrated_loudness(samples, rate)
    try:
        import pyloudnorm

        yield "loudness", loudness, "pyloudnorm", lambda: pyloudnorm.Meter(rate).integrated_loudness(samples)
    except ImportError:
        yield "loudness", loudness, "itself (no pyloudnorm)", loudness
    yield "load, to 22.05 kHz", lambda: load_audio(path, 22050), "librosa.load", lambda: librosa.load(path, sr=22050)
    yield "duration", lambda: audio_duration(path), "load", lambda: load_audio(path)
    yield "onsets", lambda: speech_onsets(samples, rate), "features", lambda: speech_features(samples, rate)


def main(seconds):
    noise = np.random.default_rng(0).normal(size=16000 * seconds)
    samples = (0.1 * noise * np.abs(np.sin(np.arange(len(noise)) / 3000))).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.wav")
        write_wav(path, np.clip(samples, -1, 1), 16000)
        for what, ours, name, alternative in rows(samples, 16000, path):
            own, other = best(ours), best(alternative)
            print(f"{what:22} {seconds / own:9.0f} x real time   {other / own:7.2f} x {name}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
