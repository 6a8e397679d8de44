"""A jointed figure of known rotations, and the clip that a perfect tracker would make of it."""

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.clip import Clip
from cospeech.formats.animation import Animation
from cospeech.formats.ik import INDEX, NAMES, PARENTS, SOURCES
from cospeech.skeleton import UPPER55

FPS = 15.0
FINGERS = {  # base of each finger: metres along the forearm, metres forward
    "Thumb": (0.03, 0.04),
    "Index": (0.09, 0.03),
    "Middle": (0.09, 0.0),
    "Ring": (0.085, -0.02),
    "Pinky": (0.08, -0.04),
}


def offsets():
    """T-pose offsets (55, 3) in metres of an adult: palms down, fingers straight, thumbs at 45 degrees."""
    table = {"Spine": (0, 0.2, 0), "Neck": (0, 0.3, 0), "Head": (0, 0.1, 0), "HeadTop_End": (0, 0.12, 0)}
    for side, s in (("Left", 1), ("Right", -1)):
        table[f"{side}Shoulder"] = table["Neck"]
        table[f"{side}Arm"] = (0.18 * s, -0.086, 0)
        table[f"{side}ForeArm"] = (0.29 * s, 0, 0)
        table[f"{side}Hand"] = (0.25 * s, 0, 0)
        table[f"{side}UpLeg"] = (0.1 * s, -0.05, 0.01)
        for finger, (along, across) in FINGERS.items():
            table[f"{side}Hand{finger}1"] = (along * s, 0, across)
            for k, length in ((2, 0.04), (3, 0.03), (4, 0.025)):
                step = length / np.sqrt(2) if finger == "Thumb" else 0
                table[f"{side}Hand{finger}{k}"] = (step * s, 0, step) if step else (length * s, 0, 0)
    return np.array([table.get(name, (0, 0, 0)) for name in NAMES], float)


def pose(frames, turns=None, root=(0.0, 0.95, 0.0), fps=FPS):
    """Animation of T frames; turns: {joint name: Rotation or rotation vectors (T, 3) or (3,), local, radians}."""
    rotations = np.zeros((frames, len(NAMES), 4))
    rotations[..., 3] = 1.0
    for name, turn in (turns or {}).items():
        turn = turn if isinstance(turn, Rotation) else Rotation.from_rotvec(turn)
        rotations[:, INDEX[name]] = turn.as_quat()
    translation = np.broadcast_to(np.asarray(root, float), (frames, 3)).copy()
    return Animation(NAMES, PARENTS.copy(), offsets(), rotations, translation, fps)


def clip_of(animation, rotation=None, noise=0.0, seed=0):
    """The animation's joint positions as a clip, with Gaussian noise (standard deviation in metres) on every point."""
    world, _ = animation.forward_kinematics()
    positions = np.zeros((len(animation), len(UPPER55), 3))
    positions[:, SOURCES] = world
    positions += np.random.default_rng(seed).normal(0.0, noise, positions.shape) if noise else 0.0
    for side in ("left", "right"):
        hand, wrist = UPPER55.joints(f"{side}_hand_root", f"{side}_wrist")
        positions[:, hand] = positions[:, wrist]
    positions -= positions[:, [UPPER55.root]]
    features = np.zeros((len(animation), 28))
    return Clip("figure", "made", animation.fps, positions, features, root=animation.translation, rotation=rotation)


def steps(quaternions):
    """Degrees (T-1, ...) by which rotations (T, ..., 4) change from frame to frame."""
    cosine = np.abs(np.sum(quaternions[1:] * quaternions[:-1], axis=-1))
    return np.degrees(2 * np.arccos(np.clip(cosine, 0.0, 1.0)))
