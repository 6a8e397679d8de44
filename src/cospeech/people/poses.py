"""How the synthetic people stand, sit and gesture: joint angles within their limits, and the 61 joints that follow.

Axes: x to the person's left, y up, z forward; metres, pelvis at the origin. `sign` is -1 right, +1 left.
"""

from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.people.anthropometry import INDEX, JOINTS61, LIMITS
from cospeech.people.hands import SHAPES, draw_shapes, hand_joints
from cospeech.people.pose_table import POSES
from cospeech.skeleton import LONG_FINGERS

ARMS, POSTURES = POSES["arms"], POSES["postures"]
HAND_JOINTS = [f"{finger}_{i}" for finger in (*LONG_FINGERS, "thumb") for i in range(4)]
TRUNK = np.array([0.098, 0.085])  # half width and depth that wrists stay out of, shares of stature
NEAREST, FARTHEST = 0.28, 0.985  # wrist from shoulder in arm lengths: elbows neither break nor lock


@dataclass
class Pose:
    """Angles of N people, degrees. arms {side: _Arm}; trunk, head (N, 3); legs {side: (N, 5)}: flexion, abduction and
    turn of the hip, knee, ankle. arm, posture (N,) indices into ARMS and POSTURES."""

    arms: dict
    trunk: np.ndarray
    head: np.ndarray
    legs: dict
    arm: np.ndarray
    posture: np.ndarray


@dataclass
class Arm:
    """wrist (N, 3) arm lengths from the shoulder: outwards, up, forward; turn (N, 4): pronation, wrist flexion and
    deviation, lift of the elbow; shape (N, 8) of the fingers."""

    wrist: np.ndarray
    turn: np.ndarray
    shape: np.ndarray

    def where(self, condition, other):
        """This arm where the condition (N,) holds, else the other."""
        choose = lambda a, b: np.where(condition[:, None], a, b)
        return Arm(*(choose(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)))


def draw_pose(dice, presenting=False, lively_hands=0.0):
    """Draw a `Pose`. presenting (N,) bool or bool: who stands, as those filmed to the waist do.

    lively_hands : share of hands with any shape at all.
    """
    weights = np.array([p["weight"] for p in POSTURES.values()])
    posture = dice.choice(weights)
    sit, stand = (list(POSTURES).index(name) for name in ("sit", "stand"))
    posture = np.where(presenting, stand, posture)
    seated = posture == sit
    first, kind = _draw_arm(dice, seated, lively_hands)
    second, _ = _draw_arm(dice, seated, lively_hands)
    both = dice.chance(_column(ARMS, "both")[kind])
    twin = Arm(
        dice.normal(first.wrist, 0.04, count=3),
        dice.normal(first.turn, 6, count=4),
        np.clip(dice.normal(first.shape, 0.06, count=8), -0.05, 1),
    )
    second = twin.where(both, second)
    swap = dice.chance(0.5)
    arms = {"right": first.where(swap, second), "left": second.where(swap, first)}
    trunk = _limited(dice.normal(*np.transpose(POSES["trunk"]), count=3), LIMITS["trunk"])
    head = _limited(dice.normal(*np.transpose(POSES["head"]), count=3), LIMITS["head"])
    return Pose(arms, trunk, head, _draw_legs(dice, posture), kind, posture)


def _column(table, name):
    return np.array([entry[name] for entry in table.values()], float)


def _limited(values, limits):
    return np.clip(values, *np.moveaxis(np.asarray(limits), -1, 0))


def _draw_arm(dice, seated, lively_hands):
    """An `Arm` and what it does (N,)."""
    weight = _column(ARMS, "weight")
    factor = np.array([POSES["seated_arms"].get(name, 1.0) for name in ARMS])
    kind = np.where(seated, dice.choice(weight * factor), dice.choice(weight))
    wrist = dice.normal(_column(ARMS, "wrist")[kind], _column(ARMS, "spread")[kind], count=3)
    turn = dice.normal(_column(ARMS, "turn")[kind], POSES["turn_deviation"], count=3)
    lift = dice.normal(*_column(ARMS, "lift")[kind].T)
    names = [[list(SHAPES).index(hand) for hand in entry["hands"]] for entry in ARMS.values()]
    table = np.array([np.resize(row, 12) for row in names])
    shape = table[kind, dice.choice(np.ones(12))]
    shape = np.where(dice.chance(lively_hands), dice.choice(np.ones(len(SHAPES))), shape)
    limits = np.stack([LIMITS["pronation"], LIMITS["wrist_flexion"], LIMITS["wrist_deviation"], [-5, 75]])
    return Arm(wrist, _limited(np.column_stack([turn, lift]), limits), draw_shapes(dice, shape)), kind


def _draw_legs(dice, posture):
    swing = _column(POSTURES, "swing")[posture] * np.sin(dice.uniform(0, 2 * np.pi))
    legs = {}
    for sign, side in ((-1, "right"), (1, "left")):
        flexion, aside, turn, knee = (
            dice.normal(*_column(POSTURES, name)[posture].T) for name in ("hip", "aside", "turn", "knee")
        )
        flexion, knee = flexion + sign * swing, knee + np.maximum(0, -sign * swing) * 0.9
        flexion, aside = _limited(flexion, LIMITS["hip_flexion"]), _limited(aside, LIMITS["hip_abduction"])
        knee = _limited(knee, LIMITS["knee"])
        ankle = _limited(flexion - knee + dice.normal(0, 4), LIMITS["ankle"])  # the foot stays about level
        legs[side] = np.stack([flexion, aside, turn, knee, ankle], axis=1)
    return legs


def pose_people(build, pose):
    """Joints (N, 61, 3) and the head's axes (N, 3, 3), columns left, up, forward, of people in a pose."""
    joints = np.zeros((len(build.stature), len(JOINTS61), 3))
    put = lambda name, value: joints.__setitem__((slice(None), INDEX[name]), value)
    lower, offset = _turn(0.5 * pose.trunk), build.offsets
    chest = lower * _turn(0.5 * pose.trunk)
    skull = chest * _turn(pose.head)
    spine = lower.apply(offset["spine"])
    neck = spine + chest.apply(offset["neck"])
    put("spine", spine)
    put("neck", neck)
    put("head", neck + skull.apply(offset["head"]))
    put("head_top", neck + skull.apply(offset["head_top"]))
    for sign, side in ((-1, "right"), (1, "left")):
        mirror = np.array([sign, 1, 1])
        hip = offset["hip"] * mirror
        put(f"{side}_hip", hip)
        knee, ankle, toe = _leg(pose.legs[side], sign, build.lengths)
        for name, value in (("knee", knee), ("ankle", ankle), ("toe", toe)):
            put(f"{side}_{name}", hip + value)
        names = [f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", "hand_root", *HAND_JOINTS)]
        arm = _arm(pose.arms[side], sign, build)
        joints[:, [INDEX[n] for n in names]] = neck[:, None] + arm @ chest.as_matrix().transpose(0, 2, 1)
    return joints, skull.as_matrix()


def _turn(angles):
    """Turn to the left, bend forward, bend to the right (N, 3) degrees -> Rotation."""
    return Rotation.from_euler("YXZ", angles, degrees=True)


def _leg(angles, sign, lengths):
    """Knee, ankle and toe joint (N, 3) from the hip."""
    flexion, aside, turn, knee, ankle = angles.T
    thigh = Rotation.from_euler("ZXY", np.stack([sign * aside, -flexion, sign * turn], axis=1), degrees=True)
    shank = thigh * Rotation.from_euler("X", knee[:, None], degrees=True)
    foot = shank * Rotation.from_euler("X", ankle[:, None], degrees=True)
    down = lambda name: lengths[name][:, None] * [0.0, -1.0, 0.0]
    at_knee = thigh.apply(down("thigh"))
    at_ankle = at_knee + shank.apply(down("shank"))
    toe = np.stack([0 * flexion, -lengths["foot_height"], lengths["foot"]], axis=1)
    return at_knee, at_ankle, at_ankle + foot.apply(toe)


def _arm(arm, sign, build):
    """Shoulder, elbow, wrist and the 21 hand joints (N, 24, 3) from the neck in the chest's axes."""
    upper, fore = build.lengths["upper_arm"][:, None], build.lengths["forearm"][:, None]
    mirror, whole = np.array([sign, 1.0, 1.0]), upper + fore
    rest = build.offsets["shoulder"] * mirror
    target = _outside_trunk(rest + arm.wrist * whole * mirror, sign, build.stature)
    raised = np.clip(10.0 * (arm.wrist[:, 1] + 0.35), -2.0, 18.0)  # the shoulder blade follows a raised arm
    forward = np.clip(12.0 * (arm.wrist[:, 2] - 0.6), -3.0, 8.0)
    girdle = Rotation.from_euler("ZY", np.stack([sign * raised, -sign * forward], axis=1), degrees=True)
    shoulder = girdle.apply(rest)
    way = target - shoulder
    distance = np.clip(np.linalg.norm(way, axis=1, keepdims=True), NEAREST * whole, FARTHEST * whole)
    along = _unit(way)
    shift = (upper**2 - fore**2 + distance**2) / (2 * distance)
    offset = np.sqrt(np.maximum(upper**2 - shift**2, 0))
    bulge = _elbow_side(along, sign, np.radians(arm.turn[:, 3]))
    elbow, wrist = shoulder + along * shift + bulge * offset, shoulder + along * distance
    axes = _hand_axes(_unit(wrist - elbow), -sign * np.cross(along, bulge), sign, np.radians(arm.turn[:, :3].T))
    hand = hand_joints(arm.shape, build.lengths["hand"]) @ axes + wrist[:, None]
    return np.concatenate([np.stack([shoulder, elbow, wrist], axis=1), hand], axis=1)


def _unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)


def _outside_trunk(wrist, sign, stature):
    """Wrists (N, 3) moved forward out of the trunk's ellipse where they are beside or in it, below the shoulders."""
    half = TRUNK * stature[:, None]
    flat = wrist[:, [0, 2]] / half
    inside = (np.linalg.norm(flat, axis=1) < 1) & (wrist[:, 1] < 0.02)
    front = np.sqrt(np.maximum(1 - np.minimum(np.abs(flat[:, 0]), 0.95) ** 2, 0)) * half[:, 1]
    out = wrist.copy()
    out[:, 2] = np.where(inside, np.maximum(front, wrist[:, 2]), wrist[:, 2])
    return out


def _elbow_side(along, sign, lift):
    """Unit direction (N, 3) in which the elbow leaves the line from shoulder to wrist.

    At lift 0 it hangs down and back, in the vertical plane of the arm; lift turns it outwards about that line.
    """
    hang = np.array([0.0, -0.8, -0.6])
    down = _unit(hang - along * (along @ hang)[:, None])
    return np.cos(lift)[:, None] * down + sign * np.sin(lift)[:, None] * np.cross(along, down)


def _hand_axes(forearm, medial, sign, turn):
    """(N, 3, 3) rows: along the fingers, towards the thumb, out of the palm. turn: pronation, flexion, deviation."""
    pronation, flexion, deviation = turn
    palm = _unit(medial - forearm * np.sum(medial * forearm, axis=1, keepdims=True))
    palm = Rotation.from_rotvec(forearm * (sign * pronation)[:, None]).apply(palm)
    thumb = -sign * np.cross(forearm, palm)
    cos, sin = np.cos(flexion)[:, None], np.sin(flexion)[:, None]
    fingers, palm = cos * forearm + sin * palm, cos * palm - sin * forearm
    cos, sin = np.cos(deviation)[:, None], np.sin(deviation)[:, None]
    fingers, thumb = cos * fingers + sin * thumb, cos * thumb - sin * fingers
    return np.stack([fingers, thumb, palm], axis=1)
