"""Loudness against the reference signals of EBU Tech 3341 and against a second implementation."""

import numpy as np
import pytest

from cospeech.speech import integrated_loudness, load_audio, normalize_loudness

RATE = 48000


def tone(seconds, level, rate=RATE):
    """1 kHz sine whose peak is `level` dB of full scale."""
    return 10 ** (level / 20) * np.sin(2 * np.pi * 1000 * np.arange(round(seconds * rate)) / rate)


def stereo(*parts):
    return np.repeat(np.concatenate(parts)[:, None], 2, axis=1)


def speechlike(seconds, rate=RATE):
    """Bursts of noise that sink by 40 dB between them."""
    time = np.arange(round(seconds * rate)) / rate
    return np.random.default_rng(3).normal(size=len(time)) * np.where(np.sin(8 * time) > -0.3, 0.1, 0.001)


@pytest.mark.parametrize(
    "signal, expected",
    [
        (stereo(tone(20, -23)), -23),  # EBU Tech 3341, cases 1 to 4
        (stereo(tone(20, -33)), -33),
        (stereo(tone(10, -36), tone(60, -23), tone(10, -36)), -23),
        (stereo(tone(10, -72), tone(10, -36), tone(60, -23), tone(10, -36), tone(10, -72)), -23),
        (tone(20, -23), -26.01),  # one channel alone carries half the power
    ],
)
def test_ebu_reference_signals(signal, expected):
    assert integrated_loudness(signal, RATE) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("rate", [8000, 11025, 16000, 22050, 44100])
def test_every_rate_reads_the_reference_tone(rate):
    assert integrated_loudness(stereo(tone(5, -23, rate)), rate) == pytest.approx(-23, abs=0.1)


def test_second_implementation_agrees():
    meter = pytest.importorskip("pyloudnorm").Meter(RATE)
    signal = speechlike(20)
    assert integrated_loudness(signal, RATE) == pytest.approx(meter.integrated_loudness(signal), abs=0.1)


def test_normalization_is_one_gain_and_reaches_its_target():
    signal = speechlike(10).astype(np.float32)
    louder = normalize_loudness(signal, RATE)
    assert integrated_loudness(louder, RATE) == pytest.approx(-23, abs=0.02)
    assert np.allclose(louder, signal * (louder[1000] / signal[1000]), rtol=1e-5)
    assert integrated_loudness(normalize_loudness(signal, RATE, -16), RATE) == pytest.approx(-16, abs=0.02)
    assert np.abs(normalize_loudness(tone(1, -60), RATE)).max() == pytest.approx(10 ** (-20 / 20), rel=0.01)


@pytest.mark.parametrize("seconds", [0.02, 0.1, 0.39, 0.4])
def test_sound_shorter_than_a_gating_block(seconds):
    assert integrated_loudness(tone(seconds, -23), RATE) == pytest.approx(-26.01, abs=0.1)


@pytest.mark.parametrize("signal", [np.zeros(RATE), np.zeros(100), np.zeros(0), tone(1, -80)])
def test_silence_has_no_loudness_and_stays(signal):
    assert integrated_loudness(signal, RATE) == -np.inf
    assert np.array_equal(normalize_loudness(signal, RATE), signal.astype(np.float32))


def test_floats_on_the_scale_of_integers():
    assert integrated_loudness(tone(2, -23) * 32768, RATE) == pytest.approx(-26.01 + 90.31, abs=0.02)


def test_real_speech(recordings):
    pyloudnorm = pytest.importorskip("pyloudnorm")
    samples, rate = load_audio(recordings / "speech/jfk/jfk.flac")
    expected = pyloudnorm.Meter(rate).integrated_loudness(samples.astype(np.float64))
    assert integrated_loudness(samples, rate) == pytest.approx(expected, abs=0.1)
