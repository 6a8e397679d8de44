"""SMPL-X parameters (AMASS, BEAT2, SHOW saved as arrays) to joints: forward kinematics on a rest skeleton."""

from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError, notice
from cospeech.files import read_yaml
from cospeech.skeleton import Skeleton
from cospeech.track import Points

# parameters in the order of the 55 joints, for files that keep them apart
PIECES = {"global_orient": 1, "body_pose": 21, "jaw_pose": 1, "leye_pose": 1, "reye_pose": 1, "left_hand_pose": 15,
          "right_hand_pose": 15}  # fmt: skip
RATES = ("mocap_frame_rate", "mocap_framerate", "fps")
RATE = 30.0  # Hz, where the file does not say
CAMERA = np.array([1.0, -1.0, -1.0])  # SMPL-X's x left, y up, z ahead -> a camera in front: x right, y down, z away
Y_UP = Rotation.from_euler("x", -90, degrees=True)  # z up (AMASS) -> y up
BODY = {"pelvis": "pelvis", "spine": "spine2", "neck": "neck", "head": "head", "head_top": "head_top"} | {
    f"{side}_{joint}": f"{side}_{joint}"
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "wrist", "hip")
}
FINGERS = {"index": "index", "middle": "middle", "ring": "ring", "little": "pinky", "thumb": "thumb"}


def is_smplx(arrays):
    """Whether these arrays are SMPL-X parameters: `poses` (T, 165), or `global_orient` and `body_pose`."""
    poses = arrays.get("poses")
    return {"global_orient", "body_pose"} <= arrays.keys() or (
        poses is not None and poses.ndim == 2 and poses.shape[1] == 165
    )


def smplx_parts(arrays, path, body_model=None):
    """({part: Points} in metres, frames per second) of SMPL-X parameters.

    Joints come from the user's body model (`body_model`, an .npz with J_regressor, v_template, shapedirs) and the
    file's betas, else from the default rest skeleton (`data/smplx_rest.yaml`), which a notice says.
    """
    rest = _model_joints(body_model, arrays) if body_model else _default_joints(path)
    turns = _poses(arrays, path).reshape(-1, 55, 3)
    joints = _forward(rest, turns)
    up = np.median(joints["head"] - joints["pelvis"], axis=0)
    if abs(up[2]) > abs(up[1]):
        joints = {name: Y_UP.apply(xyz) for name, xyz in joints.items()}
    body = np.stack([joints[BODY[name]] for name in Skeleton.load("upper13").names], axis=1)
    parts = {"body": _points("upper13", body - body[:, [10]], "root", "pelvis")}
    for side in ("left", "right"):
        hand = [joints[f"{side}_wrist"]] + [
            joints[f"{side}_{FINGERS[finger]}{int(number) + 1}"]
            for finger, number in (name.split("_") for name in Skeleton.load("hand21").names[1:])
        ]
        hand = np.stack(hand, axis=1)
        parts[f"{side}_hand"] = _points("hand21", hand - hand[:, :1], "wrist", "hand_root")
    rates = (float(np.ravel(arrays[key])[0]) for key in RATES if key in arrays)
    return parts, next(rates, RATE)


def _poses(arrays, path):
    """(T, 165) axis-angle vectors of the 55 joints."""
    if "poses" in arrays:
        return arrays["poses"].astype(float)
    frames = len(arrays["body_pose"])
    pieces = []
    for name, joints in PIECES.items():
        piece = arrays.get(name, np.zeros((frames, 3 * joints))).reshape(frames, -1)
        if piece.shape[1] != 3 * joints:
            raise CospeechError(
                f"{path}: {name} has {piece.shape[1]} numbers a frame, expected {3 * joints} (axis-angle; "
                "hands without their PCA)"
            )
        pieces.append(piece.astype(float))
    return np.concatenate(pieces, axis=1)


def _table():
    return read_yaml(files("cospeech.capture.trackers") / "data" / "smplx_rest.yaml")


def _default_joints(path):
    notice(f"{path}: no body model is given; joints are those of the default rest skeleton (an adult of 1.70 m)")
    return {name: np.array(xyz, float) for name, xyz in _table()["rest"].items()}


def _model_joints(body_model, arrays):
    """{joint: (3,) metres} of a SMPL-X model in its rest pose, with the file's shape."""
    from cospeech.capture.trackers.precomputed import load_arrays

    model = load_arrays(Path(body_model))
    if missing := [key for key in ("J_regressor", "v_template", "shapedirs") if key not in model]:
        raise CospeechError(f"{body_model}: no SMPL-X model as arrays, {missing[0]} is missing")
    betas = np.ravel(arrays.get("betas", np.zeros(10)))[: model["shapedirs"].shape[2]]
    vertices = model["v_template"] + model["shapedirs"][..., : len(betas)] @ betas
    known = (model["J_regressor"] @ vertices)[:55]
    default = {name: np.array(xyz, float) for name, xyz in _table()["rest"].items()}
    joints = dict(zip(list(_table()["parents"])[:55], known, strict=True))
    for name, parent in list(_table()["parents"].items())[55:]:  # tips and crown, which no joint marks
        joints[name] = joints[parent] + default[name] - default[parent]
    return joints


def _forward(rest, turns):
    """{joint: (T, 3)} by forward kinematics; turns (T, 55, 3) axis-angle, the pelvis at its place in the rest pose."""
    parents = _table()["parents"]
    rotations, places = {}, {}
    for number, (name, parent) in enumerate(parents.items()):
        own = Rotation.from_rotvec(turns[:, number]) if number < 55 else Rotation.identity(len(turns))
        if parent is None:
            rotations[name], places[name] = own, np.tile(rest[name], (len(turns), 1))
        else:
            places[name] = places[parent] + rotations[parent].apply(rest[name] - rest[parent])
            rotations[name] = rotations[parent] * own
    return places


def _points(skeleton, xyz, space, root):
    frames, count = xyz.shape[:2]
    return Points(
        skeleton, np.zeros((frames, count, 2), np.float32), np.ones((frames, count), np.float32), np.ones(frames, bool),
        (xyz * CAMERA).astype(np.float32), space, root, metric=True,
    )  # fmt: skip
