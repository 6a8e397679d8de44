"""The losses of thesis chapter 3, equations 3.3 to 3.8, on torch tensors.

Each is a sum over joints, as printed, and a mean over the B samples of the mini-batch. A mask takes out samples (B,) or
single joints (B, J); what is masked adds nothing and may hold anything, NaN included. Samples with and without 3D
labels so share a mini-batch, and each keeps the weight that equation 3.8 gives it, whatever the mix.

Not published, ours: 3D in metres, 2D in the crop's coordinates (-1 to 1), heatmaps with a peak of 1.
"""

from dataclasses import dataclass

import torch

from cospeech.posenet import JOINTS21


def heatmap_loss(pred, truth, mask=None):
    """Equation 3.3: sum over k of b_k |m_k - m_k^GT|^2. pred, truth (B, K, h, w); mask b (B, K) or (B,) -> scalar."""
    return _mean_of_sums(pred.flatten(2), truth.flatten(2), mask)


def pose_loss(pred, truth, mask=None):
    """Equation 3.4, and eq. 3.1 of the baseline: squared distance of 3D joints.

    pred, truth (B, J, 3); mask (B,) or (B, J) -> scalar.
    """
    return _mean_of_sums(pred, truth, mask)


def bone_vector_loss(pred, truth, parents=JOINTS21.parents, mask=None):
    """Equation 3.5, for 3D-labelled samples: squared difference of bone vectors.

    pred, truth (B, J, 3); parents: J ints, -1 or itself where a joint has none -> scalar. With a mask (B, J) a bone
    counts when both of its ends do.
    """
    child, parent = bones(parents)
    return _mean_of_sums(
        pred[:, parent] - pred[:, child], truth[:, parent] - truth[:, child], _of_bones(mask, child, parent)
    )


def bone_length_loss(pred, lengths, parents=JOINTS21.parents, mask=None):
    """Equation 3.6, for samples with 2D labels only: squared difference of *squared* bone lengths.

    pred (B, J, 3); lengths (B, J) or (J,): each joint's distance from its parent in a training subject drawn at random
    (a root's entry is not read); parents and mask as in `bone_vector_loss` -> scalar.
    """
    child, parent = bones(parents)
    squared = (pred[:, parent] - pred[:, child]).square().sum(dim=2)
    target = torch.as_tensor(lengths, dtype=pred.dtype, device=pred.device)[..., child].square().expand_as(squared)
    return _mean_of_sums(squared[..., None], target[..., None], _of_bones(mask, child, parent))


def projection_loss(pred, truth, mask=None):
    """Equation 3.7: squared distance of projected joints. pred, truth (B, J, 2); mask (B,) or (B, J) -> scalar."""
    return _mean_of_sums(pred, truth, mask)


def bones(parents):
    """([child], [parent]): the joints that have a parent, and their parents."""
    child = [joint for joint, parent in enumerate(parents) if parent not in (-1, joint)]
    return child, [parents[joint] for joint in child]


def _mean_of_sums(pred, truth, mask):
    """Squared differences (B, J, D), summed over the joints that the mask keeps, mean over B."""
    if mask is not None:  # `where`, as NaN times zero is NaN
        mask = mask.to(pred.device, torch.bool).reshape(*mask.shape, *[1] * (pred.ndim - mask.ndim))
        pred, truth = torch.where(mask, pred, 0.0), torch.where(mask, truth, 0.0)
    return (pred - truth).square().sum() / len(pred)


def _of_bones(mask, child, parent):
    if mask is None or mask.ndim == 1:
        return mask
    mask = mask.to(torch.bool)
    return mask[:, child] & mask[:, parent]


# ---- equation 3.8 ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Weights:
    """Published weights of equation 3.8. A weight of 0 leaves its term out, which gives the rows of Table 3.6."""

    heatmap: float = 0.1
    pose: float = 10.0
    bone_vector: float = 10.0
    bone_length: float = 100.0
    projection: float = 10.0


PRETRAINING = Weights(pose=0.0, bone_vector=0.0, bone_length=0.0, projection=0.0)  # stage 1 of thesis 3.4.2
LIFTING = Weights(heatmap=0.0, bone_length=0.0)  # of people with 3D labels, from drawn heatmaps


@dataclass(frozen=True)
class Labels:
    """What is known about a mini-batch of B crops. K joints have a heatmap, J are predicted in 3D.

    points (B, K, 2) : 2D joints in the crop's coordinates. visible (B, K) bool : which of them are annotated.
    heatmaps (B, K, h, w) : their target maps (`network.heatmap_targets`).
    pose (B, J, 3) : root-relative, metres, in the crop's virtual frame. labelled (B,) bool : which samples have one.
    lengths (B, J) : bone lengths, metres, of a training subject drawn for each sample.
    """

    points: torch.Tensor
    visible: torch.Tensor
    heatmaps: torch.Tensor
    pose: torch.Tensor
    labelled: torch.Tensor
    lengths: torch.Tensor


def total_loss(output, labels, joints, parents=JOINTS21.parents, weights=None):
    """Equation 3.8: ({term: unweighted scalar}, weighted sum) for a network's `Output` and a batch's `Labels`.

    joints : the K indices, among the J, of the joints that have a heatmap (`PoseNet.heatmap_joints`).
    parents : of the J joints. The heatmap term sums the final and the two intermediate maps; the projection acts on all
    samples, pose and bone vectors on labelled ones, bone lengths on the rest.
    """
    weights = weights or Weights()
    seen, labelled = labels.visible, labels.labelled
    maps = (output.heatmaps, *output.intermediate)
    terms = {
        "heatmap": lambda: sum(heatmap_loss(m, labels.heatmaps, seen) for m in maps),
        "pose": lambda: pose_loss(output.pose, labels.pose, labelled),
        "bone_vector": lambda: bone_vector_loss(output.pose, labels.pose, parents, labelled),
        "bone_length": lambda: bone_length_loss(output.pose, labels.lengths, parents, ~labelled),
        "projection": lambda: projection_loss(output.points[:, joints], labels.points, seen),
    }
    losses = {name: term() for name, term in terms.items() if getattr(weights, name) > 0}
    return losses, sum(getattr(weights, name) * loss for name, loss in losses.items())
