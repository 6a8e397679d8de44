"""SMPL-X parameters as parts of a track: joints by forward kinematics, relative to pelvis and wrists."""

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.formats.smplx_motion import smplx_animation
from cospeech.skeleton import Skeleton
from cospeech.track import Points

CAMERA = np.array([1.0, -1.0, -1.0])  # SMPL-X's x left, y up, z ahead -> a camera in front: x right, y down, z away
FINGER = {"little": "pinky"}  # where its names are others
Y_UP = Rotation.from_euler("x", -90, degrees=True)  # z up (AMASS) -> y up
BODY = {"pelvis": "pelvis", "spine": "spine2", "neck": "neck", "head": "head", "head_top": "head_top"} | {
    f"{side}_{joint}": f"{side}_{joint}"
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "wrist", "hip")
}


def smplx_parts(arrays, path, body_model=None):
    """({part: Points} in metres, frames per second) of SMPL-X parameters (`formats.smplx_motion`); frames that hold
    NaN are not observed."""
    animation, seen = smplx_animation(arrays, path, body_model)
    joints = dict(zip(animation.names, animation.forward_kinematics()[0].swapaxes(0, 1), strict=True))
    up = np.median(joints["head"] - joints["pelvis"], axis=0)
    if abs(up[2]) > abs(up[1]):
        joints = {name: Y_UP.apply(xyz) for name, xyz in joints.items()}
    body = np.stack([joints[BODY[name]] for name in Skeleton.load("upper13").names], axis=1)
    parts = {"body": _points("upper13", body - body[:, [10]], seen, "root", "pelvis")}
    for side in ("left", "right"):
        hand = [joints[f"{side}_wrist"]] + [
            joints[f"{side}_{FINGER.get(finger, finger)}{int(number) + 1}"]
            for finger, number in (name.split("_") for name in Skeleton.load("hand21").names[1:])
        ]
        hand = np.stack(hand, axis=1)
        parts[f"{side}_hand"] = _points("hand21", hand - hand[:, :1], seen, "wrist", "hand_root")
    return parts, animation.fps


def _points(skeleton, xyz, seen, space, root):
    frames, count = xyz.shape[:2]
    score = np.repeat(seen[:, None], count, axis=1).astype(np.float32)
    placed = np.where(seen[:, None, None], xyz * CAMERA, 0.0).astype(np.float32)
    return Points(skeleton, np.zeros((frames, count, 2), np.float32), score, seen.copy(), placed, space, root, True)
