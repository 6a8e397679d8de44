"""Diversity in both norms, and as released code draws it, against brute force."""

from itertools import combinations

import numpy as np
import pytest

from cospeech.evaluation.metrics import gesture_metrics as metrics


@pytest.mark.parametrize("norm", [1, 2])
def test_diversity_of_few_samples_is_the_mean_over_all_pairs(norm):
    latents = np.random.default_rng(0).normal(size=(12, 5))
    expected = np.mean([np.linalg.norm(a - b, ord=norm) for a, b in combinations(latents, 2)])
    assert metrics.diversity(latents, norm=norm) == pytest.approx(expected, rel=1e-12)


def test_ten_draws_of_500_pairs_lie_close_together():
    """As in appendix G.3, where ten draws spread by 1 %."""
    latents = np.random.default_rng(1).normal(size=(400, 128))
    draws = np.array([metrics.diversity(latents, norm=1, seed=seed) for seed in range(10)])
    assert draws.mean() == pytest.approx(128 * 2 / np.sqrt(np.pi), rel=0.02)  # E|x - y| of two normal numbers
    assert 0 < draws.std() < 0.01 * draws.mean()


def test_released_draw_pairs_whole_batches_in_their_order():
    latents = np.random.default_rng(2).normal(size=(103, 4))
    batches = latents[:100].reshape(10, 10, 4)
    order = np.random.default_rng(5).permutation(10)
    pairs = [(batches[a][i], batches[b][i]) for a, b in enumerate(order) for i in range(10)]
    expected = np.mean([np.abs(x - y).sum() for x, y in pairs])
    assert metrics.diversity_of_batches(latents, batch=10, seed=5) == pytest.approx(expected, rel=1e-12)


def test_released_draw_lets_a_batch_meet_itself_and_drops_the_rest():
    latents = np.arange(10.0)[:, None]
    assert metrics.diversity_of_batches(latents, batch=6) == 0.0  # one whole batch, which can only meet itself
    assert np.isnan(metrics.diversity_of_batches(latents, batch=11))
