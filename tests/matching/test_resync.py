"""Chapter 5's conditional GAN: exact losses, what it sees, and that training moves k-NN motion towards real motion."""

import numpy as np
import pytest
import torch

from cospeech.matching import KNN, Database
from cospeech.matching.refine import Resynchronizer
from cospeech.matching.resync import ResyncNetwork, ResyncTask, Settings, gradient_penalty, training_pairs
from cospeech.settings import settings_of
from cospeech.skeleton import bone_lengths, to_parent_relative
from cospeech.synthesis import train_model
from tests.conftest import make_clip

SMALL = {"steps": 60, "batch": 8, "width": 0.06, "stride": 20, "learning_rate": 1e-3}


@pytest.fixture(scope="module")
def database(toy_clips):
    return Database.from_arrays(
        [c.positions for c in toy_clips], [c.features for c in toy_clips], [c.clip for c in toy_clips],
        rotations=[c.rotation for c in toy_clips],
    )  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory, toy_clips, database):
    folder = tmp_path_factory.mktemp("resync")
    train_model("resync", toy_clips, SMALL, seed=1, folder=folder, database=database, threads=1)
    return folder


def test_gradient_penalty_of_a_linear_critic():
    weight = torch.tensor([[[1.0, 2.0], [2.0, 0.0]]])  # a gradient of norm 3 everywhere
    penalty = gradient_penalty(lambda x: (x * weight).sum((1, 2)), torch.zeros(5, 2, 2), torch.ones(5, 2, 2))
    assert penalty.item() == pytest.approx((3 - 1) ** 2)


def test_gradient_penalty_is_taken_between_real_and_fake():
    seen = []

    def critic(x):
        seen.append(x.detach())
        return x.sum((1, 2))

    gradient_penalty(critic, torch.zeros(200, 3, 4), torch.ones(200, 3, 4))
    alpha = seen[0][:, 0, 0]
    assert (seen[0] == alpha[:, None, None]).all()  # one alpha per sample, over all channels
    assert alpha.min() < 0.1 and alpha.max() > 0.9


def test_fakes_are_windows_of_the_same_speech_and_not_the_take_itself(toy_clips, database):
    windows = training_pairs(toy_clips, database, settings_of(Settings(), SMALL, "resync"), seed=0)
    pairs = windows.take(slice(None))
    assert pairs["features"].shape == (len(windows), 64, 28) and pairs["matched"].shape == (len(windows), 64, 165)
    takes = len(range(0, 256 - 64 + 1, 20))
    assert len(windows) == 3 * takes
    np.testing.assert_allclose(pairs["features"][1], toy_clips[0].features[20:84], atol=1e-6)
    own = to_parent_relative(toy_clips[0].positions)[:, 5]
    for fake in pairs["matched"][:takes].reshape(takes * 64, 55, 3)[::7, 5]:
        assert np.linalg.norm(own - fake, axis=1).min() > 1e-6


def test_residual_network_starts_as_the_matched_motion():
    statistics = {
        "features": (np.zeros(28, "f4"), np.ones(28, "f4")),
        "motion": (np.zeros(165, "f4"), np.ones(165, "f4")),
    }
    network = ResyncNetwork(28, settings_of(Settings(residual=True), {"width": 0.1}, "resync"), statistics)
    matched = torch.randn(2, 165, 64)
    torch.testing.assert_close(network(torch.randn(2, 28, 64), matched), matched)


@pytest.mark.parametrize("variant", ["paper", "released"])
def test_update_schedule_and_terms(toy_clips, database, variant):
    task = ResyncTask(toy_clips, settings_of(Settings(), SMALL | {"variant": variant}, "resync"), 0, database)
    updated = ["fidelity" in task.iterate(step, np.random.default_rng(step)) for step in range(11)]
    assert updated == [step % 5 == 0 for step in range(11)]


def test_critic_learns_to_prefer_real_motion_and_the_generator_to_please_it(toy_clips):
    """The database jitters, the speaker does not: an outsider can tell which is which, and so must the critic."""
    noise = np.random.default_rng(5)
    shaken = [(c.positions + noise.normal(scale=0.02, size=c.positions.shape)).astype("f4") for c in toy_clips]
    jittery = Database.from_arrays(shaken, [c.features for c in toy_clips], [c.clip for c in toy_clips])
    changes = {"critic_iterations": 1000, "residual": True}
    task = ResyncTask(toy_clips, settings_of(Settings(), SMALL | changes, "resync"), 0, jittery)
    for step in range(1, 101):  # the generator's turn is every thousandth
        task.iterate(step, np.random.default_rng(step))
    unseen = task.windows.take(slice(0, 30))
    x = {name: torch.from_numpy(array).transpose(1, 2) for name, array in unseen.items()}
    matched, real = (task.generator.standardized(x["features"], x[name]) for name in ("matched", "motion"))
    score = lambda pairs: task.critic(pairs).mean().item()  # noqa: E731
    assert score(real) > score(matched) + 0.5
    before = score(task._fake(matched)[1])
    for _ in range(20):
        task._update_generator(matched)
    assert score(task._fake(matched)[1]) > before + 0.25


@pytest.mark.parametrize("frames", [8, 50, 203])
def test_any_length_and_the_speakers_bones(trained, database, toy_clips, frames):
    generator = Resynchronizer(KNN(database), trained / "model.onnx")
    motion = generator.generate(make_clip(7, frames).features, seed=3)
    assert motion.positions.shape == (frames, 55, 3) and motion.rotation.shape == (frames, 3)
    np.testing.assert_allclose(bone_lengths(motion.positions), bone_lengths(toy_clips[0].positions), atol=1e-4)


def test_same_seed_same_bytes(trained, tmp_path, toy_clips, database):
    train_model("resync", toy_clips, SMALL, seed=1, folder=tmp_path, database=database, threads=1)
    for name in ("weights.safetensors", "model.onnx", "history.h5"):
        assert (tmp_path / name).read_bytes() == (trained / name).read_bytes(), name
