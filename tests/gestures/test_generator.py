"""The registry: a generator is written down once, and everything that lists generators follows."""

import sys

import numpy as np
import pytest

from cospeech.cli import main
from cospeech.clip import Clip, Motion
from cospeech.errors import CospeechError
from cospeech.gestures.generator import COMPARISONS, MODELS, VARIANTS, Model, Speech, find, resolve, settings_for
from cospeech.gestures.ha2g.long_speech import MultiSpeakerGenerator
from cospeech.skeleton import UPPER55
from cospeech.speech import speech_features, write_wav
from cospeech.split import split_clips
from cospeech.synthesis import load, synthesize

RATE = 16000


@pytest.fixture
def samples():
    return (np.random.default_rng(0).normal(size=2 * RATE) * 0.05).astype(np.float32)


@pytest.mark.parametrize("name", [*MODELS, *VARIANTS])
def test_what_an_entry_names_is_there(name):
    model = find(name)
    assert callable(resolve(model.generator).load) and callable(resolve(model.generator).generate)
    assert not model.task or callable(resolve(model.task))
    assert model.label and model.about and (not model.of or model.of in MODELS)


def test_a_networks_folder_names_its_model():
    assert find("ha2g_1") is MODELS["ha2g"] and find("low_only_0") is VARIANTS["low_only"]
    with pytest.raises(CospeechError, match="'regresion' is not known; known: regression, lstm"):
        find("regresion")


def test_rows_of_tables_are_models_or_variants_of_them():
    assert all(find(row) for rows in COMPARISONS.values() for row in rows)


def test_settings_of_a_row_are_its_models_section_with_its_changes():
    budget = {
        "ha2g": {"steps": 5, "weights": {"huber": 3.0, "physical": 2.0}},
        "moglow": {"steps": 7},
        "all": {"steps": 1},
    }
    assert settings_for("no_physical", budget) == {"steps": 5, "weights": {"huber": 3.0, "physical": 0.0}}
    assert budget["ha2g"]["weights"]["physical"] == 2.0
    assert settings_for("moglow_height", budget) == {"steps": 7}
    assert settings_for("window16", budget, "all") == {"steps": 1, "frames": 16}


def test_speech_has_features_only_when_asked(samples):
    speech = Speech(samples, RATE)
    assert len(speech) == 30 and "features" not in vars(speech)
    np.testing.assert_array_equal(speech.features, speech_features(samples, RATE, 15.0, 30))


def test_speech_of_features_or_of_a_clip(toy_clips):
    assert Speech.of(toy_clips[0]).features is toy_clips[0].features
    assert len(Speech.of(toy_clips[0].features)) == len(toy_clips[0].features)
    speech = Speech(np.zeros(RATE, np.float32), RATE)
    assert Speech.of(speech) is speech


class Waving:
    """A generator of one's own: both wrists go up and down with the seconds."""

    @classmethod
    def load(cls, name, folder, threads=None):
        assert name == "waving" and (folder / "split.h5").is_file()
        return cls()

    def generate(self, speech, *, seed=0):
        positions = np.zeros((len(speech), len(UPPER55), 3), np.float32)
        positions[:, UPPER55.joints("right_wrist", "left_wrist"), 1] = np.sin(np.arange(len(speech)) / 2 + seed)[
            :, None
        ]
        return Motion(positions)


def test_a_generator_of_ones_own_is_one_entry(monkeypatch, tmp_path, samples):
    """From the command line to the file, without a change anywhere else."""
    monkeypatch.setitem(sys.modules, "waving", sys.modules[__name__])
    monkeypatch.setitem(MODELS, "waving", Model("Waving", "waves", "waving:Waving", smoothing=0.0))
    split_clips({"a": 100, "b": 100}, {}, {"train": 0.5, "test": 0.5}).write(tmp_path / "out/ada/split.h5")
    (tmp_path / "config.yaml").write_text(f"results_dir: {tmp_path / 'out'}\n")
    write_wav(tmp_path / "talk.wav", samples, RATE)
    asked = ["--subject", "ada", "--model", "waving", "--audio", str(tmp_path / "talk.wav"), "--seed", "2"]
    asked += ["--config", str(tmp_path / "config.yaml"), "--out", str(tmp_path / "talk.h5")]
    assert main(["generate", *asked]) == 0
    made = Clip.read(tmp_path / "talk.h5")
    assert made.generator == "waving" and made.frames == 30
    np.testing.assert_array_equal(made.positions, Waving().generate(Speech(samples, RATE), seed=2).positions)
    assert main(["generate", *asked, "--k", "2"]) == 2


def test_the_models_own_smoothing_unless_another_is_asked(monkeypatch, samples):
    monkeypatch.setitem(MODELS, "waving", Model("Waving", "waves", "waving:Waving", smoothing=2.0))
    speech, called = Speech(samples, RATE), {"subject": "ada", "clip": "talk", "model": "waving"}
    own, none = synthesize(Waving(), speech, **called), synthesize(Waving(), speech, smoothing=0.0, **called)
    assert own.extra["smoothing"] == 2.0 and none.extra["smoothing"] == 0.0
    assert np.ptp(own.positions) < np.ptp(none.positions)


def test_what_hears_the_sound_says_so_when_there_are_but_features(toy_clips):
    generator = MultiSpeakerGenerator.__new__(MultiSpeakerGenerator)
    generator.description = {"model": "ha2g"}
    with pytest.raises(CospeechError, match="ha2g: hears the sound itself"):
        generator._conditions(Speech.of(toy_clips[0]), 30)


def test_an_option_that_a_model_does_not_know_is_one_line(tmp_path):
    with pytest.raises(CospeechError, match="regression ranks no matches; use knn or resync"):
        load("regression", tmp_path, audio_rank="learned")
