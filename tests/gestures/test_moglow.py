"""MoGlow: an exact likelihood, exact inverses, sampling that undoes what training does, and learning."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from cospeech.errors import CospeechError
from cospeech.gestures.chapter4.flow import LAYERS, Flow
from cospeech.gestures.chapter4.inference import Sampler
from cospeech.gestures.chapter4.moglow import AVERAGED, MoGlowTask, Settings, averaged
from cospeech.gestures.generator import Recordings
from cospeech.matching.control.signals import SIGNALS
from cospeech.synthesis import load, train
from tests.conftest import make_clip

SMALL = Settings(steps=30, batch=6, frames=32, hidden=24, flows=2, history=3, look_ahead=4, warm_up=10, noise=0.1)


def random_flow(channels=4, condition=3, hidden=5, steps=3):
    torch.manual_seed(0)
    flow = Flow(channels, condition, hidden, steps).double()
    for parameter in flow.parameters():
        parameter.data += 0.3 * torch.randn_like(parameter)
    return flow.eval()


def test_log_determinant_is_that_of_a_numerical_jacobian():
    flow = random_flow()
    x, condition = torch.randn(1, 5, 4).double(), torch.randn(1, 5, 3).double()
    _, change = flow(x, condition)
    jacobian = torch.autograd.functional.jacobian(lambda y: flow(y, condition)[0][0].reshape(-1), x)
    assert torch.linalg.slogdet(jacobian.reshape(20, 20))[1].item() == pytest.approx(change.sum().item(), abs=1e-9)
    step = 1e-6
    columns = [
        (flow(x + step * e, condition)[0] - flow(x - step * e, condition)[0]).reshape(-1) / (2 * step)
        for e in torch.eye(20).double().reshape(20, 1, 5, 4)
    ]
    assert torch.linalg.slogdet(torch.stack(columns))[1].item() == pytest.approx(change.sum().item(), abs=1e-5)


def test_a_density_in_one_dimension_integrates_to_one():
    flow = random_flow(channels=2, condition=1, hidden=3, steps=2)
    axis = torch.linspace(-30, 30, 601).double()
    grid = torch.cartesian_prod(axis, axis)[:, None]  # every point a sequence of one frame
    density = flow.log_likelihood(grid, torch.zeros(len(grid), 1, 1).double()).exp()
    assert density.sum().item() * 0.1**2 == pytest.approx(1, abs=0.01)


def test_frame_by_frame_inverse_undoes_the_whole_sequence():
    flow = random_flow()
    x, condition = torch.randn(2, 9, 4).double(), torch.randn(2, 9, 3).double()
    z, _ = flow(x, condition)
    states, inverses = torch.zeros(3, 2 * LAYERS, 2, 5).double(), flow.inverses()
    for frame in range(9):
        back, states = flow.inverse_step(z[:, frame], condition[:, frame], states, inverses)
        torch.testing.assert_close(back, x[:, frame], atol=1e-9, rtol=0)


def test_first_batch_leaves_every_normalisation_standardised():
    torch.manual_seed(0)
    flow = Flow(4, 3, 5, 1)
    x = 7 + 3 * torch.randn(16, 20, 4)
    flow(x, torch.zeros(16, 20, 3), fit=True)
    y, change = flow.norms[0](x)
    torch.testing.assert_close(y.mean((0, 1)), torch.zeros(4), atol=1e-4, rtol=0)
    torch.testing.assert_close(y.std((0, 1)), torch.ones(4), atol=1e-4, rtol=0)
    assert change.item() == pytest.approx(-x.std((0, 1)).log().sum().item(), abs=1e-4)


def test_untrained_likelihood_is_gaussian():
    """With couplings that start linear and a rotation for a mix, standard noise keeps its density up to the scale."""
    torch.manual_seed(0)
    flow = Flow(6, 2, 4, 1)
    x = torch.randn(1, 3, 6)
    scale = 3 * math.log(torch.sigmoid(torch.tensor(2.0)).item())  # of the three channels that the coupling moves
    _, change = flow(x, torch.zeros(1, 3, 2))
    torch.testing.assert_close(change, torch.full((1, 3), scale), atol=1e-4, rtol=0)
    assert flow.log_likelihood(x, torch.zeros(1, 3, 2)).shape == (1, 3)


@pytest.fixture(scope="module")
def task():
    from cospeech.learning.training import train

    task = MoGlowTask([make_clip(seed) for seed in range(2)], replace(SMALL, steps=150), seed=0)
    task.history = train(task, 150, seed=0)
    return task


def test_sampling_undoes_the_whole_network(task):
    """Noise that a motion becomes under its speech and past is turned back into that motion, frame by frame."""
    network = task.generator.eval().ready()
    real = {
        name: torch.from_numpy(array[None, :40].swapaxes(1, 2).copy())
        for name, array in task.pairs.windows.arrays.items()
    }
    motion, context = network.motion(real), network.speech_context(real["features"])
    before = torch.zeros(1, SMALL.history, motion.shape[2]), torch.zeros(1, SMALL.history, context.shape[2])
    condition = network.condition(torch.cat([before[0], motion], 1), torch.cat([before[1], context], 1))
    with torch.no_grad():
        noise, _ = network.flow(motion, condition)
        body, hands = network(real["features"], noise.transpose(1, 2))
    torch.testing.assert_close(body, real["body"], atol=1e-4, rtol=0)
    torch.testing.assert_close(hands, real["hands"], atol=1e-4, rtol=0)
    task.generator.train()


def test_prediction_is_the_least_squares_one_and_undone_in_sampling():
    """Speech decides the motion of these clips, so that little is left of a frame after its linear prediction."""
    task = MoGlowTask([make_clip(seed) for seed in range(3)], replace(SMALL, linear=True, pose_dropout=0.0), seed=0)
    network = task.generator.eval().ready()
    left, condition = task._batch(np.random.default_rng(7))
    frames = left + condition @ network.prediction
    assert left.square().mean() < 0.1 * frames.square().mean()
    # At the minimum of |x - c W|^2 + ridge |W|^2 what is left has next to nothing to do with the condition.
    assert (condition.flatten(0, 1).T @ left.flatten(0, 1) / left[..., 0].numel()).abs().max() < 0.1
    features, noise = torch.randn(1, 28, 20), torch.zeros(1, 168, 20)
    with torch.no_grad():
        body, _ = network(features, noise)
        network.prediction.zero_()
        without, _ = network(features, noise)
    assert (body - without).abs().max() > 1e-3


def test_learns_what_belongs_together(task):
    curve = task.history.losses["negative_log_likelihood"]
    assert np.mean(curve[-10:]) < curve[0] - 0.3
    network = task.generator.eval()
    held_out = [task.pairs.__class__([make_clip(seed)], 64).windows for seed in (8, 9)]
    real, other = (
        {name: torch.from_numpy(a[None].swapaxes(1, 2).copy()) for name, a in w.arrays.items()} for w in held_out
    )
    with torch.no_grad():
        true = network.log_likelihood(real).item()
        false = network.log_likelihood(real | {"features": other["features"]}).item()
    assert true > false
    task.generator.train()


def test_condition_sees_the_past_and_speech_ahead_alone(task):
    network = task.generator.eval()
    real = task.pairs.sample(np.random.default_rng(0), 1)
    motion, context = network.motion(real), network.speech_context(real["features"])
    before = network.condition(motion, context)
    later = motion.clone()
    later[:, 10] += 1
    changed = (network.condition(later, context) != before).any(-1)[0].nonzero()[:, 0] + SMALL.history
    assert changed.tolist() == [11, 12, 13]
    features = real["features"].clone()
    features[:, :, 20] += 1
    changed = (network.condition(motion, network.speech_context(features)) != before).any(-1)[0].nonzero()[
        :, 0
    ] + SMALL.history
    assert changed.tolist() == list(range(20 - SMALL.look_ahead, 20 + SMALL.history + 1))
    dropped = network.condition(motion, context, torch.zeros(1, before.shape[1], dtype=bool))
    assert (dropped[..., : SMALL.history * 168] == 0).all() and (dropped[..., SMALL.history * 168 :] != 0).any()


def test_learning_rate_rises_falls_and_stays():
    task = MoGlowTask([make_clip()], Settings(batch=2, hidden=8, flows=1), seed=0)
    assert task.rate(2999) == pytest.approx(1.5e-3) and task.rate(1499) == pytest.approx(0.75e-3)
    assert task.rate(11_999) == pytest.approx(0.75e-3) and task.rate(10**7) == 1.5e-4


def test_samples_through_onnx(tmp_path, toy_clips):
    settings = {"steps": 20, "batch": 6, "frames": 32, "hidden": 16, "flows": 2, "look_ahead": 4, "warm_up": 10}
    train("moglow", Recordings(toy_clips), settings, seed=0, folder=tmp_path, threads=1)
    sampler = Sampler(tmp_path / "model.onnx")
    features = make_clip(5, 203).features
    one, same, other = (sampler.generate(features, seed=seed) for seed in (1, 1, 2))
    assert one.positions.shape == (203, 55, 3) and one.rotation.shape == (203, 3) and one.expression is None
    np.testing.assert_array_equal(one.positions, same.positions)
    assert np.abs(one.positions - other.positions).max() > 0.01
    noise = np.random.default_rng(0).standard_normal((3000, 168), dtype="f4")
    features = make_clip(6, 3000).features
    whole, later = (sampler.network.run_long(features=features[s:], noise=noise[s:])["body"] for s in (0, 37))
    assert whole.shape == (3000, 42) and np.isfinite(whole).all()
    np.testing.assert_allclose(whole[37 + 500 :], later[500:], atol=1e-3)  # the same motion away from the start
    likeliest = [sampler.generate(features, seed=seed, temperature=0.0).positions for seed in (1, 2)]
    np.testing.assert_array_equal(*likeliest)


TINY = {"steps": 20, "batch": 6, "frames": 32, "hidden": 16, "flows": 2, "look_ahead": 4, "warm_up": 10}


def test_control_is_the_mean_of_four_seconds():
    signal = np.zeros(200)
    signal[100] = 1
    found = averaged(signal, 15.0)
    assert found.max() == pytest.approx(1 / (AVERAGED * 15)) and found.sum() == pytest.approx(1)
    assert np.flatnonzero(found > 1e-9).tolist() == list(range(71, 131))
    np.testing.assert_allclose(averaged(np.full(3, 0.2), 15.0), 0.2)


def test_control_variant_follows_its_target():
    """Clips whose whole motion is high or low: told which, the flow puts the left wrist there."""
    clips = [make_clip(seed, 128) for seed in range(6)]
    moved = [
        replace(clip, positions=clip.positions + np.float32([0, 0.4 * (i % 2), 0])) for i, clip in enumerate(clips)
    ]
    height = [SIGNALS["left_wrist_height"](clip.positions, clip.fps) for clip in moved]
    settings = replace(SMALL, steps=150, learning_rate=5e-3, pose_dropout=0.6)
    from cospeech.learning.training import train

    task = MoGlowTask(moved, settings, 0, "moglow_height", height)
    targets = task.description["targets"]
    assert targets["85"] == pytest.approx(np.percentile(np.concatenate(height), 85))
    train(task, 150, seed=0)
    network, _, _ = task.export()
    features = torch.from_numpy(make_clip(9, 96).features.T[None].copy())
    noise = torch.randn(1, 168, 96, generator=torch.manual_seed(0))
    with torch.inference_mode():
        high, low = (network(features, noise, torch.full((1, 1, 96), targets[q]))[0] for q in ("85", "15"))
    wrist = 3 * 7 + 1
    assert high[0, wrist].mean() > low[0, wrist].mean() + 0.1


@pytest.fixture(scope="module")
def controlled(tmp_path_factory, toy_clips):
    folder = tmp_path_factory.mktemp("moglow_height")
    network = folder / "models" / "moglow_height"
    train("moglow_height", Recordings(toy_clips), TINY, seed=0, folder=network, threads=1)
    return load("moglow_height", folder)


def test_controls_are_targets_in_their_interval(controlled, toy_clips):
    heights = np.concatenate([SIGNALS["left_wrist_height"](clip.positions, 15.0) for clip in toy_clips])
    low, median, high = np.percentile(heights, [15, 50, 85])
    target = controlled.target(["left_wrist_height=high@2-4", "left_wrist_height=>0.25@6-"], 150)
    expected = np.r_[np.full(30, median), np.full(30, high), np.full(30, median), np.full(60, 0.25)]
    np.testing.assert_allclose(target, expected, rtol=1e-5)
    np.testing.assert_allclose(controlled.target(["left_wrist_height=low"], 3), low, rtol=1e-5)
    features = make_clip(5, 60).features
    free, asked = (controlled.generate(features, controls=c).positions for c in ([], ["left_wrist_height=high"]))
    assert free.shape == (60, 55, 3) and not np.array_equal(free, asked)
    np.testing.assert_array_equal(controlled.generate(features).positions, free)


@pytest.mark.parametrize(
    "control", ["symmetry=symmetric", "left_wrist_height=high or left_wrist_height=low", "left_wrist_speed=fast"]
)
def test_controls_that_a_variant_does_not_know_are_one_line(controlled, control):
    with pytest.raises(CospeechError, match="this network knows one level or value of left_wrist_height"):
        controlled.generate(make_clip(5, 60).features, controls=[control])
