"""The metrics against closed forms and against motions whose answer is known from their construction."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import sqrtm
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.skeleton import UPPER55

LEFT, RIGHT = UPPER55.joints("left_wrist", "right_wrist")
seeds = st.integers(0, 10**6)


def with_moments(mean, covariance, count, seed=0):
    """Samples whose sample mean and unbiased sample covariance are exactly the given ones."""
    x = np.random.default_rng(seed).normal(size=(count, len(mean)))
    x -= x.mean(axis=0)
    x = x @ np.linalg.inv(np.linalg.cholesky(np.cov(x.T))).T
    return x @ np.linalg.cholesky(covariance).T + mean


# ---- Frechet distance -----------------------------------------------------------------------------------------------


def test_frechet_distance_of_axis_aligned_gaussians_is_the_closed_form():
    a = with_moments([0, 1, -2], np.diag([1.0, 4.0, 0.25]), 50)
    b = with_moments([3, 1, 2], np.diag([9.0, 1.0, 0.25]), 80, seed=1)
    assert metrics.frechet_distance(a, b) == pytest.approx(9 + 16 + (1 - 3) ** 2 + (2 - 1) ** 2, rel=1e-10)


@settings(max_examples=30, deadline=None)
@given(seed=seeds, dimensions=st.integers(1, 12))
def test_frechet_distance_equals_the_formula_with_a_matrix_root(seed, dimensions):
    rng = np.random.default_rng(seed)
    a, b = (rng.normal(size=(n, dimensions)) @ rng.normal(size=(dimensions, dimensions)) for n in (60, 45))
    b += rng.normal(size=dimensions)
    s, t = np.atleast_2d(np.cov(a.T)), np.atleast_2d(np.cov(b.T))
    expected = np.sum((a.mean(0) - b.mean(0)) ** 2) + np.trace(s + t - 2 * np.real(sqrtm(s @ t)))
    assert metrics.frechet_distance(a, b) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(seed=seeds)
def test_frechet_distance_is_symmetric_zero_for_itself_and_blind_to_order_and_rotation(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(30, 6)), rng.normal(1, 2, size=(20, 6))
    distance = metrics.frechet_distance(a, b)
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    assert metrics.frechet_distance(b, a) == pytest.approx(distance, rel=1e-12)
    assert metrics.frechet_distance(a, a) == pytest.approx(0, abs=1e-12)
    assert metrics.frechet_distance(rng.permutation(a), rng.permutation(b)) == pytest.approx(distance, rel=1e-10)
    assert metrics.frechet_distance(a @ turn, b @ turn) == pytest.approx(distance, rel=1e-10)


def test_frechet_distance_needs_no_more_samples_than_dimensions():
    a, b = with_moments([0, 0], np.eye(2), 6), with_moments([1, 0], 4 * np.eye(2), 6, seed=1)
    embedding = np.linalg.qr(np.random.default_rng(2).normal(size=(64, 2)))[0].T
    assert metrics.frechet_distance(a @ embedding, b @ embedding) == pytest.approx(1 + 2 * (1 - 2) ** 2, rel=1e-9)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.zeros((1, 4)), np.zeros((5, 4)), "at least 2"),
        (np.zeros((5, 4)), np.zeros((5, 3)), "expected"),
        (np.full((5, 4), np.nan), np.zeros((5, 4)), "NaN"),
    ],
)
def test_frechet_distance_refuses(a, b, message):
    with pytest.raises(CospeechError, match=message):
        metrics.frechet_distance(a, b)


# ---- diversity ------------------------------------------------------------------------------------------------------


def test_diversity_of_few_points_is_the_mean_over_all_pairs():
    assert metrics.diversity(np.array([[0, 0], [3, 0], [0, 4]])) == pytest.approx((3 + 4 + 5) / 3)


def test_diversity_never_pairs_a_sample_with_itself():
    assert metrics.diversity(np.eye(50)) == pytest.approx(np.sqrt(2), abs=1e-12)


def test_diversity_draws_by_seed_around_the_mean_over_all_pairs():
    latents = np.random.default_rng(0).normal(size=(200, 32))
    every = metrics.diversity(latents, pairs=10**6)
    draws = [metrics.diversity(latents, seed=seed) for seed in range(10)]
    assert draws[3] == metrics.diversity(latents, seed=3)
    assert len(set(draws)) == 10
    assert np.mean(draws) == pytest.approx(every, rel=0.01)


def test_diversity_of_one_sample_is_refused():
    with pytest.raises(CospeechError, match="pair"):
        metrics.diversity(np.zeros((1, 8)))


# ---- beats ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fps", [15.0, 30.0])
@pytest.mark.parametrize("phase", [0.0, 0.5])  # turning points on frames, and half way between two
def test_beats_of_a_swing_are_its_turning_points(swing, fps, phase):
    half = round(0.6 * fps)  # frames from one turn to the next
    positions = swing(0.8 * np.cos(np.pi * (np.arange(10 * half) + phase) / half))
    turns = (np.arange(1, 10) * half - phase) / fps
    assert metrics.motion_beats(positions, fps) == pytest.approx(turns, abs=1e-9)
    assert metrics.beat_consistency(positions, turns, fps) == pytest.approx(1.0, abs=1e-9)
    assert metrics.beat_consistency(positions, turns + 0.1, fps) == pytest.approx(np.exp(-0.5), abs=1e-9)
    assert metrics.beat_consistency(positions, turns - 0.1, fps, sigma=0.2) == pytest.approx(np.exp(-1 / 8), abs=1e-9)


def test_the_beat_of_a_hold_is_where_the_arm_arrives(swing):
    rise = (1 - np.cos(np.pi * np.arange(8) / 7)) / 2
    angle = np.concatenate([np.zeros(5), rise, np.ones(9), 1 - rise, np.zeros(6), rise])
    beats = metrics.motion_beats(swing(angle))
    assert beats == pytest.approx(np.array([12, 29]) / 15, abs=0.035)


@settings(max_examples=30, deadline=None)
@given(seed=seeds)
def test_beat_consistency_is_the_mean_over_onsets_of_a_gaussian_of_the_nearest_beat(swing, seed):
    rng = np.random.default_rng(seed)
    positions = swing(*np.tanh(np.cumsum(rng.normal(0, 0.2, (2, 90)), axis=1)))
    onsets = np.sort(rng.uniform(0, 6, rng.integers(1, 12)))
    beats = metrics.motion_beats(positions)
    expected = np.mean([np.exp(-min((t - b) ** 2 for b in beats) / 0.02) for t in onsets])
    assert metrics.beat_consistency(positions, onsets) == pytest.approx(expected, rel=1e-12)


def test_beats_do_not_depend_on_size_place_or_direction(swing):
    positions = swing(np.tanh(np.cumsum(np.random.default_rng(0).normal(0, 0.2, 120))))
    turned = Rotation.from_euler("yx", [40, 20], degrees=True).apply(positions.reshape(-1, 3)).reshape(positions.shape)
    expected = metrics.motion_beats(positions)
    assert len(expected) > 5
    assert metrics.motion_beats(1.7 * turned + [3, 1, -2]) == pytest.approx(expected, abs=1e-9)


def test_a_metric_that_does_not_apply_is_nan_and_stillness_has_no_beat(swing):
    moving, still = swing(np.sin(np.arange(60))), swing(np.zeros(60))
    assert np.isnan(metrics.beat_consistency(moving, []))
    assert metrics.beat_consistency(still, [1.0, 2.0]) == 0.0
    assert metrics.beat_consistency(still.astype(np.float32) + np.float32(0.1), [1.0], maac=np.full(9, 0.01)) == 0.0
    assert len(metrics.motion_beats(moving[:1])) == len(metrics.motion_beats(moving[:2])) == 0


def test_threshold_drops_shallow_beats(swing):
    speed = 0.02 + 0.002 * np.cos(np.pi * np.arange(80) / 5)  # always down, a tenth slower every tenth frame
    positions = swing(np.cumsum(speed) - 0.8)
    assert metrics.motion_beats(positions, threshold=0.001) == pytest.approx(
        (np.arange(5, 80, 10) - 0.5) / 15, abs=1e-9
    )
    assert len(metrics.motion_beats(positions, threshold=0.05)) == 0


def test_a_step_on_one_side_makes_a_beat(swing):
    speed = np.concatenate([np.full(10, 0.05), 0.01 + 0.0001 * np.arange(20)])  # brakes hard, then gains slowly
    positions = swing(np.concatenate([[0], np.cumsum(speed)]) - 0.5)
    assert metrics.motion_beats(positions) == pytest.approx([10.5 / 15], abs=1e-9)


def test_angle_changes_are_the_turned_angles_and_maac_their_mean(swing):
    turned = np.array([0.0, 0.1, 0.3, 0.2, 0.2])
    changes = metrics.angle_changes(swing(turned))
    elbow = np.abs(np.diff(turned)) / np.pi
    moving = changes.max(axis=0) > 1e-9
    assert moving.sum() == 1  # the left elbow; the hand turns with the forearm
    assert changes[:, moving][:, 0] == pytest.approx(elbow, abs=1e-12)
    two = metrics.mean_angle_change([swing(turned), swing(turned[:2])])
    assert two == pytest.approx(np.concatenate([changes, changes[:1]]).mean(axis=0))


def test_finger_beats_count_only_when_asked_for(swing):
    positions = swing(np.zeros(60))
    tip = UPPER55.index["left_index_3"]
    positions[:, tip, 1] += 0.03 + 0.02 * np.sin(np.arange(60) / 2)
    assert len(metrics.motion_beats(positions)) == 0
    assert len(metrics.motion_beats(positions, angles=metrics.ALL_ANGLES)) > 3


def test_every_bone_joins_two_joints_once_and_none_has_no_length(rest_pose):
    joints = set(metrics.BONES[:, 1])
    assert joints == set(range(55)) - set(UPPER55.joints("pelvis", "left_hand_root", "right_hand_root"))
    directions = metrics.bone_directions(rest_pose[None])
    assert np.linalg.norm(directions, axis=-1) == pytest.approx(1.0)


# ---- kinematics -----------------------------------------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(seed=seeds, fps=st.sampled_from([15.0, 25.0, 30.0, 60.0]))
def test_derivatives_of_polynomials_are_exact_at_any_rate(seed, fps):
    coefficients = np.random.default_rng(seed).normal(size=(4, 55, 3))
    t = np.arange(40)[:, None, None] / fps
    cubic = sum(c * t**k for k, c in enumerate(coefficients))
    square = cubic - coefficients[3] * t**3
    assert metrics.jerk(cubic, fps) == pytest.approx(6 * np.linalg.norm(coefficients[3], axis=-1).mean(), rel=1e-6)
    assert metrics.acceleration(square, fps) == pytest.approx(2 * np.linalg.norm(coefficients[2], axis=-1).mean())
    assert metrics.jerk(square, fps) == pytest.approx(0, abs=1e-6)


def test_derivatives_of_too_few_frames_do_not_apply():
    assert np.isnan(metrics.jerk(np.zeros((3, 55, 3)))) and np.isnan(metrics.acceleration(np.zeros((2, 55, 3))))


def test_wrist_speed_on_a_circle_and_heights():
    positions, angle = np.zeros((60, 55, 3)), 0.2 * np.arange(60)
    positions[:, LEFT] = 0.3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    positions[:, RIGHT, 1] = 0.5
    speeds = metrics.wrist_speeds(positions, fps=30.0)
    assert speeds[:, 0] == pytest.approx(2 * 0.3 * np.sin(0.1) * 30)  # chord of the arc
    assert speeds[:, 1] == pytest.approx(0)
    lifted = positions + np.array([0.0, 2.0, 0.0])  # heights are above the pelvis, wherever that is
    assert metrics.wrist_heights(lifted) == pytest.approx(np.stack([0.3 * np.sin(angle), np.full(60, 0.5)], axis=1))
    assert metrics.wrist_asymmetry(positions) == pytest.approx(np.abs(0.5 - 0.3 * np.sin(angle)))


def test_motion_variance_of_a_sinusoid():
    positions = np.zeros((100, 55, 3))
    positions[:, 7, 1] = 0.4 * np.sin(2 * np.pi * np.arange(100) / 25)
    assert metrics.motion_variance(positions + 1.0) == pytest.approx(0.4**2 / 2 / 165)


def test_speed_histogram_counts_joint_speeds_in_bins():
    positions = np.zeros((11, 55, 3))
    positions[:, :5, 0] = 0.02 * np.arange(11)[:, None]  # 0.3 m/s at 15 fps
    positions[:, 5, 0] = 100 * np.arange(11)
    histogram = metrics.speed_histogram([positions], fps=15.0, width=0.07)
    assert histogram.sum() == pytest.approx(1)
    assert (histogram[0], histogram[4], histogram[-1]) == pytest.approx((49 / 55, 5 / 55, 1 / 55))


def test_hellinger_distance_of_known_histograms():
    assert metrics.hellinger([0.5, 0.5, 0], [0.5, 0.5, 0]) == 0
    assert metrics.hellinger([1, 0, 0], [0, 0.5, 0.5]) == 1
    assert metrics.hellinger([0.36, 0.64], [1, 0]) == pytest.approx(np.sqrt(1 - 0.6))


def test_low_pass_keeps_lines_and_adds_variances(swing):
    line = np.arange(60.0)[:, None, None] * np.ones((1, 55, 3))
    assert metrics.low_pass(line)[10:-10] == pytest.approx(line[10:-10])
    motion = swing(np.sin(np.arange(100) / 3))
    twice = metrics.low_pass(metrics.low_pass(motion, 0.9), 1.2)
    assert twice[15:-15] == pytest.approx(metrics.low_pass(motion, 1.5)[15:-15], abs=1e-3)
    assert np.array_equal(metrics.low_pass(motion, 0), motion)


def test_coverage_by_chance_discounts_many_beats():
    rng = np.random.default_rng(0)
    beats = np.sort(rng.uniform(0, 60, 60))
    chance = metrics.chance_coverage(beats, beats, 60.0)
    assert metrics.onset_coverage(beats, beats) == 1.0
    # a random onset lies uniformly between Poisson beats of one a second: E = integral of 2 exp(-2 d) exp(-d^2 / 0.02)
    d = np.linspace(0, 3, 30_000)
    expected = np.trapezoid(2 * np.exp(-2 * d - d**2 / 0.02), d)
    assert chance == pytest.approx(expected, abs=0.05)
    everywhere = np.arange(0, 60, 0.05)
    assert metrics.onset_coverage(everywhere, beats) - metrics.chance_coverage(everywhere, beats, 60.0) < 0.01
    assert np.isnan(metrics.chance_coverage(beats, beats, 2.0))
