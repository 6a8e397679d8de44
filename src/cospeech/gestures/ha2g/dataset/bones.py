"""From the 55 joints of clips to the unit bone vectors of a level table, and back to a motion like any other.

Which joint stands for which is in the level table's file. Its face points (nose, eyes, ears) are no joints of upper55:
they sit at `POINTS` in the head's own axes, which the clip's head rotation gives. Back again, the head is turned so
that its points fit best, finger tips, which the tables lack, bend on from the bone before, and without hands in the
table the speaker's mean hands follow the forearms.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.body.physique import Build
from cospeech.clip import Motion
from cospeech.rotation import rotations_between
from cospeech.skeleton import (
    CHAINS,
    FINGER_JOINTS,
    HAND_ROOTS,
    LEFT_HAND,
    RIGHT_HAND,
    UPPER55,
    WRISTS,
    with_bone_lengths,
)

# Metres from the joint `head`, x left, y up, z forward: an average adult's face, our own choice.
POINTS = {
    "nose": (0.0, 0.0, 0.11),
    "right_eye": (-0.032, 0.035, 0.085),
    "left_eye": (0.032, 0.035, 0.085),
    "right_ear": (-0.075, 0.015, -0.005),
    "left_ear": (0.075, 0.015, -0.005),
}
PLACES = {**UPPER55.index, **{name: len(UPPER55) + i for i, name in enumerate(POINTS)}}
OFFSETS = np.array(list(POINTS.values()))
TIP_BEND = 2 / 3  # of the joint before: the last two joints of a finger share tendons
NECK, HEAD, HEAD_TOP, SPINE = UPPER55.joints("neck", "head", "head_top", "spine")


@dataclass(frozen=True)
class Proportions:
    """A speaker's build, which unit vectors lack.

    lengths : (V,) mean lengths of the level table's bones, metres. rest : (55, 3) a pose with the speaker's bone
    lengths, pelvis at the origin. skull : (2, 3) neck and head_top from the head joint, in the head's axes.
    """

    lengths: np.ndarray
    rest: np.ndarray
    skull: np.ndarray

    def lists(self):
        """As JSON-able lists."""
        return {name: np.round(np.asarray(value, float), 6).tolist() for name, value in vars(self).items()}

    @classmethod
    def of(cls, lists):
        """From what `lists` made."""
        return cls(**{name: np.array(value) for name, value in lists.items()})

    @classmethod
    def mixed(cls, figures, weights):
        """The weighted mean of some figures; weights sum to one."""
        blend = lambda name: sum(w * getattr(f, name) for f, w in zip(figures, weights, strict=True))
        return cls(blend("lengths"), blend("rest"), blend("skull"))


def head_axes(positions, rotation=None):
    """(T, 3, 3) matrices whose columns are the head's left, up and forward.

    rotation (T, 3) : head rotation as axis-angle; without it the head's up comes from neck and head_top and its left
    from the shoulders, so that it never turns against the chest.
    """
    if rotation is not None:
        return Rotation.from_rotvec(rotation).as_matrix()
    up = _unit(positions[:, HEAD_TOP] - positions[:, NECK])
    right, left = UPPER55.joints("right_shoulder", "left_shoulder")
    across = positions[:, left] - positions[:, right]
    across = _unit(across - up * np.sum(across * up, axis=1, keepdims=True))
    return np.stack([across, up, np.cross(across, up)], axis=2)


def table_joints(positions, rotation, table):
    """positions (T, 55, 3), rotation (T, 3) or None -> (T, J, 3), the level table's joints."""
    face = positions[:, HEAD, None] + np.einsum("tij,pj->tpi", head_axes(positions, rotation), OFFSETS)
    return np.concatenate([positions, face], axis=1)[:, [PLACES[place] for place in table.places]]


def bone_vectors(positions, rotation, table):
    """Unit vectors from parent to child: (T, 55, 3), (T, 3) or None -> (T, V, 3) float32. A bone of no length is 0."""
    return _unit(_bones(positions, rotation, table)).astype(np.float32)


def mean_lengths(clips, table):
    """(V,) mean lengths of the table's bones over all valid frames of the clips, metres (HA2G section 4.1)."""
    lengths = [np.linalg.norm(_bones(c.positions, c.rotation, table), axis=-1)[c.valid] for c in clips]
    return np.concatenate(lengths).mean(axis=0)


def measure_proportions(clips, table):
    """The `Proportions` of one speaker's clips, over all valid frames."""
    positions = np.concatenate([clip.positions[clip.valid] for clip in clips]).astype(np.float64)
    axes = np.concatenate([head_axes(clip.positions, clip.rotation)[clip.valid] for clip in clips])
    rest = positions.mean(axis=0, keepdims=True)
    rest = Build.measure(positions).restored(rest - rest[:, [UPPER55.root]])[0]
    skull = positions[:, [NECK, HEAD_TOP]] - positions[:, [HEAD]]
    return Proportions(mean_lengths(clips, table), rest, np.einsum("tji,tpj->pi", axes, skull) / len(axes))


def positions_from_vectors(vectors, lengths, table):
    """Joints from bone vectors of any length: (T, V, 3), (V,) metres -> (T, J, 3), joint 0 at the origin."""
    steps = _unit(vectors) * lengths[:, None]
    joints = np.zeros((len(vectors), len(table.joints), 3))
    for bone, (parent, child) in enumerate(table.bones):
        joints[:, child] = joints[:, parent] + steps[:, bone]
    return joints


def motion_from_vectors(vectors, table, figure):
    """The motion of a figure whose bones point this way: (T, V, 3) -> `Motion`, pelvis at the origin, bones constant.

    Hips and lower spine, which the tables lack, stay as in the figure's rest pose.
    """
    joints = positions_from_vectors(vectors, figure.lengths, table) + figure.rest[SPINE]
    positions = np.repeat(figure.rest[None], len(joints), axis=0)
    known = [i for i, place in enumerate(table.places) if place in UPPER55.index]
    positions[:, [PLACES[table.places[i]] for i in known]] = joints[:, known]
    positions[:, HAND_ROOTS] = positions[:, WRISTS]
    axes = _fitted_head(joints, table, figure)
    positions[:, HEAD] = positions[:, NECK] - axes @ figure.skull[0]
    positions[:, HEAD_TOP] = positions[:, HEAD] + axes @ figure.skull[1]
    if "left_index_0" in table.places:
        _bend_tips(positions)
    else:
        _mean_hands(positions, figure)
    build = Build.measure(figure.rest[None])
    positions = with_bone_lengths(positions, build.bone_lengths).astype(np.float32)
    return Motion(positions, Rotation.from_matrix(axes).as_rotvec().astype(np.float32), build=build)


def _bones(positions, rotation, table):
    joints = table_joints(positions, rotation, table)
    return joints[:, table.bones[:, 1]] - joints[:, table.bones[:, 0]]


def _unit(vectors):
    norms = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, norms, out=np.zeros_like(vectors), where=norms > 1e-9)


def _fitted_head(joints, table, figure):
    """(T, 3, 3) head axes that bring the table's points of the head nearest (Kabsch), without the neck if it may be."""
    templates = {**POINTS, "head_top": figure.skull[1]}
    names = [name for name in table.places if name in templates]
    if len(names) < 3:  # two points and a rigid neck are as good as three points
        names, templates["neck"] = ["neck", *names], figure.skull[0]
    template = np.array([templates[name] for name in names])
    seen = joints[:, [table.places.index(name) for name in names]]
    return rotations_between(template - template.mean(axis=0), seen - seen.mean(axis=1, keepdims=True))


def _bend_tips(positions):
    """Put the ten finger tips, in place: each last bone turns on by `TIP_BEND` of the joint before."""
    a, b, c, tips = CHAINS.reshape(-1, FINGER_JOINTS).T
    before, last = positions[:, b] - positions[:, a], positions[:, c] - positions[:, b]
    axis = np.cross(before, last)
    angle = np.arctan2(np.linalg.norm(axis, axis=-1), np.sum(before * last, axis=-1))
    turn = Rotation.from_rotvec((_unit(axis) * TIP_BEND * angle[..., None]).reshape(-1, 3))
    positions[:, tips] = positions[:, c] + turn.apply(last.reshape(-1, 3)).reshape(last.shape)


def _mean_hands(positions, figure):
    """Put both hands, in place: the rest pose's, carried along by the least turn of the forearm."""
    for side, hand in (("right", RIGHT_HAND), ("left", LEFT_HAND)):
        elbow, wrist = UPPER55.joints(f"{side}_elbow", f"{side}_wrist")
        rest, forearm = _unit(figure.rest[wrist] - figure.rest[elbow]), _unit(positions[:, wrist] - positions[:, elbow])
        axis = np.cross(rest, forearm)
        angle = np.arctan2(np.linalg.norm(axis, axis=1), forearm @ rest)
        turn = Rotation.from_rotvec(_unit(axis) * angle[:, None]).as_matrix()
        offsets = figure.rest[hand] - figure.rest[wrist]
        positions[:, hand] = positions[:, [wrist]] + np.einsum("tij,pj->tpi", turn, offsets)
