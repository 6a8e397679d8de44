"""SMPL-X and SMPL-H parameters (AMASS old and new, BEAT2, SHOW, TalkSHOW; saved as arrays) become an animation."""

from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError, notice
from cospeech.files import load_arrays, read_yaml
from cospeech.formats.animation import Animation
from cospeech.rotation import continuous

BODY, HEAD, HAND = (
    22,
    3,
    15,
)  # joints of the body with its root, of jaw and eyes, of one hand; SMPL-X's 55 in this order
JOINTS = BODY + HEAD + 2 * HAND
WHOLE = ("poses", "fullpose", "full_pose")  # all joints in one array: those of SMPL-X, SMPL-H, SMPL or its body alone
WHOLE_JOINTS = (JOINTS, BODY + 2 * HAND, 24, BODY)
# parameters in the order of the 55 joints, for files that keep them apart: joints, and what they are called
PIECES = (
    (1, ("global_orient", "root_orient", "global_orient_axis")),
    (21, ("body_pose", "pose_body", "body_pose_axis")),
    (1, ("jaw_pose", "pose_jaw")),
    (2, ("pose_eye",)),
    (1, ("leye_pose",)),
    (1, ("reye_pose",)),
    (30, ("pose_hand",)),
    (15, ("left_hand_pose",)),
    (15, ("right_hand_pose",)),
)
FIRST = (0, 1, 22, 23, 23, 24, 25, 25, 40)  # joint at which each piece begins
RATES = ("mocap_frame_rate", "mocap_framerate", "fps", "frame_rate", "framerate")
RATE = 30.0  # Hz, where the file does not say


def is_smplx(arrays):
    """Whether these arrays are SMPL-X parameters: `poses` of 55, 52, 24 or 22 joints, or root and body pose apart."""
    (_, roots), (_, bodies), *_ = PIECES
    return bool(_whole(arrays)) or (any(key in arrays for key in roots) and any(key in arrays for key in bodies))


def smplx_animation(arrays, path, body_model=None):
    """(`Animation` in metres, seen (T,) bool) of SMPL-X parameters, with finger tips and crown as joints of their own.

    Rotations are axis-angle, or matrices. Bones come from the user's body model (`body_model`, an .npz with
    J_regressor, v_template, shapedirs) and the file's betas, else from the default rest skeleton
    (`data/smplx_rest.yaml`), which a notice says; hands of a few PCA coefficients need the model's components. Axes are
    the file's (AMASS: z up). Frames with NaN are not `seen`; the motion runs through them. Raises CospeechError for
    shapes that do not fit and for files of which no frame is finite.
    """
    turns = _turns(arrays, path, load_arrays(Path(body_model)) if body_model else {})
    frames = len(turns)
    move = np.asarray(arrays.get("trans", arrays.get("transl", np.zeros((frames, 3)))), float)
    if move.shape != (frames, 3):
        raise CospeechError(
            f"{path}: trans has shape {move.shape}, expected ({frames}, 3), as poses have {frames} frames"
        )
    seen = np.isfinite(turns).all(axis=(1, 2)) & np.isfinite(move).all(axis=1)
    if not seen.any():
        raise CospeechError(f"{path}: no frame of its {frames} is free of NaN")
    if not seen.all():
        notice(
            f"{path}: {(~seen).sum()} of {frames} frames hold NaN, the first is {np.argmin(seen)}; they are not seen"
        )
    rest = _model_joints(body_model, arrays) if body_model else _default_joints(path)
    parents = smplx_table()["parents"]
    names = tuple(parents)
    above = np.array([names.index(parent) if parent else -1 for parent in parents.values()])
    places = np.array([rest[name] for name in names])
    rotations = np.zeros((frames, len(names), 4))
    rotations[..., 3] = 1.0
    rotations[seen, :JOINTS] = Rotation.from_rotvec(turns[seen].reshape(-1, 3)).as_quat().reshape(-1, JOINTS, 4)
    offsets = places - np.where(above[:, None] < 0, 0.0, places[above])
    rate = _rate(arrays, path, frames)
    rotations, move = _bridged(rotations, seen), _bridged(move + places[0], seen)
    return Animation(names, above, offsets, rotations, move, rate), seen


def _whole(arrays):
    """The key of the array that has all joints, or None."""
    sizes = {width * joints for joints in WHOLE_JOINTS for width in (3, 9)}
    for key in WHOLE:
        array = arrays.get(key)
        if array is not None and array.ndim >= 2 and len(array) and array[0].size in sizes:
            return key
    return None


def _turns(arrays, path, model):
    """(T, 55, 3) axis-angle vectors; NaN where the file has them."""
    if key := _whole(arrays):
        numbers = arrays[key].reshape(len(arrays[key]), -1)
        joints = next(n for n in WHOLE_JOINTS if numbers.shape[1] in (3 * n, 9 * n))
        given = _axis_angle(numbers, joints)
        turns = np.zeros((len(given), JOINTS, 3))
        turns[:, :BODY] = given[:, :BODY]
        if joints > 24:  # SMPL's two last joints are no fingers
            turns[:, -2 * HAND :] = given[:, -2 * HAND :]
        if joints == JOINTS:
            turns[:, BODY : BODY + HEAD] = given[:, BODY : BODY + HEAD]
        return turns
    found = {key: arrays[key] for _, keys in PIECES for key in keys if key in arrays}
    frames = max(len(array) if array.ndim else 1 for array in found.values())
    turns = np.zeros((frames, JOINTS, 3))
    for (joints, keys), first in zip(PIECES, FIRST, strict=True):
        for key in keys:
            if key in found:
                turns[:, first : first + joints] = _piece(found[key], key, joints, frames, path, model)
    return turns


def _piece(array, key, joints, frames, path, model):
    """(T, joints, 3) axis-angle of one parameter."""
    if array.size % frames or not array.size:
        raise CospeechError(f"{path}: {key} has shape {array.shape}, other parameters have {frames} frames")
    numbers = array.reshape(frames, -1).astype(float)
    side, width = key.split("_")[0], numbers.shape[1]
    if joints == HAND and width < 3 * HAND and f"hands_components{side[0]}" in model:
        components, mean = (model[f"hands_{name}{side[0]}"] for name in ("components", "mean"))
        numbers = mean + numbers @ components[:width]
    elif joints == BODY - 1 and width == 3 * 23:  # SMPL's body goes on with two joints for the hands
        numbers = numbers[:, : 3 * joints]
    if numbers.shape[1] not in (3 * joints, 9 * joints):
        raise CospeechError(
            f"{path}: {key} has {width} numbers a frame, expected {3 * joints} (axis-angle; hands without their PCA, "
            f"or with body_model, whose hands_components they are of) or {9 * joints} (matrices)"
        )
    return _axis_angle(numbers, joints)


def _axis_angle(numbers, joints):
    """(T, joints, 3) of axis-angle vectors or rotation matrices; what is no rotation becomes NaN."""
    if numbers.shape[1] == 3 * joints:
        return numbers.reshape(-1, joints, 3).astype(float)
    matrices = numbers.reshape(-1, 3, 3).astype(float)
    turns = np.full((len(matrices), 3), np.nan)
    fine = np.isfinite(matrices).all(axis=(1, 2))
    fine[fine] = np.linalg.det(matrices[fine]) > 0.5
    turns[fine] = Rotation.from_matrix(matrices[fine]).as_rotvec()
    return turns.reshape(-1, joints, 3)


def _rate(arrays, path, frames):
    """Frames per second: told, or of the length in seconds that is told, or assumed with a notice."""
    told = {key: np.ravel(arrays[key])[0] for key in RATES if key in arrays and arrays[key].size}
    seconds = np.ravel(arrays.get("mocap_time_length", 0.0))[:1]
    for key, value in told.items():
        if value.dtype.kind not in "iuf" or not 0 < value < np.inf:
            raise CospeechError(f"{path}: {key} is {value}, expected frames per second above 0")
        return float(value)
    if seconds.dtype.kind in "iuf" and 0 < seconds.sum() < np.inf:
        return frames / float(seconds[0])
    notice(f"{path}: no frame rate in it ({', '.join(RATES[:3])}); {RATE:g} frames per second are assumed")
    return RATE


def _bridged(values, seen):
    """Values (T, ..., C) with unseen frames filled in on the straight line between their neighbours; quaternions are
    brought to one sign and to unit length."""
    if seen.all():
        return values
    times, known = np.arange(len(seen)), np.flatnonzero(seen)
    kept = values[known] if values.ndim == 2 else continuous(values[known])
    after = np.clip(np.searchsorted(known, times), 1, max(len(known) - 1, 1)).clip(max=len(known) - 1)
    before = np.maximum(after - 1, 0)
    share = np.clip((times - known[before]) / np.maximum(known[after] - known[before], 1), 0, 1)
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    filled = (1 - share) * kept[before] + share * kept[after]
    return filled if values.ndim == 2 else filled / np.linalg.norm(filled, axis=-1, keepdims=True)


@cache
def smplx_table():
    """{"parents": {joint: its parent or None}, "rest": {joint: [x, y, z] metres}}: 55 joints, then tips and crown."""
    return read_yaml(files("cospeech.formats") / "data" / "smplx_rest.yaml")


def _default_joints(path):
    notice(f"{path}: no body model is given; joints are those of the default rest skeleton (an adult of 1.70 m)")
    return {name: np.array(xyz, float) for name, xyz in smplx_table()["rest"].items()}


def _model_joints(body_model, arrays):
    """{joint: (3,) metres} of a SMPL-X model in its rest pose, with the file's shape."""
    model, table = load_arrays(Path(body_model)), smplx_table()
    if missing := [key for key in ("J_regressor", "v_template", "shapedirs") if key not in model]:
        raise CospeechError(f"{body_model}: no SMPL-X model as arrays, {missing[0]} is missing")
    betas = np.ravel(arrays.get("betas", np.zeros(10)))[: model["shapedirs"].shape[2]]
    vertices = model["v_template"] + model["shapedirs"][..., : len(betas)] @ betas
    known = (model["J_regressor"] @ vertices)[:JOINTS]
    default = {name: np.array(xyz, float) for name, xyz in table["rest"].items()}
    joints = dict(zip(list(table["parents"])[:JOINTS], known, strict=True))
    for name, parent in list(table["parents"].items())[JOINTS:]:  # tips and crown, which no joint marks
        joints[name] = joints[parent] + default[name] - default[parent]
    return joints
