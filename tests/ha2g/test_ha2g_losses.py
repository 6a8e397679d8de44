"""HA2G's losses against numbers worked out by hand."""

import math

import numpy as np
import pytest
import torch

from cospeech.gestures.ha2g import losses
from cospeech.gestures.ha2g.dataset.levels import included_angles, level_table


def test_huber_is_quadratic_near_and_linear_far_and_summed_over_levels():
    near, far = torch.full((2, 3, 4), 0.05), torch.full((2, 3, 6), -0.3)
    targets = [torch.zeros_like(near), torch.zeros_like(far)]
    expected = 0.5 * 0.05**2 / 0.1 + (0.3 - 0.05)
    assert losses.huber([near, far], targets).item() == pytest.approx(expected, rel=1e-5)


def test_adversarial_losses_at_chance_and_when_the_discriminator_is_sure():
    undecided = torch.zeros(5)
    assert losses.discriminator_loss(undecided, undecided).item() == pytest.approx(2 * math.log(2), rel=1e-6)
    assert losses.generator_loss(undecided).item() == pytest.approx(math.log(2), rel=1e-6)
    assert losses.generator_loss(torch.full((5,), -200.0)).item() == pytest.approx(
        -math.log(1e-8), rel=1e-5
    )  # finite: epsilon
    assert losses.discriminator_loss(torch.full((5,), 30.0), torch.full((5,), -30.0)).item() == pytest.approx(
        0, abs=1e-6
    )


def test_least_squares_losses():
    real, generated = torch.tensor([0.5, 1.5]), torch.tensor([0.25, 0.75])
    assert losses.least_squares_discriminator_loss(real, generated).item() == pytest.approx(
        0.25 + (0.0625 + 0.5625) / 2
    )
    assert losses.least_squares_generator_loss(generated).item() == pytest.approx((0.5625 + 0.0625) / 2)


def test_divergence_of_gaussians():
    assert losses.divergence(torch.ones(3, 2), torch.zeros(3, 2)).item() == pytest.approx(0.5)
    four = torch.full((3, 2), math.log(4))
    assert losses.divergence(torch.zeros(3, 2), four).item() == pytest.approx((4 - 1 - math.log(4)) / 2, rel=1e-6)


def test_divergence_is_that_of_samples():
    mean, log_variance = torch.tensor(0.7), torch.tensor(-0.4)
    q = torch.distributions.Normal(mean, torch.exp(log_variance / 2))
    expected = torch.distributions.kl_divergence(q, torch.distributions.Normal(0.0, 1.0))
    assert losses.divergence(mean, log_variance).item() == pytest.approx(expected.item(), rel=1e-6)


def test_style_diverging_loss():
    poses = torch.full((2, 2, 3), 0.2, requires_grad=True)
    others, style = torch.zeros(2, 2, 3, requires_grad=True), torch.zeros(2, 4, requires_grad=True)
    loss = losses.diverging(poses, others, style, torch.full((2, 4), 0.5))
    assert loss.item() == pytest.approx(-6 * (0.2 - 0.025) / (0.5 + 1e-5), rel=1e-5)
    loss.backward()
    assert (poses.grad < 0).all()  # away from the others
    assert others.grad is None and style.grad is None  # constants


def test_style_diverging_loss_is_clamped_when_styles_are_alike():
    poses = torch.full((1, 2, 3), 0.2, requires_grad=True)
    loss = losses.diverging(poses, torch.zeros(1, 2, 3), torch.zeros(1, 4), torch.zeros(1, 4))
    assert loss.item() == -1000
    loss.backward()
    assert (poses.grad == 0).all()


@pytest.mark.parametrize("name", ["expressive43", "ted10"])
def test_angles_in_training_are_those_of_the_statistics(name):
    table = level_table(name)
    vectors = np.random.default_rng(0).normal(size=(3, 5, table.vectors, 3))
    found = losses.included_angles(torch.from_numpy(vectors), table).numpy()
    np.testing.assert_allclose(found, included_angles(vectors, table), atol=1e-3)


def test_straight_and_folded_bones_have_finite_gradients():
    table = level_table("ted10")
    vectors = torch.ones(1, 1, table.vectors, 3)
    vectors[:, :, ::2] *= -1
    vectors.requires_grad_()
    losses.included_angles(vectors, table).sum().backward()
    assert torch.isfinite(vectors.grad).all()


def test_physical_loss_is_a_gaussian_likelihood():
    angles = torch.full((2, 3, 2), 0.6)
    mean, variance = torch.tensor([0.5, 0.6]), torch.tensor([0.01, 0.01])
    assert losses.physical(angles, mean, variance).item() == pytest.approx(0.5, rel=1e-5)
    densities = torch.distributions.Normal(mean, variance.sqrt()).log_prob(angles)
    constant = 0.5 * torch.log(2 * torch.pi * variance).sum()
    expected = -densities.mean((0, 1)).sum() - constant
    assert losses.physical(angles, mean, variance).item() == pytest.approx(expected.item(), rel=1e-4)


def test_rigid_angles_do_not_blow_up():
    loss = losses.physical(torch.full((1, 1, 1), 0.51), torch.tensor([0.5]), torch.zeros(1))
    assert loss.item() == pytest.approx(0.01**2 / (2 * losses.VARIANCE), rel=1e-3)


E, ONE, LESS = math.e, 1.0, 1 / math.e


@pytest.mark.parametrize(
    ("in_level", "cross_level", "total"),
    [(True, True, E + ONE + E + ONE + LESS + ONE), (True, False, E + ONE), (False, True, E + E + ONE + LESS + ONE)],
)
def test_contrastive_loss_by_hand(in_level, cross_level, total):
    """Two frames: high and low are the words' own directions, mid their opposites; lengths do not matter."""
    words = torch.eye(2) * 3
    features = torch.stack([torch.eye(2), -torch.eye(2), torch.eye(2) * 5])
    loss = losses.contrastive(words, features, 1.0, in_level, cross_level)
    assert loss.item() == pytest.approx(math.log(total) - 1, rel=1e-5)


def test_contrastive_loss_without_negatives_teaches_nothing():
    words, features = torch.randn(4, 3), torch.randn(3, 4, 3)
    assert losses.contrastive(words, features, 0.1, False, False).item() == pytest.approx(0, abs=1e-6)


def test_temperature_sharpens():
    words = torch.eye(2)
    features = torch.stack([torch.zeros(2, 2), torch.zeros(2, 2), torch.eye(2)])
    expected = math.log1p(math.exp(-5))
    assert losses.contrastive(words, features, 0.2, cross_level=False).item() == pytest.approx(expected, rel=1e-3)


def test_released_contrastive_form_by_hand():
    words = torch.tensor([[0.0], [3.0]])
    high, low = torch.tensor([[1.0], [5.0]]), torch.tensor([[2.0], [2.0]])  # distances 1, 5 and 2, 2; low: all alike
    first = math.log(math.exp(1) + math.exp(0.2)) - 1
    expected = (first + math.log(2)) / 2 - 0.025 * math.log(2)
    found = losses.contrastive_by_distance(words, torch.stack([low, torch.zeros(2, 1), high]))
    assert found.item() == pytest.approx(expected, rel=1e-4)
