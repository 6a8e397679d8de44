"""MFCC against CMU Sphinx's own program, run here or recorded."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from cospeech.speech import load_audio, speech_features
from cospeech.speech.mfcc import CHUNK, mfcc

FOLDER = Path(__file__).parent


@pytest.fixture(scope="module")
def golden():
    """The program's output for a synthetic sound, recorded by make_golden.py."""
    return np.load(FOLDER / "sphinx_golden.npz", allow_pickle=False)


@pytest.fixture(scope="module")
def program():
    if not shutil.which("sphinx_fe"):
        pytest.skip("sphinx_fe is not installed (Debian package sphinxbase-utils)")
    spec = importlib.util.spec_from_file_location("make_golden", FOLDER / "make_golden.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_equals_the_recorded_program(golden):
    expected = golden["mfcc"]
    ours = mfcc(golden["pcm"] / np.float32(32768), np.arange(len(expected)) * 160)
    assert ours.shape == expected.shape == (149, 13)
    assert np.abs(ours - expected).max() < 1e-4


def test_equals_the_program(program):
    pcm = program.synthetic_sound(seed=11, seconds=4.321)
    expected = program.sphinx_fe(pcm)
    ours = mfcc(pcm / np.float32(32768), np.arange(len(expected)) * 160)
    assert np.abs(ours - expected).max() < 1e-4


def test_equals_the_program_on_real_speech(program, recordings):
    samples, _ = load_audio(next(recordings.glob("speech_motion/zeggs_067/*.wav")), end=20.0)
    expected = program.sphinx_fe((samples * 32768).astype(np.int16))
    assert np.abs(mfcc(samples, np.arange(len(expected)) * 160) - expected).max() < 1e-4


def test_the_features_are_these_coefficients(golden):
    """The public function, end to end: centered windows, so two hops less half a window align it with the program."""
    waveform = np.concatenate([np.zeros(2 * 160 - 205, np.float32), golden["pcm"] / np.float32(32768)])
    features = speech_features(waveform, 16000, fps=100, variant="published", loudness=None)
    assert np.abs(features[2:150, :13] - golden["mfcc"][:148]).max() < 1e-4


def test_chunks_and_single_windows_agree():
    samples = np.random.default_rng(0).normal(size=9000).astype(np.float32) * 0.1
    starts = np.sort(np.random.default_rng(1).integers(-600, 9500, 2 * CHUNK + 7))
    whole = mfcc(samples, starts)
    assert np.allclose(
        whole[::97], np.concatenate([mfcc(samples, starts[i : i + 1]) for i in range(0, len(starts), 97)])
    )
    inside = starts < len(samples) - 410
    assert np.allclose(whole[inside], mfcc(np.pad(samples, 1000), starts + 1000)[inside])
