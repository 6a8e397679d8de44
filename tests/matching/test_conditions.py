"""Conditioning on control signals: the same numbers inside a network, and a refiner that keeps them."""

import numpy as np
import pytest
import torch

from cospeech import synthesis
from cospeech.errors import CospeechError
from cospeech.gestures.generator import Recordings
from cospeech.learning.training import train
from cospeech.matching import KNN, Database
from cospeech.matching.control.signals import SIGNALS
from cospeech.matching.resync.conditions import CONDITIONS, Conditions
from cospeech.matching.resync.gan import ResyncTask, settings_from
from cospeech.matching.resync.refine import Resynchronizer
from cospeech.matching.resync.window_pairs import relative
from tests.conftest import make_clip

CHOSEN = ["left_wrist_height", "left_wrist_speed", "symmetry"]
SMALL = {"steps": 60, "batch": 8, "width": 0.06, "stride": 20, "learning_rate": 1e-3, "condition": CHOSEN}


@pytest.fixture(scope="module")
def database(toy_clips):
    return Database.from_clips(toy_clips)


def test_signals_in_the_network_are_the_signals_of_the_search():
    positions = [make_clip(seed, 40).positions for seed in range(3)]
    motion = torch.from_numpy(np.stack([relative(p) for p in positions])).mT
    found = Conditions(CONDITIONS, fps=15.0)(motion)
    for i, name in enumerate(CONDITIONS):
        for j in range(3):
            np.testing.assert_allclose(found[j, i], SIGNALS[name](positions[j], 15.0), atol=2e-5, err_msg=name)


def test_unknown_condition_lists_the_known_ones():
    with pytest.raises(CospeechError, match=r"'nose_height' is not known; known: left_wrist_height, .*reach"):
        settings_from({"condition": ["nose_height"]})
    with pytest.raises(CospeechError, match="set statistics: real"):
        settings_from({"preset": "released", "condition": ["reach"]})
    assert settings_from({"preset": "released", "statistics": "real", "condition": ["reach"]}).condition == ("reach",)


def test_the_loss_is_the_distance_of_the_signals(toy_clips, database):
    task = ResyncTask(toy_clips, settings_from(SMALL | {"critic_iterations": 1}), 0, database)
    batch = task.windows.take(slice(0, 4))
    x = {name: torch.from_numpy(array).mT for name, array in batch.items()}
    matched = task.generator.joined(x["features"], x["matched"])
    with torch.no_grad():  # batch norm in training mode: the same batch gives the same motion
        motion = task.generator.refine(matched) * task.generator.motion_deviation + task.generator.motion_mean
    signals = Conditions(CHOSEN, 15.0)
    deviation = task.generator.condition_deviation
    expected = ((signals(motion) - signals(x["matched"])) / deviation).abs().mean()
    assert task._update_generator(matched)["condition"].item() == pytest.approx(expected.item(), rel=1e-4)


def test_a_conditioned_refiner_stays_nearer_to_the_signals(toy_clips, database):
    matched = KNN(database).generate(make_clip(9, 144).features, seed=2).positions
    speech, motion = (torch.from_numpy(x).mT[None] for x in (make_clip(9, 144).features, relative(matched)))
    signal, errors = Conditions(["left_wrist_height"], 15.0), {}
    for name, extra in (("plain", {"condition": []}), ("told", {"condition_weight": 10.0})):
        task = ResyncTask(toy_clips, settings_from(SMALL | {"critic_iterations": 1} | extra), 1, database)
        train(task, 70, seed=1)
        with torch.no_grad():
            refined = task.generator.eval()(speech, motion)
        errors[name] = (signal(refined) - signal(motion)).abs().mean().item()
    assert errors["told"] < 0.6 * errors["plain"]


def test_a_conditioned_network_has_the_same_inputs(toy_clips, database, tmp_path):
    """Whoever generates need not know: features and k-NN motion in, any length."""
    synthesis.train(
        "resync", Recordings(toy_clips, database=database), SMALL | {"steps": 2}, seed=1, folder=tmp_path, threads=1
    )
    generator = Resynchronizer(KNN(database), tmp_path / "model.onnx", 1)
    assert generator.generate(make_clip(9, 75).features, seed=2).positions.shape == (75, 55, 3)
    assert generator.network.description["settings"]["condition"] == CHOSEN
