"""The virtual speaker's body: from the channels of arms, torso and head to 55 joint positions, bones exactly constant.

Axes: x left, y up, z forward; metres, pelvis at the origin. `sign` is -1 for the right side and +1 for the left.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.demo.lexicon import ANGLES, POSITION, SHAPE
from cospeech.skeleton import LONG_FINGERS, UPPER55

# Rest offsets in metres of an average adult (about 1.72 m); a speaker's stature scales them all.
HIP = np.array([0.09, -0.06, 0.0])
SPINE = np.array([0.0, 0.22, -0.01])
NECK = np.array([0.0, 0.28, 0.0])
HEAD = np.array([0.0, 0.11, 0.045])
HEAD_TOP = np.array([0.0, 0.25, 0.02])
SHOULDER = np.array([0.175, -0.045, 0.0])
UPPER_ARM, FOREARM = 0.29, 0.255
ARM = UPPER_ARM + FOREARM
LONG_BONES = {  # knuckle in the hand's axes (along the fingers, towards the thumb, out of the palm), bones, spread
    "index": ([0.088, 0.024, 0.000], [0.042, 0.025, 0.021], 14.0),
    "middle": ([0.090, 0.003, 0.000], [0.046, 0.029, 0.022], 2.0),
    "ring": ([0.083, -0.015, 0.001], [0.042, 0.027, 0.022], -9.0),
    "little": ([0.075, -0.032, 0.004], [0.033, 0.020, 0.019], -20.0),
}
THUMB = ([0.026, 0.026, 0.012], [0.044, 0.032, 0.026])
CURL = np.radians([78.0, 100.0, 62.0])  # flexion of a finger's three joints at curl 1
BEND = np.radians(70.0)  # of the knuckles alone at bend 1
REACH = 0.985  # of the arm's length: elbows never lock
TRUNK = np.array([0.17, 0.15])  # half width and half depth that wrists stay out of, metres
LIMITS = np.array([[-88, 88], [-60, 60], [-30, 25], [-5, 75]])  # degrees: pronation, flexion, deviation, elbow


def pose_body(arms, torso, head, shrug, stature):
    """Joint positions and head rotation.

    arms : {"right": (N, 15), "left": (N, 15)} channels of `lexicon`.
    torso, head : (N, 3) degrees: yaw (to the left), pitch (forward, downward), roll (to the right); the head's relative
        to the chest.
    shrug : (N, 2) degrees by which the right and the left shoulder are raised.
    Returns positions (N, 55, 3) metres and rotation (N, 3), the head's axis-angle in radians against the pelvis.
    """
    positions = np.zeros((len(torso), len(UPPER55), 3))
    lower = _turn(0.5 * torso)
    chest = lower * _turn(0.5 * torso)
    skull = chest * _turn(head)
    put = lambda name, value: positions.__setitem__((slice(None), UPPER55.index[name]), value)
    spine = lower.apply(SPINE * stature)
    neck = spine + chest.apply(NECK * stature)
    put("spine", spine)
    put("neck", neck)
    put("head", neck + skull.apply(HEAD * stature))
    put("head_top", neck + skull.apply(HEAD_TOP * stature))
    for sign, side in ((-1, "right"), (1, "left")):
        put(f"{side}_hip", HIP * [sign, 1, 1] * stature)
        joints = _arm(arms[side], sign, shrug[:, (sign + 1) // 2]) * stature
        axes = chest.as_matrix()
        names = [f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", "hand_root")]
        names += [f"{side}_{finger}_{i}" for finger in (*LONG_FINGERS, "thumb") for i in range(4)]
        positions[:, UPPER55.joints(*names)] = neck[:, None] + joints @ axes.transpose(0, 2, 1)
    return positions, skull.as_rotvec()


def _turn(angles):
    yaw, pitch, roll = np.radians(angles).T
    return Rotation.from_euler("YXZ", np.stack([yaw, pitch, roll], axis=1))


def _arm(channels, sign, shrug):
    """Shoulder, elbow, wrist and the 21 hand joints (N, 24, 3) from the neck in the chest's axes, at stature 1."""
    mirror = np.array([sign, 1.0, 1.0])
    rest = SHOULDER * mirror
    wrist = _outside_trunk(rest + channels[:, POSITION] * ARM * mirror, sign)
    raised = np.clip(shrug + 10.0 * (channels[:, 1] + 0.35), -2.0, 22.0)  # the shoulder blade follows a raised arm
    forward = np.clip(12.0 * (channels[:, 2] - 0.6), -3.0, 8.0)
    shoulder = Rotation.from_euler("ZY", np.radians(np.stack([sign * raised, -sign * forward], axis=1))).apply(rest)
    pron, flex, dev, lift = np.radians(np.clip(channels[:, ANGLES].T, *LIMITS.T[:, :, None]))
    along, bulge, offset, shift = _two_bones(wrist - shoulder, sign, lift)
    elbow = shoulder + along * shift + bulge * offset
    wrist = shoulder + along * _reach(wrist - shoulder)
    hand = _hand_axes((wrist - elbow) / FOREARM, -sign * np.cross(along, bulge), sign, pron, flex, dev)
    fingers = _fingers(channels[:, SHAPE]) @ hand + wrist[:, None]
    return np.concatenate([np.stack([shoulder, elbow, wrist], axis=1), fingers], axis=1)


def _outside_trunk(wrist, sign):
    """Wrists (N, 3) moved horizontally out of the trunk's ellipse, and kept on their own side by 3 cm close to it."""
    flat = wrist[:, [0, 2]]
    radius = np.linalg.norm(flat / TRUNK, axis=1, keepdims=True)
    outside = 1 + 0.08 * np.logaddexp(0, (radius - 1) / 0.08)  # a smooth max(radius, 1)
    below = 1 / (1 + np.exp(40.0 * (wrist[:, 1:2] - 0.05)))  # no trunk above the shoulders
    out = wrist.copy()
    out[:, [0, 2]] = flat * (1 + (outside / np.maximum(radius, 0.2) - 1) * below)
    out[:, 0] += sign * 0.02 * np.logaddexp(0, (0.03 - sign * out[:, 0]) / 0.02)
    return out


def _reach(way):
    """(N, 1) distance from shoulder to wrist, within what the two bones allow."""
    return np.clip(np.linalg.norm(way, axis=1, keepdims=True), 0.25 * ARM, REACH * ARM)


def _two_bones(way, sign, lift):
    """Analytic elbow: unit direction to the wrist, unit direction of the elbow's bulge, its size, and where it sits.

    At lift 0 the elbow hangs down and back, in the vertical plane of the arm; lift turns it sideways about that line.
    """
    distance = _reach(way)
    along = way / np.linalg.norm(way, axis=1, keepdims=True)
    shift = (UPPER_ARM**2 - FOREARM**2 + distance**2) / (2 * distance)
    offset = np.sqrt(np.maximum(UPPER_ARM**2 - shift**2, 0))
    hang = np.array([0.0, -0.8, -0.6])
    down = hang - along * (along @ hang)[:, None]
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    side = np.cross(along, down)  # towards the middle for the right arm, away from it for the left
    bulge = np.cos(lift)[:, None] * down + sign * np.sin(lift)[:, None] * side
    return along, bulge, offset, shift


def _hand_axes(forearm, medial, sign, pron, flex, dev):
    """(N, 3, 3) rows: along the fingers, towards the thumb, out of the palm."""
    palm = medial - forearm * np.sum(medial * forearm, axis=1, keepdims=True)
    palm /= np.linalg.norm(palm, axis=1, keepdims=True)
    palm = Rotation.from_rotvec(forearm * (sign * pron)[:, None]).apply(palm)
    thumb = -sign * np.cross(forearm, palm)
    cos, sin = np.cos(flex)[:, None], np.sin(flex)[:, None]
    fingers, palm = cos * forearm + sin * palm, cos * palm - sin * forearm
    cos, sin = np.cos(dev)[:, None], np.sin(dev)[:, None]
    fingers, thumb = cos * fingers + sin * thumb, cos * thumb - sin * fingers
    return np.stack([fingers, thumb, palm], axis=1)


def _fingers(shape):
    """(N, 21, 3) the hand's joints in its own axes: root, then index, middle, ring, little, thumb, knuckle to tip."""
    joints = np.zeros((len(shape), 21, 3))
    for i, (knuckle, bones, spread) in enumerate(LONG_BONES[finger] for finger in LONG_FINGERS):
        flexion = np.cumsum(shape[:, i, None] * CURL + [1, 0, 0] * shape[:, 7, None] * BEND, axis=1)
        aside = np.radians(spread) * (0.15 + shape[:, 6]) * (1 - 0.8 * shape[:, i])
        straight = np.stack([np.cos(aside), np.sin(aside), np.zeros(len(aside))], axis=1)[:, None]
        ways = np.cos(flexion)[..., None] * straight + np.sin(flexion)[..., None] * [0.0, 0.0, 1.0]
        joints[:, 1 + 4 * i] = knuckle
        joints[:, 2 + 4 * i : 5 + 4 * i] = knuckle + np.cumsum(ways * np.array(bones)[:, None], axis=1)
    knuckle, bones = THUMB
    curl, opposed = shape[:, 4], shape[:, 5]
    aside = np.radians(58.0 - 40.0 * opposed)
    out = np.radians(12.0 + 38.0 * opposed)
    first = np.stack([np.cos(aside) * np.cos(out), np.sin(aside) * np.cos(out), np.sin(out)], axis=1)
    across = np.array([0.0, -0.9, 0.436]) + np.array([0.0, 0.5, 0.0]) * (1 - opposed)[:, None]
    across = across - first * np.sum(first * across, axis=1, keepdims=True)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    flexion = np.cumsum(curl[:, None] * np.radians([0.0, 50.0, 65.0]) + [0, 0.05, 0.1], axis=1)[..., None]
    ways = np.cos(flexion) * first[:, None] + np.sin(flexion) * across[:, None]
    joints[:, 17] = knuckle
    joints[:, 18:21] = knuckle + np.cumsum(ways * np.array(bones)[:, None], axis=1)
    return joints
