"""MoGlow: an exact likelihood, exact inverses, sampling that undoes what training does, and learning."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from cospeech.gestures.flow import LAYERS, Flow
from cospeech.gestures.generate import Sampler
from cospeech.gestures.moglow import MoGlowTask, Settings
from cospeech.synthesis import train_model
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
    columns = [(flow(x + step * e, condition)[0] - flow(x - step * e, condition)[0]).reshape(-1) / (2 * step)
               for e in torch.eye(20).double().reshape(20, 1, 5, 4)]  # fmt: skip
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
    from cospeech.training import train

    task = MoGlowTask([make_clip(seed) for seed in range(2)], replace(SMALL, steps=150), seed=0)
    task.history = train(task, 150, seed=0)
    return task


def test_learns_what_belongs_together(task):
    curve = task.history.losses["negative_log_likelihood"]
    assert np.mean(curve[-10:]) < curve[0] - 0.3
    network = task.generator.eval()
    held_out = [task.pairs.__class__([make_clip(seed)], 64).windows for seed in (8, 9)]
    real, other = ({name: torch.from_numpy(a[None].swapaxes(1, 2).copy()) for name, a in w.arrays.items()}
                   for w in held_out)  # fmt: skip
    with torch.no_grad():
        true = network.log_likelihood(real).item()
        false = network.log_likelihood(real | {"features": other["features"]}).item()
    assert true > false
    task.generator.train()


def test_condition_sees_the_past_and_speech_ahead_alone(task):
    network = task.generator.eval()
    real = task.pairs.sample(np.random.default_rng(0), 1)
    motion, heard = network.motion(real), network.heard(real["features"])
    before = network.condition(motion, heard)
    later = motion.clone()
    later[:, 10] += 1
    changed = (network.condition(later, heard) != before).any(-1)[0].nonzero()[:, 0] + SMALL.history
    assert changed.tolist() == [11, 12, 13]
    features = real["features"].clone()
    features[:, :, 20] += 1
    changed = (network.condition(motion, network.heard(features)) != before).any(-1)[0].nonzero()[:, 0] + SMALL.history
    assert changed.tolist() == list(range(20 - SMALL.look_ahead, 20 + SMALL.history + 1))
    dropped = network.condition(motion, heard, torch.zeros(1, before.shape[1], dtype=bool))
    assert (dropped[..., : SMALL.history * 168] == 0).all() and (dropped[..., SMALL.history * 168 :] != 0).any()


def test_learning_rate_rises_falls_and_stays():
    task = MoGlowTask([make_clip()], Settings(batch=2, hidden=8, flows=1), seed=0)
    assert task.rate(2999) == pytest.approx(1.5e-3) and task.rate(1499) == pytest.approx(0.75e-3)
    assert task.rate(11_999) == pytest.approx(0.75e-3) and task.rate(10**7) == 1.5e-4


def test_samples_through_onnx(tmp_path, toy_clips):
    settings = {"steps": 20, "batch": 6, "frames": 32, "hidden": 16, "flows": 2, "look_ahead": 4, "warm_up": 10}
    train_model("moglow", toy_clips, settings, seed=0, folder=tmp_path, threads=1)
    sampler = Sampler(tmp_path / "model.onnx")
    features = make_clip(5, 203).features
    one, same, other = (sampler.generate(features, seed=seed) for seed in (1, 1, 2))
    assert one.positions.shape == (203, 55, 3) and one.rotation.shape == (203, 3) and one.expression is None
    np.testing.assert_array_equal(one.positions, same.positions)
    assert np.abs(one.positions - other.positions).max() > 0.01
    likeliest = [sampler.generate(features, seed=seed, temperature=0.0).positions for seed in (1, 2)]
    np.testing.assert_array_equal(*likeliest)
