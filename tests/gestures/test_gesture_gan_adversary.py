"""Chapter 4's adversary by closed forms: a linear discriminator, D(x) = sigmoid(w x), plain gradient descent."""

import numpy as np
import pytest
import torch

from cospeech.gestures.chapter4.gesture_gan import GestureTask, Settings
from cospeech.learning.settings import settings_of

ONLY_ADVERSARY = {"face": 0.0, "body": 0.0, "hands": 0.0, "adversarial": 1.0}


class Linear(torch.nn.Module):
    def __init__(self, channels, value):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.full((1, channels, 1), value))

    def forward(self, x):
        return (self.weight * x).sum((1, 2))


@pytest.fixture
def linear(toy_clips):
    def make(value=0.0, **changes):
        small = {"batch": 4, "width": 0.05, "weights": ONLY_ADVERSARY, **changes}
        task = GestureTask(toy_clips, settings_of(Settings(), small, "gesture_gan"), seed=0)
        critic = task.modules["discriminator"] = Linear(28 + 42 + 126, value)
        task.optimizers["discriminator"] = torch.optim.SGD(critic.parameters(), 1.0)
        real = task.pairs.sample(np.random.default_rng(0), 4)
        generated = {part: (x + 0.1).requires_grad_() for part, x in real.items() if part != "features"}
        task.optimizers["generator"] = torch.optim.SGD(generated.values(), 0.1)
        return task, real, generated

    return make


def test_discriminator_moves_towards_real_and_away_from_generated(linear):
    """At w = 0 both sigmoids are 1/2, so one step of rate 1 ends at half of what real has more than generated."""
    task, real, generated = linear()
    of_real, of_generated = (task._discriminator_inputs(real["features"], motion) for motion in (real, generated))
    more = (of_real - of_generated).sum(2).mean(0) / 2
    task._update_discriminator(real, generated)
    torch.testing.assert_close(task.modules["discriminator"].weight[0, :, 0], more, atol=1e-4, rtol=1e-4)


def test_r1_shrinks_the_weights_by_their_own_gradient(linear):
    """The penalty is r1 / 2 T |w|^2 of 64 frames, and its gradient r1 T w, whatever the motion."""
    found = {}
    for r1 in (0.0, 0.002):
        task, real, generated = linear(0.01, r1=r1)
        task._update_discriminator(real, generated)
        found[r1] = task.modules["discriminator"].weight.detach()
    torch.testing.assert_close(
        found[0.002] - found[0.0], torch.full_like(found[0.0], -0.002 * 64 * 0.01), atol=1e-5, rtol=1e-3
    )


def test_generator_moves_to_what_the_discriminator_calls_real(linear):
    task, real, generated = linear(-0.01)
    before = task._logits(task._discriminator_inputs(real["features"], generated)).detach()
    task._update_generator(real, generated)
    assert (task._logits(task._discriminator_inputs(real["features"], generated)) > before).all()


def test_generator_takes_its_turn_every_nth_iteration(linear):
    task, _, _ = linear(generator_every=5)
    task.optimizers["discriminator"] = torch.optim.SGD(task.modules["discriminator"].parameters(), 1e-3)
    parameters = list(task.generator.parameters())
    task.optimizers["generator"] = torch.optim.SGD(parameters, 1.0)
    moved = []
    for step in range(7):
        before = [p.detach().clone() for p in parameters]
        task.iterate(step, np.random.default_rng(step))
        moved.append(any(not torch.equal(a, b) for a, b in zip(before, parameters, strict=True)))
    assert moved == [step % 5 == 0 for step in range(7)]
