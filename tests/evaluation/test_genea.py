"""GENEA's measures against closed forms, a generalised eigenvalue problem and scikit-learn."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

from cospeech.evaluation.metrics import genea
from cospeech.skeleton import UPPER55

seeds = st.integers(0, 10**6)


def test_joints_that_are_the_origin_or_a_wrist_again_do_not_count():
    left_out = set(range(55)) - set(genea.JOINTS.tolist())
    assert left_out == set(UPPER55.joints("pelvis", "left_hand_root", "right_hand_root"))


@pytest.mark.parametrize("fps", [15.0, 30.0])
def test_jerk_and_acceleration_of_polynomials_in_centimetres(fps):
    t = np.arange(30)[:, None, None] / fps
    cubic = np.zeros((30, 55, 3)) + np.array([0.03, 0.04, 0.0]) * t**3  # third derivative 6 x 5 cm/s^3
    square = np.zeros((30, 55, 3)) + np.array([0.0, 0.02, 0.0]) * t**2
    assert genea.average_jerk([cubic, square], fps) == pytest.approx((15.0, 15.0), rel=1e-6)
    assert genea.average_acceleration([square], fps) == pytest.approx((4.0, 0.0), abs=1e-6)
    assert np.isnan(genea.average_jerk([square[:3]], fps)).all()


def moving(speeds, fps=15.0):
    """All joints along x, at these speeds in cm/s, frame by frame."""
    steps = np.concatenate([[0.0], np.asarray(speeds) / 100 / fps])
    return np.zeros((len(steps), 55, 3)) + np.cumsum(steps)[:, None, None] * [1.0, 0.0, 0.0]


def test_hellinger_of_speeds_by_hand():
    a, b = moving([2.02] * 30 + [7.02] * 10), moving([2.02] * 10 + [7.02] * 30)  # shares 3/4, 1/4 and the reverse
    assert genea.hellinger([a], [b]) == pytest.approx(np.sqrt(1 - 2 * np.sqrt(3) / 4), abs=1e-9)
    assert genea.hellinger([a], [a]) == pytest.approx(0, abs=1e-7)
    assert genea.hellinger([moving([2.02] * 9)], [moving([9.02] * 9)]) == pytest.approx(1)
    assert genea.hellinger([a, b], [b, a]) == pytest.approx(0, abs=1e-7)


def test_the_histogram_has_the_published_bins_and_keeps_what_is_faster():
    shares = genea.distance_histogram([moving([0.12] * 5 + [48.97] * 3 + [200.0] * 2)])
    assert len(shares) == 980
    assert dict(zip(np.flatnonzero(shares), shares[shares > 0], strict=True)) == pytest.approx({2: 0.5, 979: 0.5})
    steady, braking = moving([10.0] * 20), moving(np.linspace(10, 9, 21))  # 0.05 cm/s each 1/15 s: 0.75 cm/s^2
    assert np.flatnonzero(genea.distance_histogram([steady], order=2, width=0.5)) == [0]
    assert np.flatnonzero(genea.distance_histogram([braking], order=2, width=0.5)) == [1]


@settings(max_examples=25, deadline=None)
@given(seed=seeds, width=st.integers(1, 4))
def test_canonical_correlation_solves_the_generalised_eigenvalue_problem(seed, width):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(80, width)), rng.normal(size=(80, 3))
    b[:, 0] += a[:, 0]
    c = np.cov(np.hstack([a, b]).T)
    aa, ab, bb = c[:width, :width], c[:width, width:], c[width:, width:]
    expected = np.sqrt(eigh(ab @ np.linalg.solve(bb, ab.T), aa, eigvals_only=True)[-1])
    assert genea.canonical_correlation(a, b) == pytest.approx(expected, rel=1e-9)
    mixed = a @ (np.eye(width) + 0.1 * rng.uniform(size=(width, width))) + 5
    assert genea.canonical_correlation(mixed, 3 * b) == pytest.approx(expected, rel=1e-9)


def test_canonical_correlation_is_that_of_scikit_learn():
    from sklearn.cross_decomposition import CCA

    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(500, 5)), rng.normal(size=(500, 4))
    b[:, 1] += 0.8 * a[:, 2] - 0.5 * a[:, 0]
    x, y = CCA(n_components=1, max_iter=5000, tol=1e-12).fit_transform(a, b)
    assert genea.canonical_correlation(a, b) == pytest.approx(np.corrcoef(x[:, 0], y[:, 0])[0, 1], rel=1e-5)


def test_what_does_not_vary_has_no_correlation(swing):
    still, move = swing(np.zeros(40)), swing(np.sin(np.arange(40) / 3))
    assert np.isnan(genea.cca_global([still], [move])) and np.isnan(genea.cca_per_clip([still], [move]))
    assert genea.cca_per_clip([move, still], [move, still]) == pytest.approx(1.0)


def test_one_pair_of_directions_for_all_clips_finds_less_than_one_for_each(swing):
    t = np.arange(200) / 15
    left = [swing(np.sin(t), 0 * t), swing(0 * t, np.sin(t))]
    truth = [swing(np.sin(t), np.cos(2 * t)), swing(np.cos(3 * t), np.sin(t))]
    assert genea.cca_per_clip(left, truth) == pytest.approx(1.0, abs=1e-6)
    assert genea.cca_global(left, truth) < 0.95
