"""Onsets where bursts begin, none where nothing does."""

import numpy as np
import pytest

from cospeech.speech import load_audio, speech_onsets


@pytest.mark.parametrize("rate", [16000, 44100])
def test_bursts_are_found_where_they_begin(rate):
    truth = np.array([0.5, 1.1, 1.5, 2.3, 3.0])
    waveform = np.random.default_rng(0).normal(size=4 * rate) * 1e-4
    for time in truth:
        waveform[round(time * rate) :][: rate // 5] *= 1000
    onsets = speech_onsets(waveform, rate)
    distance = np.abs(onsets[:, None] - truth)
    assert distance.min(axis=0).max() < 0.04  # every burst is found
    assert distance.min(axis=1).max() < 0.07  # and nothing else: within two of librosa's frames


@pytest.mark.parametrize("samples", [np.zeros(32000), np.zeros(0), np.zeros(10)])
def test_silence_has_none(samples):
    assert speech_onsets(samples, 16000).shape == (0,)


def test_a_sound_shorter_than_a_window():
    assert (speech_onsets(np.random.default_rng(0).normal(size=100), 16000) <= 0.1).all()


def test_syllable_rate_of_real_speech(recordings):
    samples, rate = load_audio(recordings / "speech/ljspeech/LJ001-0001.wav")
    onsets = speech_onsets(samples, rate)
    assert (np.diff(onsets) > 0).all() and 2 < len(onsets) / (len(samples) / rate) < 10
