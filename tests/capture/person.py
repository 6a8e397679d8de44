"""A person who talks with their hands, by closed formulas: the truth behind made-up tracks."""

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.body.anatomy import rest_hand
from cospeech.face.model import embedded
from cospeech.skeleton import BODY, LEFT_HAND, RIGHT_HAND, UPPER55, Skeleton
from cospeech.track import Camera, Points, Track

J = UPPER55.index
TRUNK = {
    "pelvis": (0, 0, 0),
    "spine": (0, 0.25, 0),
    "neck": (0, 0.50, 0),
    "head": (0, 0.58, 0.02),
    "head_top": (0, 0.76, 0),
    "left_hip": (0.09, -0.05, 0),
    "right_hip": (-0.09, -0.05, 0),
    "left_shoulder": (0.18, 0.46, 0),
    "right_shoulder": (-0.18, 0.46, 0),
}
UPPER_ARM, FOREARM, HEAD = 0.28, 0.25, np.array([0.0, 0.66, 0.02])


def positions(seconds, fps, yaw=0.0):
    """(T, 55, 3) metres, pelvis at 0, x left, y up, z forward, turned by `yaw` radians; every bone keeps its length."""
    t = np.arange(round(seconds * fps)) / fps
    points = np.zeros((len(t), 55, 3))
    for name, place in TRUNK.items():
        points[:, J[name]] = place
    for side, sign, phase in (("left", 1, 0.0), ("right", -1, 1.0)):
        swing = Rotation.from_euler("Z", sign * (-1.2 + 0.3 * np.sin(2 * t[:, None] + phase)))
        bent = np.stack([-sign * (1.2 + 0.5 * np.sin(3 * t + phase)), 0.3 * np.cos(t)], axis=1)
        bend = swing * Rotation.from_euler("YX", bent)
        elbow = points[:, J[f"{side}_shoulder"]] + swing.apply([sign * UPPER_ARM, 0, 0])
        points[:, J[f"{side}_elbow"]] = elbow
        wrist = elbow + bend.apply([sign * FOREARM, 0, 0])
        points[:, J[f"{side}_wrist"]] = points[:, J[f"{side}_hand_root"]] = wrist
        for finger, offsets in rest_hand(1.0, sign).items():
            for i, offset in enumerate(np.cumsum(offsets, axis=0)):
                points[:, J[f"{side}_{finger}_{i}"]] = wrist + bend.apply(offset)
    return points @ Rotation.from_euler("Y", yaw).as_matrix().T


def head(seconds, fps):
    """Rotation (T, 3) and expression (T, 64) of the head over time; rotation 0 looks forward."""
    t = np.arange(round(seconds * fps)) / fps
    expression = np.zeros((len(t), 64))
    rates = {"jaw_open": 1.3, "mouth_smile_left": 0.4, "mouth_smile_right": 0.4, "brow_inner_up": 0.7}  # Hz
    for name, rate in rates.items():
        expression[:, embedded().expression_names.index(name)] = 0.35 + 0.35 * np.sin(2 * np.pi * rate * t)
    return np.stack([0.2 * np.sin(t), 0.3 * np.sin(0.7 * t), 0.1 * np.cos(t)], 1), expression


def seen_by_camera(points):
    """Points (..., 3) of the person -> camera axes (x right, y down, z away), 2 m in front of the camera."""
    return points * [1, -1, -1] + [0, 0.3, 2.0]


def make_track(seconds=4.0, fps=30.0, yaw=0.0, noise=0.0, seed=0, face=True):
    """A `Track` of the person: body as mpi_inf_3dhp21, both hands, and the 68 landmarks in metres, with noise (m)."""
    rng = np.random.default_rng(seed)
    truth = positions(seconds, fps, yaw)
    body = Skeleton.load("mpi_inf_3dhp21")
    shown = np.zeros((len(truth), len(body), 3))
    shared = [name for name in UPPER55.names[BODY] if name in body.index]
    shown[:, body.joints(*shared)] = truth[:, UPPER55.joints(*shared)]
    parts = {"body": _points("mpi_inf_3dhp21", shown, "pelvis", noise, rng)}
    for name, where in (("right_hand", RIGHT_HAND), ("left_hand", LEFT_HAND)):
        own = [n.split("_", 1)[1] for n in UPPER55.names[where]]
        order = [own.index(n) for n in Skeleton.load("hand21").names]
        parts[name] = _points("hand21", truth[:, where][:, order], "hand_root", noise, rng)
    if face:
        rotation, expression = head(seconds, fps)
        turn = Rotation.from_euler("Y", yaw) * Rotation.from_rotvec(rotation)
        marks = embedded().vertices(expression, chosen=embedded().landmarks)
        marks = np.einsum("fab,flb->fla", turn.as_matrix(), marks) + HEAD
        parts["face_landmarks"] = _points("face68", marks, "", noise / 4, rng, space="camera")
    return Track(
        fps,
        len(truth),
        1920,
        1080,
        **parts,
        source="made.mp4",
        backend="truth",
        licence_note="no terms",
        camera=Camera(1500.0, 1500.0, 960.0, 540.0, "given"),
    )


def _points(skeleton, points, root, noise, rng, space=None):
    camera = seen_by_camera(points + rng.normal(size=points.shape) * noise)
    xy = camera[..., :2] / camera[..., 2:] * 1500 + [960, 540]
    origin = 0 if space else Skeleton.load(skeleton).joints(root)
    xyz = camera if space else camera - camera[:, origin]
    frames, count = points.shape[:2]
    space = space or ("wrist" if root == "hand_root" else "root")
    return Points(
        skeleton,
        xy.astype(np.float32),
        np.ones((frames, count), np.float32),
        np.ones(frames, bool),
        xyz.astype(np.float32),
        space,
        root,
        True,
    )
