"""Chapter 5's conditional GAN: exact losses, what it sees, and that training moves k-NN motion towards real motion."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from cospeech.errors import CospeechError
from cospeech.gestures.generator import Recordings
from cospeech.matching import KNN, Database
from cospeech.matching.resync.gan import PRESETS, Kept, ResyncNetwork, ResyncTask, gradient_penalty, settings_from
from cospeech.matching.resync.refine import Resynchronizer
from cospeech.matching.resync.window_pairs import training_pairs
from cospeech.skeleton import bone_lengths, to_parent_relative
from cospeech.synthesis import train
from tests.conftest import make_clip

SMALL = {"steps": 60, "batch": 8, "width": 0.06, "stride": 20, "learning_rate": 1e-3}


@pytest.fixture(scope="module")
def database(toy_clips):
    return Database.from_arrays(
        [c.positions for c in toy_clips],
        [c.features for c in toy_clips],
        [c.clip for c in toy_clips],
        rotations=[c.rotation for c in toy_clips],
    )


@pytest.fixture(scope="module")
def trained(tmp_path_factory, toy_clips, database):
    folder = tmp_path_factory.mktemp("resync")
    train("resync", Recordings(toy_clips, database=database), SMALL, seed=1, folder=folder, threads=1)
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
    windows = training_pairs(toy_clips, database, settings_from(SMALL), seed=0)
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
    network = ResyncNetwork(28, settings_from({"residual": True, "width": 0.1}), statistics)
    matched = torch.randn(2, 165, 64)
    torch.testing.assert_close(network(torch.randn(2, 28, 64), matched), matched)


@pytest.mark.parametrize("preset", ["published", "released"])
def test_update_schedule_and_terms(toy_clips, database, preset):
    task = ResyncTask(toy_clips, settings_from(SMALL | {"preset": preset}), 0, database)
    updated = ["fidelity" in task.iterate(step, np.random.default_rng(step)) for step in range(11)]
    assert updated == [step % 5 == 0 for step in range(11)]


def test_critic_learns_to_prefer_real_motion_and_the_generator_to_please_it(toy_clips):
    """The database jitters, the speaker does not: an outsider can tell which is which, and so must the critic."""
    noise = np.random.default_rng(5)
    shaken = [(c.positions + noise.normal(scale=0.02, size=c.positions.shape)).astype("f4") for c in toy_clips]
    jittery = Database.from_arrays(shaken, [c.features for c in toy_clips], [c.clip for c in toy_clips])
    changes = {"critic_iterations": 1000, "residual": True}
    task = ResyncTask(toy_clips, settings_from(SMALL | changes), 0, jittery)
    for step in range(1, 101):  # the generator's turn is every thousandth
        task.iterate(step, np.random.default_rng(step))
    unseen = task.windows.take(slice(0, 30))
    x = {name: torch.from_numpy(array).transpose(1, 2) for name, array in unseen.items()}
    matched, real = (task.generator.joined(x["features"], x[name]) for name in ("matched", "motion"))
    score = lambda pairs: task.critic(pairs).mean().item()
    assert score(real) > score(matched) + 0.5
    before = score(task._fake(matched)[1])
    for _ in range(20):
        task._update_generator(matched)
    assert score(task._fake(matched)[1]) > before + 0.25


@pytest.mark.parametrize("frames", [8, 50, 203])
def test_any_length_and_the_speakers_bones(trained, database, toy_clips, frames):
    generator = Resynchronizer(KNN(database), trained / "model.onnx")
    motion = generator.generate(make_clip(7, frames).features, seed=3).whole()
    assert motion.positions.shape == (frames, 55, 3) and motion.rotation.shape == (frames, 3)
    np.testing.assert_allclose(bone_lengths(motion.positions), bone_lengths(toy_clips[0].positions), atol=1e-4)


def test_same_seed_same_bytes(trained, tmp_path, toy_clips, database):
    train("resync", Recordings(toy_clips, database=database), SMALL, seed=1, folder=tmp_path, threads=1)
    for name in ("weights.safetensors", "model.onnx", "history.h5"):
        assert (tmp_path / name).read_bytes() == (trained / name).read_bytes(), name


def test_penalty_at_generated_pairs_is_of_the_motion_alone():
    """Eq. 5.2 by hand: D(x) = sum(c x^2) / 2 has the gradient c x. Speech channels and real pairs have no say."""
    fake = torch.zeros(1, 2 + 165, 4)
    fake[0, 0, 0] = 7.0  # speech
    fake[0, 2, 0], fake[0, 166, 3] = 1.0, -2.0  # motion: c x = (3, -4) for c = 3 and 2, a gradient of norm 5
    scale = torch.ones(1, 167, 4) * 2
    scale[0, 2] = 3.0
    critic = lambda x: (scale * x**2).sum((1, 2)) / 2
    for real in (torch.zeros_like(fake), torch.ones_like(fake)):
        assert gradient_penalty(critic, real, fake, "generated").item() == pytest.approx((5 - 1) ** 2)


def test_both_recipes_are_the_publications():
    """Reference section 5: what thesis and code say, and where they differ."""
    published, released = settings_from({}), settings_from({"preset": "released"})
    for settings in (published, released):
        assert (settings.steps, settings.batch, settings.frames, settings.stride) == (300_000, 100, 64, 5)
        assert (settings.learning_rate, settings.betas, settings.weight_decay) == (1e-4, (0.0, 0.9), 4e-5)
        assert (settings.fidelity, settings.gradient_penalty, settings.critic_iterations) == (0.1, 100.0, 5)
        assert not settings.residual and settings.condition == ()
    differing = {name for name in asdict(published) if getattr(published, name) != getattr(released, name)}
    assert differing == {"preset", "layers", "penalty_at", "statistics", "keep"}


def test_layers_of_both_recipes():
    statistics = {name: (np.zeros(n, "f4"), np.ones(n, "f4")) for name, n in (("features", 28), ("motion", 165))}
    networks = {name: ResyncNetwork(28, settings_from({"preset": name}), statistics) for name in PRESETS}
    count = lambda part, kind: sum(isinstance(m, kind) for m in part.modules())
    for name, convolutions, activation, pool in (
        ("published", 8, torch.nn.ReLU, torch.nn.MaxPool1d),
        ("released", 7, torch.nn.LeakyReLU, torch.nn.AvgPool1d),
    ):
        network = networks[name]
        assert count(network.encoder, torch.nn.Conv1d) == 8 and count(network.decoder, torch.nn.Conv1d) == convolutions
        assert count(network, activation) == 8 + convolutions - 1 and count(network.encoder, pool) == 1
        widths = [level[0].out_channels for level in network.encoder.levels]
        assert widths == [128, 256, 256, 512] and network.encoder.levels[0][0].in_channels == 193
        assert network.decoder.head.out_channels == 165
    released = networks["released"].encoder.levels[3][3].weight
    assert released.std().item() == pytest.approx(np.sqrt(2) * np.sqrt(2 / (512 * 3 + 512 * 3)), rel=0.02)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"preset": "leaked"}, "known: published, released"),
        ({"penalty_at": "home"}, "known: generated, interpolates"),
        ({"keep": "best"}, "known: last, balanced"),
        ({"variant": "paper"}, "unknown key 'resync.variant'"),
    ],
)
def test_a_wrong_recipe_is_one_line(section, words):
    with pytest.raises(CospeechError, match=words):
        settings_from(section)


def test_statistics_are_those_of_the_frames_that_windows_use(toy_clips, database):
    """Against plain numpy over the clips; the invalid stretch has no say."""
    clips = [replace(clip, valid=np.arange(len(clip)) < 200) for clip in toy_clips]
    pairs = training_pairs(clips, database, settings_from(SMALL | {"stride": 1}), seed=0)
    frames = np.concatenate([to_parent_relative(clip.positions[:200]).reshape(200, -1) for clip in clips])
    mean, deviation = pairs.statistics("motion")
    np.testing.assert_allclose(mean, frames.mean(0), atol=1e-5)
    np.testing.assert_allclose(deviation[frames.std(0) > 1e-3], frames.std(0)[frames.std(0) > 1e-3], rtol=1e-3)
    matched = pairs.take(slice(None))["matched"].reshape(-1, 165)
    np.testing.assert_allclose(pairs.statistics("matched")[0], matched.mean(0), atol=1e-5)


def test_mixed_statistics_are_the_fakes_own_in_training_alone(toy_clips, database):
    task = ResyncTask(toy_clips, settings_from(SMALL | {"preset": "released"}), 0, database)
    np.testing.assert_array_equal(task.own[0], task.windows.statistics("matched")[0])
    np.testing.assert_array_equal(task.generator.motion_mean[:, 0], task.windows.statistics("motion")[0])


def test_the_most_balanced_generator_is_kept_from_iteration_10000_on():
    generator = torch.nn.Linear(1, 1)
    kept = Kept(generator)
    seen = []
    iterations = ((9000, 0.1), (10_000, -3.0), (10_500, 0.0), (11_000, 5.0), (12_000, 2.0))
    for step, difference in iterations:
        torch.nn.init.constant_(generator.weight, step)
        kept.update(step, generator, torch.tensor(difference))
        seen.append((kept.imbalance.item(), kept.generator.weight.item()))
    assert seen[0][0] == np.inf
    assert seen[1:] == [(3.0, 10_000), (3.0, 10_000), (3.0, 10_000), (2.0, 12_000)]
