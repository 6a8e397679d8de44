"""Outlier gates: what a tracker reports with confidence and is wrong all the same is found by its geometry.

Each gate looks at positions (F, J, 3) and returns (F, J) bool, True where a joint must not be believed.
"""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.skeleton import BODY, UPPER55

SLACK = 0.01  # metres that any bone may differ besides: finger bones are hardly longer than the noise of a tracker
LONGEST_SPIKE = 3  # frames that an outlier lasts; what stays longer has to be caught by the other gates


def robust_bones(positions, believed, pairs=True):
    """(55,) bone lengths of one speaker: the median over all believed frames of all takes, the same left and right.

    positions, believed : lists of (F, 55, 3) in metres (each part relative to its own root) and (F, 55) bool. A bone
    that was never seen is 0. `pairs` takes a left bone and its right counterpart as one.
    """
    parents = np.array([p if 0 <= p != j else j for j, p in enumerate(UPPER55.parents)])
    lengths = [np.linalg.norm(p - p[:, parents], axis=-1) for p in positions]
    lengths = np.concatenate(
        [np.where(b & b[:, parents], length, np.nan) for length, b in zip(lengths, believed, strict=True)]
    )
    if pairs:
        lengths = np.concatenate([lengths, lengths[:, UPPER55.mirror]])
    known = np.isfinite(lengths).any(axis=0)
    bones = np.zeros(len(UPPER55))
    bones[known] = np.nanmedian(lengths[:, known], axis=0)
    return bones


def bone_gate(positions, seen, bones, tolerance):
    """Joints whose bone is more than `tolerance` (a share) and 1 cm longer or shorter than the speaker's `bones` (55,).

    Of a wrong joint both the bone that leads to it and those that leave it are wrong: a joint goes when its own bone is
    wrong, unless its parent is to blame, as the parent's own bone tells.
    """
    parents = np.array([p if 0 <= p != j else j for j, p in enumerate(UPPER55.parents)])
    lengths = np.linalg.norm(positions - positions[:, parents], axis=-1)
    wrong = (np.abs(lengths - bones) > tolerance * bones + SLACK) & (bones > 0) & seen & seen[:, parents]
    return wrong & ~wrong[:, parents]


def speed_gate(positions, seen, fps, limit):
    """Spikes: joints that jump away faster than `limit` (m/s), stay at most 3 frames, and jump back as fast."""
    frames = len(positions)
    spike = np.zeros(seen.shape, bool)
    if frames < 3:
        return spike
    jump = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * fps > limit
    jump &= seen[1:] & seen[:-1]
    for length in range(1, min(LONGEST_SPIKE, frames - 2) + 1):
        back = np.linalg.norm(positions[length + 1 :] - positions[: -length - 1], axis=-1) * fps
        found = jump[: frames - 1 - length] & jump[length:] & (back <= limit * (length + 1))
        for step in range(1, length + 1):
            spike[step : step + len(found)] |= found
    return spike


def agreement_gate(positions, pixels, seen, tolerance):
    """Joints whose 3D position, projected, is more than `tolerance` body sizes away from where they are in the picture.

    The projection is the weak-perspective camera (one scale, one shift) that fits a part's joints best in each frame;
    the size is the root mean square distance of the part's seen joints from their middle. A second fit leaves out what
    the first one flags, so that one wrong joint does not spoil its neighbours' verdict.
    """
    kept, away = seen, None
    for _ in range(2):
        points, image, scale = flat_fit(positions, pixels, kept)
        weight = kept / np.maximum(kept.sum(axis=1), 1)[:, None]
        size = np.sqrt((weight * (image**2).sum(axis=2)).sum(axis=1))
        away = np.linalg.norm(image - scale[:, None, None] * points, axis=-1) / np.maximum(size, 1e-9)[:, None]
        kept = seen & (away <= tolerance)
    return seen & (away > tolerance)


def flat_fit(positions, pixels, kept):
    """The weak-perspective camera of each frame: (points (F, J, 2), image (F, J, 2), scale (F,)), such that
    image = scale * points fits best over the joints `kept` (F, J); both about the middle of these, y down, in the units
    of positions (F, J, 3) and pixels (F, J, 2)."""
    flat = positions[..., :2] * [1.0, -1.0]  # y down, as pixels are
    weight = kept[..., None] / np.maximum(kept.sum(axis=1), 1)[:, None, None]
    points, image = (a - (weight * a).sum(axis=1, keepdims=True) for a in (flat, pixels))
    spread = (weight * points**2).sum(axis=(1, 2))
    return points, image, (weight * points * image).sum(axis=(1, 2)) / np.maximum(spread, 1e-12)


def joined_gate(pixels, seen, part, tolerance):
    """(F,) frames in which a hand is not at its arm: its root lies further from the body's wrist, in the picture, than
    `tolerance` times the distance of the shoulders (its median over the take). `part`: "left_hand" or "right_hand"."""
    side = part.split("_")[0]
    if part not in ("left_hand", "right_hand"):
        raise CospeechError(f"{part!r} is no hand; expected left_hand or right_hand")
    wrist, root = UPPER55.joints(f"{side}_wrist", f"{side}_hand_root")
    left, right = UPPER55.joints("left_shoulder", "right_shoulder")
    body = seen[:, BODY].any(axis=1)
    if not body.any() or not pixels[body, wrist].any() or not pixels[seen[:, root], root].any():
        return np.zeros(len(pixels), bool)  # never seen, or not in the picture
    shoulders = np.median(np.linalg.norm(pixels[body, left] - pixels[body, right], axis=-1))
    away = np.linalg.norm(pixels[:, root] - pixels[:, wrist], axis=-1)
    return (away > tolerance * shoulders) & seen[:, wrist] & seen[:, root]
