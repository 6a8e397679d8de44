"""The published split of a motion into the vectors that the chapter 4 networks predict (thesis section 4.3.1).

body 42 = 13 joints x 3 (pelvis-relative) + head rotation 3; hands 126 = 2 x 21 x 3, relative to their wrists as the
hand tracker gave them; face E = expression coefficients.
"""

import numpy as np

from cospeech.clip import Motion
from cospeech.skeleton import BODY, UPPER55

BODY_CHANNELS, HAND_CHANNELS = 42, 126
WRISTS = UPPER55.joints(*["right_wrist"] * 21, *["left_wrist"] * 21)  # of each joint 13..54


def motion_to_vectors(motion):
    """Motion -> float32 {"body": (T, 42), "hands": (T, 126)} in metres and, if it has one, {"face": (T, E)}."""
    frames = len(motion)
    rotation = np.zeros((frames, 3), np.float32) if motion.rotation is None else motion.rotation
    hands = motion.positions[:, BODY.stop :] - motion.positions[:, WRISTS]
    vectors = {
        "body": np.concatenate([motion.positions[:, BODY].reshape(frames, -1), rotation], axis=1),
        "hands": hands.reshape(frames, -1),
    }
    if motion.expression is not None:
        vectors["face"] = motion.expression
    return {name: vector.astype(np.float32) for name, vector in vectors.items()}


def vectors_to_motion(vectors, face_model="", build=None):
    """Inverse of `motion_to_vectors`, with the pelvis at the origin, where a network puts it only nearly.

    build : the speaker's, for `Motion.whole`.
    """
    frames = len(vectors["body"])
    body = vectors["body"][:, :-3].reshape(frames, -1, 3).copy()
    body[:, UPPER55.root] = 0
    hands = vectors["hands"].reshape(frames, -1, 3) + body[:, WRISTS]
    positions = np.concatenate([body, hands], axis=1)
    return Motion(positions, vectors["body"][:, -3:], vectors.get("face"), face_model, build=build)
