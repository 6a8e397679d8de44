"""The 28 features: nothing drifts, nothing goes unheard, nothing depends on the recording's level."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cospeech.errors import CospeechError
from cospeech.speech import load_audio, speech_features

ENERGY = 13


def noise(seconds, rate=16000, seed=0):
    return (np.random.default_rng(seed).normal(size=round(seconds * rate)) * 0.05).astype(np.float32)


def clicks(seconds, times, rate=16000):
    waveform = np.zeros(round(seconds * rate), np.float32)
    waveform[np.round(np.asarray(times) * rate).astype(int)] = 0.9
    return waveform


@pytest.mark.parametrize("fps, rate", [(15, 16000), (29.97, 8000)])
def test_an_hour_does_not_drift(fps, rate):
    frames = np.arange(300, round(3600 * fps), round(600 * fps / 11))
    variant = "averaged" if fps == 15 else "published"
    features = speech_features(clicks(3600, frames / fps, rate), rate, fps, variant=variant, loudness=None)
    assert len(features) == round(3600 * fps)
    around = features[frames[:, None] + np.arange(-3, 4), ENERGY]
    assert (around.argmax(axis=1) == 3).all()
    assert np.ptp(around[:, 3]) < 0.5  # and heard alike from first to last


@pytest.mark.parametrize("fps", [5, 10, 15, 24, 25, 29.97, 30, 60, 120])
def test_a_click_anywhere_between_two_frames_is_heard(fps):
    """Shifts in steps of a third of a window cover every position between the frames 20 and 21."""
    quiet = speech_features(np.zeros(16000 * 6, np.float32), 16000, fps, loudness=None)
    for time in np.arange(20 / fps, 21 / fps, 0.008):
        heard = speech_features(clicks(6, [time]), 16000, fps, loudness=None) - quiet
        assert heard[:, ENERGY].max() > 1.0, time
        assert np.abs(heard[:, :13]).max() > 1.0, time


def test_the_published_variant_skips_what_lies_between():
    between = speech_features(clicks(2, [10.5 / 15]), 16000, variant="published", loudness=None)
    assert not between[:, ENERGY].any()
    on_frame = speech_features(clicks(2, [10 / 15]), 16000, variant="published", loudness=None)
    assert on_frame[:, ENERGY].argmax() == 10


@pytest.mark.parametrize("variant", ["averaged", "published"])
def test_level_of_the_recording_does_not_matter(variant):
    waveform = noise(4) * np.abs(np.sin(np.arange(64000) / 5000)).astype(np.float32)
    expected = speech_features(waveform, 16000, variant=variant)
    for gain in (0.02, 0.5, 30, 32768):
        assert np.abs(speech_features(waveform * np.float32(gain), 16000, variant=variant) - expected).max() < 0.02
    unchanged = speech_features(waveform * np.float32(0.02), 16000, variant=variant, loudness=None)
    assert np.abs(unchanged[:, ENERGY] - expected[:, ENERGY]).min() > 1  # what normalization prevents


def test_sample_rate_does_not_matter():
    time = np.arange(44100 * 3) / 44100
    waveform = (0.2 * np.sin(2 * np.pi * 300 * time) * (1 + np.sin(9 * time))).astype(np.float32)
    coarse = waveform[::2]  # 22.05 kHz, nothing above its limit
    difference = speech_features(waveform, 44100)[1:-1, [0, ENERGY]] - speech_features(coarse, 22050)[1:-1, [0, ENERGY]]
    assert np.abs(difference).max() < 0.05


def test_energy_is_that_of_16_bit_samples():
    features = speech_features(np.full(16000, 0.1, np.float32), 16000, loudness=None)
    assert features[5, ENERGY] == pytest.approx(np.log(1 + 3276.8**2), abs=1e-3)
    assert not speech_features(np.zeros(16000, np.float32), 16000)[:, ENERGY].any()


def test_the_second_half_is_the_derivative_of_the_first():
    features = speech_features(noise(3) * np.linspace(0, 1, 48000, dtype=np.float32), 16000)
    static, change = features[:, :14], features[:, 14:]
    assert np.allclose(change[1:-1], (static[2:] - static[:-2]) / 2, atol=1e-4)
    assert np.allclose(change[0], static[1] - static[0], atol=1e-4)


@pytest.mark.parametrize("seconds", [0.5, 2, 600])
def test_shapes(seconds):
    features = speech_features(noise(seconds), 16000)
    assert features.shape == (round(seconds * 15), 28) and features.dtype == np.float32
    assert np.isfinite(features).all()


def test_more_and_fewer_frames_than_sound():
    waveform = noise(2)
    own = speech_features(waveform, 16000)
    longer = speech_features(waveform, 16000, frames=45)
    assert np.allclose(longer[:28, :14], own[:28, :14], atol=1e-5)
    silence = speech_features(np.zeros(16000, np.float32), 16000)
    assert np.allclose(longer[33:, :14], silence[5, :14])
    assert np.allclose(speech_features(waveform, 16000, frames=7)[:, :14], own[:7, :14], atol=1e-5)
    assert speech_features(waveform, 16000, frames=0).shape == (0, 28)


@settings(max_examples=60, deadline=None)
@given(
    length=st.integers(0, 20000),
    rate=st.sampled_from([8000, 11025, 16000, 22050, 44100, 48000]),
    fps=st.floats(1, 240),
    variant=st.sampled_from(["averaged", "published"]),
    level=st.sampled_from([0.0, 1e-6, 0.1, 1.0]),
)
def test_always_finite_and_as_long_as_the_motion(length, rate, fps, variant, level):
    waveform = np.random.default_rng(length).uniform(-level, level, length).astype(np.float32)
    features = speech_features(waveform, rate, fps, variant=variant)
    assert features.shape == (round(length * fps / rate), 28)
    assert np.isfinite(features).all()


@pytest.mark.parametrize(
    "change, words",
    [
        ({"waveform": np.zeros((2, 100))}, "shape"),
        ({"waveform": np.array([0, np.nan, 0])}, "NaN or infinity, first at sample 1"),
        ({"sample_rate": 0}, "must be positive"),
        ({"fps": -15}, "must be positive"),
        ({"variant": "best"}, "'best' is unknown, expected one of averaged, published"),
    ],
)
def test_wrong_arguments_get_one_line(change, words):
    with pytest.raises(CospeechError, match=words):
        speech_features(**({"waveform": np.zeros(100), "sample_rate": 16000, "fps": 15} | change))


def test_same_bytes_twice():
    assert speech_features(noise(3), 16000).tobytes() == speech_features(noise(3), 16000).tobytes()


def test_real_speech_varies_and_fits_the_motion(recordings):
    samples, rate = load_audio(next(recordings.glob("speech_motion/zeggs_067/*.wav")))
    features = speech_features(samples, rate)
    assert features.shape == (1032, 28)  # 2065 frames at 30 fps
    assert (features.std(axis=0) > 0.01).all()
