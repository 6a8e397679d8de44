"""The pose metrics against straight implementations, pose by pose and joint by joint, and against toy cases."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.posenet import EVALUATED, JOINTS17
from cospeech.posenet.evaluation import pose_metrics as metrics

seeds = st.integers(0, 10**6)
few = settings(max_examples=40, deadline=None)
TOLERANCE = 1e-6  # mm


def pair(seed, poses=None, joints=None):
    """Random truth of about human size, and a prediction that is off by anything from a millimetre to a metre."""
    rng = np.random.default_rng(seed)
    shape = (poses or rng.integers(1, 6), joints or rng.integers(4, 29), 3)
    truth = rng.normal(0, 300, shape)
    return truth + rng.normal(0, 10 ** rng.uniform(0, 3), shape), truth


def straight_errors(pred, truth):
    return [[math.dist(p, g) for p, g in zip(*pose, strict=True)] for pose in zip(pred, truth, strict=True)]


def flat(errors):
    return [e for pose in errors for e in pose]


def straight_pck(errors, threshold=150.0):
    return 100.0 * sum(e < threshold for e in errors) / len(errors)


def straight_auc(errors):
    return sum(straight_pck(errors, t) for t in range(0, 151, 5)) / 31


def straight_scale(pred, truth):
    """The best factor, found from the normal equation in plain sums."""
    numbers = list(zip(pred.ravel(), truth.ravel(), strict=True))
    return pred * (math.fsum(p * g for p, g in numbers) / math.fsum(p * p for p, _ in numbers))


def straight_procrustes(pred, truth):
    """Rotation by scipy's solver of Wahba's problem, then the factor by the normal equation."""
    p, g = pred - pred.mean(axis=0), truth - truth.mean(axis=0)
    rotation, _ = Rotation.align_vectors(g, p)
    return straight_scale(rotation.apply(p), g) + truth.mean(axis=0)


# ---- the interface --------------------------------------------------------------------------------------------------


@few
@given(seed=seeds)
def test_mpjpe_pck_and_auc_equal_straight_implementations(seed):
    pred, truth = pair(seed)
    errors = flat(straight_errors(pred, truth))
    assert metrics.mpjpe(pred, truth) == pytest.approx(math.fsum(errors) / len(errors), abs=TOLERANCE, rel=0)
    assert metrics.pck(pred, truth) == pytest.approx(straight_pck(errors), abs=1e-9)
    assert metrics.pck(pred, truth, threshold=37.0) == pytest.approx(straight_pck(errors, 37.0), abs=1e-9)
    assert metrics.auc(pred, truth) == pytest.approx(straight_auc(errors), abs=1e-9)


@few
@given(seed=seeds)
def test_scale_alignment_equals_the_normal_equation_of_every_pose(seed):
    pred, truth = pair(seed)
    expected = [straight_scale(p, g) for p, g in zip(pred, truth, strict=True)]
    np.testing.assert_allclose(metrics.align(pred, truth, "scale"), expected, atol=TOLERANCE, rtol=0)


@few
@given(seed=seeds)
def test_procrustes_alignment_equals_an_independent_solver_on_every_pose(seed):
    pred, truth = pair(seed)
    expected = [straight_procrustes(p, g) for p, g in zip(pred, truth, strict=True)]
    np.testing.assert_allclose(metrics.align(pred, truth, "procrustes"), expected, atol=TOLERANCE, rtol=0)


@few
@given(seed=seeds)
def test_a_mirrored_pose_is_rotated_not_mirrored_back(seed):
    _, truth = pair(seed, joints=17)
    mirrored = truth * [-1, 1, 1]
    expected = [straight_procrustes(p, g) for p, g in zip(mirrored, truth, strict=True)]
    aligned = metrics.align(mirrored, truth, "procrustes")
    np.testing.assert_allclose(aligned, expected, atol=TOLERANCE, rtol=0)
    assert metrics.mpjpe(aligned, truth) > 10


@few
@given(seed=seeds)
def test_alignments_undo_what_they_allow(seed):
    _, truth = pair(seed, joints=17)
    rng = np.random.default_rng(seed)
    assert metrics.mpjpe(metrics.align(truth * 1.3, truth, "scale"), truth) < TOLERANCE
    turned = truth @ Rotation.random(rng=rng).as_matrix().T * 0.7 + rng.normal(0, 1000, (len(truth), 1, 3))
    assert metrics.mpjpe(metrics.align(turned, truth, "procrustes"), truth) < TOLERANCE
    assert np.array_equal(metrics.align(turned, truth, "none"), turned)


def test_thresholds_are_strict_and_zero_counts():
    truth = np.zeros((1, 4, 3))
    pred = truth.copy()
    pred[0, :, 1] = [0.0, 149.999, 150.0, 151.0]
    assert metrics.pck(pred, truth) == 50.0
    assert metrics.auc(truth, truth) == pytest.approx(100 * 30 / 31)  # nothing is closer than 0: 96.8, not 100
    assert metrics.auc(pred[:, 1:2], truth[:, 1:2]) == pytest.approx(100 / 31)  # under 150 alone
    assert metrics.auc(pred[:, 2:], truth[:, 2:]) == 0.0


def test_a_prediction_without_extent_does_not_become_nan():
    _, truth = pair(3, poses=2)
    nothing = np.zeros_like(truth)
    assert np.array_equal(metrics.align(nothing, truth, "scale"), nothing)
    centroid = np.broadcast_to(truth.mean(axis=1, keepdims=True), truth.shape)
    np.testing.assert_allclose(metrics.align(nothing, truth, "procrustes"), centroid)


def test_velocity_error_sees_jitter_and_not_offset():
    _, truth = pair(4, poses=5)
    assert metrics.velocity_error(truth + 40.0, truth) == pytest.approx(0, abs=TOLERANCE)
    flicker = truth + np.array([0.0, 3.0, 0.0, 3.0, 0.0])[:, None, None] * [1, 0, 0]
    assert metrics.velocity_error(flicker, truth) == pytest.approx(3.0, abs=TOLERANCE)
    assert math.isnan(metrics.velocity_error(truth[:1], truth[:1]))


@pytest.mark.parametrize(
    ("pred", "words"),
    [(np.zeros((2, 16, 3)), "two equal"), (np.zeros((2, 17, 2)), "two equal"), (np.full((2, 17, 3), np.nan), "NaN")],
)
def test_unusable_poses_are_refused_in_one_line(pred, words):
    with pytest.raises(CospeechError, match=words):
        metrics.mpjpe(pred, np.zeros((2, 17, 3)))


def test_unknown_alignment_is_refused_by_name():
    with pytest.raises(CospeechError, match="'global'"):
        metrics.align(*pair(0), "global")


# ---- MPI-INF-3DHP ---------------------------------------------------------------------------------------------------


def straight_official(pred, truth):
    """The MATLAB scripts' way: centre at joint 15 (counted from 1), error of 17 joints, PCK and AUC by joint group."""
    groups = [[0], [1], [2, 5], [3, 6], [4, 7], [8, 11], [9, 12], [10, 13]]
    errors = straight_errors(pred - pred[:, 14:15], truth - truth[:, 14:15])
    columns = [[pose[j] for pose in errors for j in group] for group in groups]
    sizes = [len(group) for group in groups]
    total = sum(straight_pck(c) * n for c, n in zip(columns, sizes, strict=True)) / 14
    area = sum(straight_auc(c) * n for c, n in zip(columns, sizes, strict=True)) / 14
    return [straight_pck(c) for c in columns], total, area, sum(flat(errors)) / len(errors) / 17


@few
@given(seed=seeds)
def test_official_numbers_equal_the_scripts_definition(seed):
    pred, truth = pair(seed, joints=17)
    groups, total, area, error = straight_official(pred, truth)
    found = metrics.official(pred, truth)
    assert found["PCK"] == pytest.approx(total) and found["AUC"] == pytest.approx(area)
    assert found["MPJPE"] == pytest.approx(error, abs=TOLERANCE, rel=0)
    row = metrics.joint_group_table(pred, truth)
    assert list(row.values()) == pytest.approx([*groups, total, area])
    assert list(row) == ["Head", "Neck", "Shou", "Elbow", "Wrist", "Hip", "Knee", "Ankle", "Total", "AUC"]


def test_the_root_counts_in_mpjpe_17_alone():
    truth = np.random.default_rng(0).normal(0, 300, (3, 17, 3))
    pred = truth.copy()
    pred[:, 14] += [100.0, 0, 0]  # a wrong pelvis moves every other joint
    found = metrics.official(pred, truth)
    assert found["MPJPE 14"] == pytest.approx(100) and found["MPJPE"] == pytest.approx(100 * 16 / 17)


def test_evaluated_joints_are_the_first_fourteen():
    assert JOINTS17.joints(*EVALUATED) == list(range(14)) and JOINTS17.root == 14
    assert sorted(name for group in metrics.GROUPS.values() for name in group) == sorted(EVALUATED)


def test_activity_table_cuts_by_activity_and_keeps_all():
    pred, truth = pair(7, poses=6, joints=17)
    activity = np.array([1, 7, 1, 3, 3, 3])
    table = metrics.activity_table(pred, truth, activity, how="procrustes")
    assert list(table) == ["Standing/Walking", "Sitting", "Miscellaneous", "All"]
    assert table["Sitting"] == metrics.joint_group_table(pred[3:], truth[3:], "procrustes")
    assert table["All"] == metrics.joint_group_table(pred, truth, "procrustes")


def test_scene_table_has_three_protocols_and_weights_scenes_by_frames():
    truth = np.random.default_rng(5).normal(0, 300, (10, 17, 3))
    pred = truth.copy()
    pred[:3, [0, 2]] += 400.0  # 2 of 14 joints wrong in the 3 frames of the studio
    table = metrics.scene_table(pred, truth, np.array([1, 1, 2, 3, 3, 4, 4, 5, 6, 6]))
    assert list(table) == ["unscaled", "globally scaled", "Procrustes"]
    row = table["unscaled"]
    assert row["GS"] == pytest.approx(100 * 12 / 14) and row["No GS"] == row["Outdoor"] == 100
    assert row["All"] == pytest.approx(100 * (140 - 6) / 140)
    assert math.isnan(metrics.scene_table(pred, truth, np.ones(10, int))["unscaled"]["Outdoor"])


def test_action_table_averages_over_actions_not_frames():
    truth = np.zeros((4, 5, 3))
    pred = truth + np.array([30.0, 0, 0, 0])[:, None, None] * [0, 0, 1]
    assert metrics.action_table(pred, truth, ["Walk", "Sit", "Sit", "Sit"]) == {"Sit": 0.0, "Walk": 30.0, "Avg.": 15.0}


def test_labels_that_do_not_fit_are_refused():
    pred, truth = pair(1, poses=3, joints=17)
    with pytest.raises(CospeechError, match="activity must be one of 1 to 7"):
        metrics.activity_table(pred, truth, [0, 1, 2])
    with pytest.raises(CospeechError, match="sequence must be one of 1 to 6 for each of 3"):
        metrics.scene_table(pred, truth, [1, 2])
    with pytest.raises(CospeechError, match="16 joints"):
        metrics.official(pred[:, 1:], truth[:, 1:])
