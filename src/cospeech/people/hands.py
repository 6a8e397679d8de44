"""Articulated hands: finger shapes within the joints' limits, and the 21 joints that follow from them."""

import numpy as np

from cospeech.people.anthropometry import LIMITS, TABLE
from cospeech.people.pose_table import POSES
from cospeech.skeleton import LONG_FINGERS

SHAPES = {name: np.array(values) for name, values in POSES["hands"].items()}
# Full flexion of knuckle, middle and end joint; the end joint follows the middle one (Rijpkema & Girard 1991: 2/3).
FULL = np.radians([80.0, 98.0, 65.0])
KNUCKLES_ALONE = np.radians(60.0)


def draw_shapes(dice, names):
    """Finger shapes (N, 8) about those named by indices (N,) into `SHAPES`; one in six is mixed from two."""
    table = np.stack(list(SHAPES.values()))
    other, mixed = dice.choice(np.ones(len(table))), dice.uniform(0.2, 0.8) * dice.chance(1 / 6)
    shape = table[names] + (table[other] - table[names]) * mixed[:, None]
    return np.clip(dice.normal(shape, POSES["hand_deviation"], count=8), -0.05, 1.0)


def hand_joints(shape, length):
    """The 21 joints (N, 21, 3) of a hand in its own axes: along the fingers, to the thumb, out of the palm; metres.

    shape (N, 8) as in poses.yaml; length (N,) of the hand. Order: root, then index, middle, ring, little, thumb, each
    from knuckle to tip.
    """
    joints = np.zeros((len(shape), 21, 3))
    for i, name in enumerate(LONG_FINGERS):
        finger = TABLE["fingers"][name]
        bent = shape[:, i, None] * FULL
        bent[:, 0] += shape[:, 7] * KNUCKLES_ALONE
        for joint, limit in enumerate(("knuckle", "middle_joint", "end_joint")):
            low = np.radians(LIMITS[limit][0]) if joint == 0 else 0.0
            bent[:, joint] = np.clip(bent[:, joint], low, np.radians(LIMITS[limit][1]))
        aside = np.radians(finger["spread"]) * (0.1 + shape[:, 6]) * (1 - 0.8 * np.clip(shape[:, i], 0, 1))
        straight = np.stack([np.cos(aside), np.sin(aside), 0 * aside], axis=1)
        joints[:, 1 + 4 * i : 5 + 4 * i] = _chain(finger, np.cumsum(bent, axis=1), straight, [0.0, 0.0, 1.0])
    opposed, flexed = np.clip(shape[:, 5], 0, 1), np.clip(shape[:, 4], 0, 1)
    aside, out = np.radians(56.0 - 38.0 * opposed), np.radians(10.0 + 42.0 * opposed)
    first = np.stack([np.cos(aside) * np.cos(out), np.sin(aside) * np.cos(out), np.sin(out)], axis=1)
    across = np.stack([0 * opposed, -0.45 - 0.45 * opposed, 0.40 + 0 * opposed], axis=1)
    across -= first * np.sum(first * across, axis=1, keepdims=True)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    bent = np.radians(np.stack([0 * flexed, LIMITS["thumb_joint"][1] * flexed, 62 * flexed], axis=1))
    joints[:, 17:] = _chain(TABLE["thumb"], np.cumsum(bent, axis=1), first, across)
    return joints * length[:, None, None]


def _chain(finger, angles, straight, towards):
    """(N, 4, 3) knuckle to tip: each bone at its angle (N, 3) from `straight` (N, 3), turned towards `towards`."""
    ways = np.cos(angles)[..., None] * straight[:, None] + np.sin(angles)[..., None] * np.reshape(towards, (-1, 1, 3))
    steps = np.cumsum(ways * np.array(finger["bones"])[:, None], axis=1)
    return np.array(finger["knuckle"]) + np.concatenate([0 * steps[:, :1], steps], axis=1)
