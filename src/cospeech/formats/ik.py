"""Positions to rotations: a clip's 55 points become an animation whose bones keep their length.

The skeleton is `skeletons/mixamo55.yaml`. The solver walks from the hips outwards and batches over frames. Rigid parts
(pelvis, palms) are fitted as wholes, every other bone is aimed by the shortest arc from its parent, and what points on
a bone cannot tell, its twist, comes from what hangs on it: shoulder line, elbow plane, palm, head rotation.
"""

from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from cospeech.files import read_yaml
from cospeech.formats.animation import Animation
from cospeech.rotation import continuous, swing_twist
from cospeech.skeleton import ACROSS, UPPER55

STRAIGHT = np.sin(np.radians(15.0))  # below this bend the plane of an elbow is mostly taken from the frames around
DAMPING = 0.1  # sine of the bend below which an elbow hardly moves to reach the wrist (damped least squares)
HIPS_TO_TORSO = 1.1  # hip height over pelvis-to-crown length of a standing adult, for clips without a root path
PALM_PRIOR = 1e-9  # weight in m^2 of "the hand continues the forearm": decides only where a hand has no extent
LEFT, UP, FORWARD = np.eye(3)


def _table():
    rows = read_yaml(files("cospeech") / "skeletons" / "mixamo55.yaml")["joints"]
    names = tuple(row[0] for row in rows)
    parents = np.array([-1 if row[1] is None else names.index(row[1]) for row in rows])
    sources = UPPER55.joints(*(row[2] for row in rows))
    directions = np.array([[np.nan] * 3 if row[3] == "measured" else row[3] for row in rows], float)
    return names, parents, sources, _unit(directions)


def _unit(vectors):
    """Vectors (..., 3) divided by their length; a zero vector stays zero."""
    norms = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(norms > 1e-12, norms, 1.0)


NAMES, PARENTS, SOURCES, REST_DIRECTIONS = _table()
INDEX = {name: joint for joint, name in enumerate(NAMES)}
FINGERS = tuple({"little": "Pinky"}.get(finger, finger.title()) for finger in ACROSS)  # Mixamo's names


def animation_from_clip(clip):
    """The clip's motion as rotations of a 55-joint skeleton with Mixamo's names and constant bones.

    Bone lengths are the clip's medians; the rest pose is a T-pose (x left, y up, z forward, metres), so that zero
    rotations mean a T-pose. Positions come back exactly where the clip's own bones are constant; elsewhere each bone
    is aimed at its recorded end, and the elbow moves in its plane so that the wrist is where it was recorded, if the
    arm is long enough. The root follows `clip.root`; without one the hips stand still at a height that fits the torso.
    Finger motion is smoothed only as far as its noise (seen in changing bone lengths) asks for.

    Returns `Animation`: rotations (T, 55, 4) x y z w without sign jumps, translation (T, 3).
    """
    targets = np.asarray(clip.positions, float)[:, SOURCES]
    targets = np.moveaxis(targets - targets[:, :1], 1, 0)
    solver = _Solver(targets, rest_offsets(targets), clip.fps)
    solver.solve_trunk()
    solver.solve_head(clip.rotation)
    for side in ("Left", "Right"):
        solver.solve_arm(side)
        solver.solve_fingers(side)
    rotations = continuous(solver.local_quaternions())
    return Animation(NAMES, PARENTS.copy(), solver.offsets, rotations, _translation(clip, solver.offsets), clip.fps)


def rest_offsets(targets):
    """Offsets (55, 3) of the T-pose: the table's directions, the clip's median lengths, measured pelvis and palms.

    targets (55, T, 3) metres in the order of `NAMES`.
    """
    bones = targets - targets[PARENTS]
    bones[0] = 0.0
    lengths = np.median(np.linalg.norm(bones, axis=-1), axis=1)
    directions = REST_DIRECTIONS.copy()
    pelvis = [INDEX["LeftUpLeg"], INDEX["RightUpLeg"]]
    frame = _frame(bones[INDEX["Spine"]], bones[pelvis[0]] - bones[pelvis[1]], UP, LEFT)
    directions[pelvis] = _shape(bones[pelvis], frame)
    for side, along in (("Left", LEFT), ("Right", -LEFT)):
        palm = [INDEX[f"{side}Hand{finger}1"] for finger in FINGERS]
        across = bones[palm[FINGERS.index("Index")]] - bones[palm[FINGERS.index("Pinky")]]
        frame = _frame(bones[palm[FINGERS.index("Middle")]], across, along, FORWARD)
        directions[palm] = _shape(bones[palm], frame)
    return directions * lengths[:, None]


def _shape(bones, frames):
    """Mean directions (K, 3), in the part's own frames (T, 3, 3), of the bones (K, T, 3) of a rigid part."""
    return _unit(np.median(np.einsum("tji,ktj->kti", frames, bones), axis=1))


def _arc(rest, directions):
    """Shortest rotations (T, 3, 3) of the unit vector rest (3,) onto unit directions (T, 3); identity for zero ones.

    A product of two reflections, which unlike the textbook formula stays exact up to and at 180 degrees.
    """
    half = rest + directions
    opposite = np.linalg.norm(half, axis=-1, keepdims=True) < 1e-9
    half = _unit(np.where(opposite, np.cross(rest, np.eye(3)[np.argmin(np.abs(rest))]), half))
    mirror = np.eye(3) - 2.0 * np.outer(rest, rest)
    return mirror - 2.0 * half[:, :, None] * (half @ mirror)[:, None, :]


def _twist_about(rest, angles):
    """Rotations (T, 3, 3) by angles (T,) about one unit axis (3,)."""
    return Rotation.from_rotvec(np.asarray(angles)[:, None] * rest).as_matrix()


def _side_plane(frames, rest, reference, sides):
    """Where sides (T, 3) point around the axis `rest` of frames (T, 3, 3): complex (T,), 1 is along `reference`."""
    local = np.einsum("tji,tj->ti", frames, sides)
    return local @ reference + 1j * (local @ np.cross(rest, reference))


def _frame(directions, sides, rest, reference):
    """Rotations (T, 3, 3) that take `rest` exactly onto directions (T, 3) and `reference` towards sides (T, 3)."""
    frames = _arc(rest, _unit(directions))
    return frames @ _twist_about(rest, np.angle(_side_plane(frames, rest, reference, sides)))


def _translation(clip, offsets):
    """Root path (T, 3) metres: the clip's own, else a fixed hip height (pelvis to crown times HIPS_TO_TORSO)."""
    if clip.root is not None:
        return np.asarray(clip.root, float)
    torso = sum(offsets[INDEX[name], 1] for name in ("Spine", "Neck", "Head", "HeadTop_End"))
    return np.tile([0.0, HIPS_TO_TORSO * torso, 0.0], (len(clip), 1))


@dataclass
class _Solver:
    """World rotations (55, T, 3, 3) and positions (55, T, 3), filled in from the hips outwards."""

    targets: np.ndarray
    offsets: np.ndarray
    fps: float

    def __post_init__(self):
        joints, frames = self.targets.shape[:2]
        self.rotations = np.tile(np.eye(3), (joints, frames, 1, 1))
        self.positions = np.zeros((joints, frames, 3))

    def turn(self, name, rotations):
        """Set a joint's world rotations, which places its children (leaves inherit the rotation)."""
        joint = INDEX[name]
        self.rotations[joint] = rotations
        for child in np.flatnonzero(joint == PARENTS):
            self.positions[child] = self.positions[joint] + rotations @ self.offsets[child]
            self.rotations[child] = rotations

    def aimed(self, name, child, goal=None):
        """Shortest arc from the parent's rotation that points a bone at `goal` (T, 3), else at the child's target."""
        joint, child = INDEX[name], INDEX[child]
        base, goal = self.rotations[PARENTS[joint]], self.targets[child] if goal is None else goal
        local = np.einsum("tji,tj->ti", base, _unit(goal - self.positions[joint]))
        return base @ _arc(REST_DIRECTIONS[child], local)

    def solve_trunk(self):
        """Hips: spine direction exact, twist from the hip line. Spine: neck direction, twist from the shoulder line."""
        for name, child, pair in (("Hips", "Spine", "UpLeg"), ("Spine", "Neck", "Arm")):
            left, right = (self.targets[INDEX[side + pair]] for side in ("Left", "Right"))
            up = self.targets[INDEX[child]] - self.positions[INDEX[name]]
            self.turn(name, _frame(up, left - right, UP, LEFT))

    def solve_head(self, rotation):
        """Neck and head aim at the recorded points and share the turn of the head rotation (T, 3), if there is one."""
        faces = None if rotation is None else Rotation.from_rotvec(rotation).as_matrix()[:, :, 2]
        for name, child, share in (("Neck", "Head", 0.5), ("Head", "HeadTop_End", 1.0)):
            frames = self.aimed(name, child)
            if faces is not None:
                frames = frames @ _twist_about(UP, share * np.angle(_side_plane(frames, UP, FORWARD, faces)))
            self.turn(name, frames)

    def solve_arm(self, side):
        """Clavicle, upper arm, forearm and hand of one side."""
        shoulder, arm, forearm, hand = (side + part for part in ("Shoulder", "Arm", "ForeArm", "Hand"))
        self.turn(shoulder, self.aimed(shoulder, arm))
        elbow, wrist, hinge = self.reach(arm, forearm, hand)
        axis = REST_DIRECTIONS[INDEX[forearm]]
        upper = self.aimed(arm, forearm, elbow)
        bend_plane = _side_plane(upper, axis, np.cross(axis, FORWARD), hinge)
        self.turn(arm, upper @ _twist_about(axis, self.steady_angle(bend_plane)))
        lower = self.aimed(forearm, hand, wrist)
        palm = self.palm(side, lower)
        relative = Rotation.from_matrix(np.swapaxes(lower, 1, 2) @ palm).as_quat()
        twist = Rotation.from_quat(swing_twist(relative, REST_DIRECTIONS[INDEX[hand]])[1]).as_matrix()
        self.turn(forearm, lower @ twist)
        self.turn(hand, palm)

    def reach(self, arm, forearm, hand):
        """Elbow and wrist positions (T, 3), and the recorded hinge (T, 3): elbow axis times sine of the bend.

        The arm stays in its recorded plane and bends to span the distance to the recorded wrist, except when nearly
        straight: a hair's breadth of length would then throw the elbow about, and the recorded bend is kept.
        """
        start, lengths = self.positions[INDEX[arm]], np.linalg.norm(self.offsets[[INDEX[forearm], INDEX[hand]]], axis=1)
        shoulder, elbow, wrist = (self.targets[INDEX[name]] for name in (arm, forearm, hand))
        upper, lower = _unit(elbow - shoulder), _unit(wrist - elbow)
        hinge = np.cross(upper, lower)
        sine = np.linalg.norm(hinge, axis=-1)
        seen = np.arctan2(sine, np.sum(upper * lower, axis=-1))
        line, product = wrist - start, max(lengths[0] * lengths[1], 1e-12)
        cosine = (np.sum(line**2, axis=-1) - np.sum(lengths**2)) / (2.0 * product)
        spanning = np.arccos(np.clip(cosine, -1.0, 1.0))
        bend = seen + (spanning - seen) * sine**2 / (sine**2 + DAMPING**2)
        span = np.sqrt(np.maximum(np.sum(lengths**2) + 2.0 * product * np.cos(bend), 1e-12))[:, None]
        line, along = _unit(line), (lengths[0] ** 2 + product * np.cos(bend))[:, None] / span
        away = product * np.sin(bend)[:, None] / span * _unit(np.cross(line, hinge))
        return start + along * line + away, start + span * line, hinge

    def steady_angle(self, plane):
        """Angles (T,) of complex (T,) whose size says how far to trust each; weak ones follow their neighbours."""
        around = gaussian_filter1d(plane, 0.25 * self.fps, mode="nearest") + 0.05
        return np.angle(np.abs(plane) * plane + STRAIGHT**2 * around / np.maximum(np.abs(around), 1e-12))

    def palm(self, side, forearm):
        """Hand rotations (T, 3, 3) that lay the rest palm on the recorded one (least squares, Kabsch 1976)."""
        wrist, bases = INDEX[f"{side}Hand"], [INDEX[f"{side}Hand{finger}1"] for finger in FINGERS]
        seen = self.targets[bases] - self.targets[wrist]
        u, _, vt = np.linalg.svd(np.einsum("kti,kj->tij", seen, self.offsets[bases]) + PALM_PRIOR * forearm)
        u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
        return u @ vt

    def solve_fingers(self, side):
        """Phalanges copy their recorded directions, seen from the palm and smoothed against tracker noise."""
        wrist = INDEX[f"{side}Hand"]
        chain = np.array([[INDEX[f"{side}Hand{finger}{k}"] for k in (1, 2, 3, 4)] for finger in FINGERS])
        palm = self.rotations[wrist].copy()
        local = np.einsum("tji,fktj->fkti", palm, self.targets[chain] - self.targets[wrist])
        bones = np.diff(self.steady_fingers(local), axis=1)
        for finger, phalanges in zip(chain, bones, strict=True):
            turned = np.tile(np.eye(3), (len(palm), 1, 1))
            for k in range(3):
                direction = np.einsum("tji,tj->ti", turned, _unit(phalanges[k]))
                turned = turned @ _arc(REST_DIRECTIONS[finger[k + 1]], direction)
                self.turn(NAMES[finger[k]], palm @ turned)

    def steady_fingers(self, local):
        """Finger points (5, 4, T, 3) after a Gaussian over time, just wide enough for their noise; none, no smoothing.

        The noise of points shows in the second differences of lengths that should be constant. What it adds to the
        turning from frame to frame falls with the width to the power of 3/2, whose inverse keeps that turning small.
        """
        lengths = np.linalg.norm(np.diff(local, axis=1), axis=-1)
        if lengths.shape[-1] < 3:
            return local
        noise = 1.4826 * np.median(np.abs(np.diff(lengths, 2, axis=-1))) / np.sqrt(12.0)
        width = min((20.0 * noise / max(np.median(lengths), 1e-6)) ** (2 / 3), 0.2 * self.fps)
        return gaussian_filter1d(local, width, axis=2, mode="nearest") if width > 0.1 else local

    def local_quaternions(self):
        """(T, 55, 4) rotations relative to the parent, x y z w."""
        local = np.swapaxes(self.rotations[PARENTS], 2, 3) @ self.rotations
        local[0] = self.rotations[0]
        quaternions = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_quat()
        return np.moveaxis(quaternions.reshape(*local.shape[:2], 4), 0, 1)
