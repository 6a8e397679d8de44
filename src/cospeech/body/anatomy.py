"""Anatomy: an adult's size, a resting hand, and where a body faces. Metres; x left, y up, z forward."""

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.rotation import heading
from cospeech.skeleton import UPPER55

TORSO_AND_ARM = 1.1  # metres: pelvis-spine-neck plus shoulder-elbow-wrist of an adult
HEADING_SECONDS = 0.5  # sigma of the Gaussian that smooths where a body faces
UP = np.array([0.0, 1.0, 0.0])

# A relaxed left hand, palm down in a T-pose: knuckle (x to the fingers, y up, z to the thumb) and the lengths of the
# three bones, metres, for a forearm of 0.25 m; degrees by which the bones hang.
REST_HAND = {
    "thumb": ((0.025, -0.010, 0.030), (0.045, 0.032, 0.027)),
    "index": ((0.095, 0.000, 0.025), (0.043, 0.025, 0.020)),
    "middle": ((0.095, 0.002, 0.002), (0.047, 0.030, 0.022)),
    "ring": ((0.088, 0.000, -0.018), (0.043, 0.028, 0.021)),
    "little": ((0.078, -0.003, -0.036), (0.033, 0.020, 0.018)),
}
REST_BEND = np.radians([15.0, 40.0, 60.0])
REST_FOREARM = 0.25


def left_of(positions):
    """Unit directions to the left of hips and shoulders: (T, 55, 3) -> (T, 2, 3); zero where the joints coincide."""
    left, right = UPPER55.joints("left_hip", "left_shoulder"), UPPER55.joints("right_hip", "right_shoulder")
    across = positions[:, left] - positions[:, right]
    return across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)


def facing_of(positions, rate):
    """Where hips and shoulders (T, 55, 3) face, smoothed over time: T rotations about the vertical; none for +z."""
    return Rotation.from_rotvec(heading(left_of(positions), rate, HEADING_SECONDS)[:, None] * UP)


def rest_hand(scale, sign):
    """{finger: (4, 3) metres}: each joint's offset from the one before, for the left (sign 1) or right hand (-1).

    In a T-pose, palms down, x left and y up; `scale` 1 fits a forearm of REST_FOREARM.
    """
    hand = {}
    for finger, (knuckle, lengths) in REST_HAND.items():
        bend = np.zeros(3) if finger == "thumb" else REST_BEND
        ahead = np.array([0.75, -0.15, 0.65]) if finger == "thumb" else np.array([1.0, 0.0, 0.0])
        directions = np.cos(bend)[:, None] * ahead / np.linalg.norm(ahead) - np.sin(bend)[:, None] * UP
        hand[finger] = np.vstack([knuckle, directions * np.array(lengths)[:, None]]) * scale * [sign, 1.0, 1.0]
    return hand
