"""Equations 3.3 to 3.8 on numbers small enough to work out by hand."""

import pytest
import torch

from cospeech.posenet.network import Output
from cospeech.posenet.training import pose_losses as losses
from cospeech.posenet.training.pose_losses import (
    bone_length_loss,
    bone_vector_loss,
    heatmap_loss,
    pose_loss,
    projection_loss,
)

NAN = float("nan")
CHAIN = (-1, 0, 1)  # three joints in a row


def heatmap_case():
    """Two samples, two joints, 1 x 2 maps."""
    pred = torch.tensor([[[[1.0, 2.0]], [[0.0, 0.0]]], [[[3.0, 0.0]], [[0.0, 1.0]]]])
    truth = torch.tensor([[[[0.0, 0.0]], [[3.0, 0.0]]], [[[3.0, 0.0]], [[0.0, 3.0]]]])
    return pred, truth  # squared differences a joint: 1 + 4 = 5 and 9; 0 and 4


def test_heatmap_loss_sums_over_joints_and_averages_over_samples():
    assert heatmap_loss(*heatmap_case()).item() == (5 + 9 + 0 + 4) / 2


def test_heatmap_mask_leaves_out_single_joints():
    visible = torch.tensor([[True, False], [True, True]])
    assert heatmap_loss(*heatmap_case(), visible).item() == (5 + 0 + 4) / 2


def test_heatmap_mask_may_be_per_sample_or_numbers():
    assert heatmap_loss(*heatmap_case(), torch.tensor([False, True])).item() == 4 / 2
    assert heatmap_loss(*heatmap_case(), torch.tensor([[1, 0], [0, 1]])).item() == (5 + 4) / 2


def pose_case():
    pred = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 2, 0]], [[0.0, 0, 0], [0, 0, 1], [0, 0, 3]]])
    truth = torch.tensor([[[0.0, 0, 0], [0, 0, 2], [0, 2, 2]], [[0.0, 0, 1], [0, 0, 2], [0, 0, 4]]])
    return pred, truth


def test_pose_loss():
    # first: 0, 1 + 4, 1 + 4; second: every joint is 1 too near
    assert pose_loss(*pose_case()).item() == (10 + 3) / 2
    assert pose_loss(*pose_case(), torch.tensor([True, False])).item() == 10 / 2
    joints = torch.tensor([[True, True, False], [False, False, True]])
    assert pose_loss(*pose_case(), joints).item() == (5 + 1) / 2


def test_bone_vector_loss_sees_differences_and_not_shifts():
    # first sample: bone 0-1 is (1,0,0) for (0,0,2): 1 + 4; bone 1-2 is right; second: shifted only
    assert bone_vector_loss(*pose_case(), CHAIN).item() == 5 / 2
    assert bone_vector_loss(*pose_case(), CHAIN, torch.tensor([False, True])).item() == 0


def test_a_bone_counts_when_both_ends_do():
    pred, truth = pose_case()
    for hidden, expected in ((0, 0.0), (1, 0.0), (2, 5 / 2)):
        mask = torch.ones(2, 3, dtype=torch.bool)
        mask[:, hidden] = False
        assert bone_vector_loss(pred, truth, CHAIN, mask).item() == expected


def test_bone_length_loss_compares_squared_lengths():
    pred, _ = pose_case()  # squared lengths: 1 and 4; 1 and 4
    lengths = torch.tensor([[99.0, 2.0, 2.0], [99.0, 1.0, 3.0]])  # squared: 4 and 4; 1 and 9
    assert bone_length_loss(pred, lengths, CHAIN).item() == (3**2 + 0 + 0 + 5**2) / 2
    assert bone_length_loss(pred, lengths, CHAIN, torch.tensor([True, False])).item() == 9 / 2
    assert bone_length_loss(pred, lengths[1], CHAIN).item() == (0 + 25 + 0 + 25) / 2


def test_a_joint_that_is_its_own_parent_has_no_bone():
    assert losses.bones((0, 0, -1, 2)) == ([1, 3], [0, 2])


def test_projection_loss():
    pred, truth = torch.tensor([[[1.0, 2.0], [0.0, 0.0]]]), torch.tensor([[[0.0, 0.0], [3.0, 4.0]]])
    assert projection_loss(pred, truth).item() == 5 + 25
    assert projection_loss(pred, truth, torch.tensor([[False, True]])).item() == 25


@pytest.mark.parametrize("loss", [pose_loss, projection_loss, lambda p, g, m: bone_vector_loss(p, g, CHAIN, m)])
def test_what_is_masked_may_be_nan_and_gets_no_gradient(loss):
    pred, truth = pose_case()
    pred = pred.requires_grad_()
    truth[1] = NAN
    value = loss(pred, truth, torch.tensor([True, False]))
    value.backward()
    assert torch.isfinite(value) and torch.isfinite(pred.grad).all()
    assert pred.grad[1].abs().sum() == 0 and pred.grad[0].abs().sum() > 0


# ---- equation 3.8 ---------------------------------------------------------------------------------------------------


def mixed_batch():
    """A 3D-labelled sample and one with 2D labels alone, chosen so that every term is a round number.

    Joints 0 and 2 have a heatmap. Per sample, before weights: heatmaps 1 each of three maps for each visible joint.
    """
    pose, _ = pose_case()
    truth = torch.full_like(pose, NAN)
    truth[0] = pose_case()[1][0]
    output = Output(
        pose=pose,
        points=torch.zeros(2, 3, 2),
        camera=torch.zeros(2, 4),
        heatmaps=torch.ones(2, 2, 1, 1),
        intermediate=(torch.ones(2, 2, 1, 1), torch.ones(2, 2, 1, 1)),
    )
    labels = losses.Labels(
        points=torch.tensor([[[1.0, 0.0], [0.0, 2.0]], [[NAN, NAN], [3.0, 0.0]]]),
        visible=torch.tensor([[True, True], [False, True]]),
        heatmaps=torch.zeros(2, 2, 1, 1),
        pose=truth,
        labelled=torch.tensor([True, False]),
        lengths=torch.tensor([[0.0, NAN, NAN], [0.0, 1.0, 3.0]]),
    )
    return output, labels


def test_total_loss_has_the_published_weights_and_masks():
    terms, total = losses.total_loss(*mixed_batch(), joints=[0, 2], parents=CHAIN)
    expected = {"heatmap": 3 * 3 / 2, "pose": 10 / 2, "bone_vector": 5 / 2}
    expected |= {"bone_length": 25 / 2, "projection": (1 + 4 + 9) / 2}
    assert {name: term.item() for name, term in terms.items()} == expected
    assert total.item() == pytest.approx(0.1 * 4.5 + 10 * 5 + 10 * 2.5 + 100 * 12.5 + 10 * 7)


def test_a_zero_weight_leaves_its_term_out():
    terms, total = losses.total_loss(*mixed_batch(), joints=[0, 2], parents=CHAIN, weights=losses.PRETRAINING)
    assert list(terms) == ["heatmap"] and total.item() == pytest.approx(0.45)


def test_a_batch_may_be_all_of_one_kind():
    output, labels = mixed_batch()
    for labelled in (torch.tensor([True, True]), torch.tensor([False, False])):
        one_kind = losses.Labels(
            labels.points, labels.visible, labels.heatmaps, torch.zeros(2, 3, 3), labelled, torch.ones(2, 3)
        )
        terms, total = losses.total_loss(output, one_kind, [0, 2], CHAIN)
        assert torch.isfinite(total)
        assert (terms["bone_length"] == 0) == labelled.all() and (terms["pose"] == 0) == (~labelled).all()
