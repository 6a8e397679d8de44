"""The character of the films made small enough for a web page: a mesh once, and few numbers a frame that move it.

Capsules follow joints. Trunk and head bend, so their vertices are written as a mean shape and a few directions
(principal components of what they do in these clips), moved by weights per frame. `player.js` puts them together
again; `rebuild` does the same here, for the tests.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.render.figure import SHIRT_RINGS, SIDES, TROUSER_RINGS, TROUSERS, Figure, Limb, _joints
from cospeech.render.head import HEIGHT
from cospeech.render.mesh import grid_triangles, rings, unit
from cospeech.skeleton import UPPER55

SHOE, STOOL, FLOOR = (70, 66, 64), (170, 190, 206), (255, 252, 250)
THIGH, SHIN = 0.42, 0.42  # metres, of a character whose trunk is 0.5 m
# Where the ankle stands, seen from the usual place of its hip (x outwards), and where the knee points.
STANCES = {
    "standing": (np.array([0.035, -0.82, -0.01]), np.array([0.10, 0.0, 1.0])),
    "sitting": (np.array([0.060, -0.42, 0.34]), np.array([0.12, 0.8, 1.0])),
}
STEP = 2e-4  # metres: positions are rounded to it
TOLERANCE = 2e-4  # metres: how far principal components may miss a vertex of trunk or head, root mean square in time
FITTED = 300  # frames, evenly taken from all clips, that the components are found from
EXTRA = ("collar", "nape", "head_base", "head_center", "left_knee", "left_ankle", "left_toe", "right_knee",
         "right_ankle", "right_toe")  # fmt: skip
JOINTS = (*UPPER55.names, *EXTRA)


@dataclass
class Shape:
    """A part that bends, in units of the character: points are mean (V, 3), and to those of the vertices `moving` (M,)
    weights (T, K) @ basis (K, M, 3) is added."""

    mean: np.ndarray
    moving: np.ndarray
    basis: np.ndarray


@dataclass
class Puppet:
    """One panel's motion: joints (T, J, 3) metres in the order of JOINTS, head (T, 4) quaternion x y z w, weights
    {"trunk", "head": (T, K)}, scale as `Figure.scale`, fps."""

    joints: np.ndarray
    head: np.ndarray
    weights: dict
    scale: float
    fps: float


def limbs_of(figure, legs):
    """{sides: [Limb]} of a figure, in which the stumps of its films are replaced by whole legs, or left out."""
    limbs = {n: [limb for limb in group if not limb.start.endswith("_leg")] for n, group in figure.limbs.items()}
    for side in ("left", "right") if legs else ():
        limbs[12] += [
            Limb(f"{side}_hip", f"{side}_knee", (0.077, 0.060), TROUSERS),
            Limb(f"{side}_knee", f"{side}_ankle", (0.058, 0.042), TROUSERS),
            Limb(f"{side}_ankle", f"{side}_toe", (0.044, 0.034), SHOE),
        ]
    return limbs


def legs(joints, scale, stance):
    """{left_knee, left_ankle, left_toe, right_...: (T, 3)}: feet that stay, and knees that follow the hips.

    The clips end at the hips, so the legs are a base pose, `standing` or `sitting`, that hangs on the clip's own hip
    joints: two-bone inverse kinematics in closed form. A hip farther off than the leg is long stretches the shin.
    """
    place, pole = STANCES[stance]
    found = {}
    for side, sign in (("left", 1), ("right", -1)):
        outwards = np.array([sign, 1, 1])
        hip = joints[f"{side}_hip"].astype(float)
        ankle = np.broadcast_to(np.median(hip, 0) + place * outwards * scale, hip.shape)
        thigh, shin = THIGH * scale, SHIN * scale
        reach = np.linalg.norm(ankle - hip, axis=-1, keepdims=True)
        length = np.clip(reach, 0.3 * scale, 0.999 * (thigh + shin))
        axis = unit(ankle - hip)
        along = (thigh**2 - shin**2 + length**2) / (2 * length)
        aim = pole * outwards - axis * (axis @ (pole * outwards))[:, None]
        knee = hip + axis * along + unit(aim) * np.sqrt(np.maximum(thigh**2 - along**2, 0))
        found |= {f"{side}_knee": knee, f"{side}_ankle": ankle,
                  f"{side}_toe": ankle + np.array([0.04 * sign, -0.045, 0.15]) * scale}  # fmt: skip
    return found


def pose(figure, clip, stance):
    """Joints (T, J, 3), head rotation (T, 4), and the points (T, V, 3) of trunk and head, each in its own frame.

    `stance` as in STANCES, or "none": the legs' joints then lie at the hips.
    """
    joints = _joints(np.asarray(clip.positions, np.float32))
    trunk = np.concatenate([figure._trunk(joints, table)[0] for table in (TROUSER_RINGS, SHIRT_RINGS)], 1)
    center, axes = figure.head.place(joints, clip.rotation, figure.scale)
    joints["nape"] = joints["collar"] + unit(joints["collar"] - joints["pelvis"]) * (0.022 * figure.scale)
    joints["head_center"] = center
    joints["head_base"] = center + axes @ (figure.scale * np.float32([0, -0.05, -0.02]))
    if stance == "none":
        joints |= {name: joints[name.split("_")[0] + "_hip"] for name in EXTRA[4:]}
    else:
        joints |= legs(joints, figure.scale, stance)
    frames = len(clip.positions)
    still = np.zeros((frames, 3), np.float32), np.tile(np.eye(3, dtype=np.float32), (frames, 1, 1))
    face, _ = figure.head.pose(*still, 1 / HEIGHT, clip.expression)
    turn = Rotation.from_matrix(axes).as_quat()
    turn *= np.cumprod(np.where(np.sum(turn * np.roll(turn, 1, 0), 1) < 0, -1, 1))[:, None]  # q and -q are one rotation
    return np.stack([joints[name] for name in JOINTS], 1), turn, trunk / figure.scale, face


def fit_shape(parts, tolerance):
    """Shape and [weights (T, K)] of `parts`, [(T, V, 3)] of one part in several clips.

    As few components, of those found from FITTED frames, as miss no vertex by more than `tolerance`, as root mean
    square over all frames.
    """
    every = max(sum(map(len, parts)) // FITTED, 1)
    sample = np.concatenate([part[::every] for part in parts])
    mean = sample.mean(0)
    moving = np.flatnonzero(np.ptp(sample, 0).max(-1) > 1e-6)
    size = len(moving) * 3
    if not size:
        return Shape(mean, moving, np.zeros((0, 0, 3))), [np.zeros((len(part), 0)) for part in parts]
    motion = np.concatenate([(part[:, moving] - mean[moving]).reshape(-1, size) for part in parts])
    _, spread, basis = np.linalg.svd((sample[:, moving] - mean[moving]).reshape(-1, size), full_matrices=False)
    basis = basis[spread > 1e-6 * spread[0]]
    basis *= np.sign(np.take_along_axis(basis, np.abs(basis).argmax(1)[:, None], 1))  # a vector's sign is free
    weights = motion @ basis.T
    few, many = 0, len(basis)
    while few < many:  # the error falls with every component: bisect
        middle = (few + many) // 2
        missed = motion - weights[:, :middle] @ basis[:middle]
        worst = np.square(missed).mean(0).reshape(-1, 3).sum(-1).max()
        few, many = (few, middle) if worst <= tolerance**2 else (middle + 1, many)
    shape = Shape(mean, moving, basis[:few].reshape(few, -1, 3))
    return shape, np.split(weights[:, :few], np.cumsum([len(part) for part in parts])[:-1])


def rebuild(shape, weights):
    """Points (T, V, 3) of a shape moved by weights (T, K)."""
    points = np.repeat(shape.mean[None], len(weights), 0)
    points[:, shape.moving] += np.tensordot(weights, shape.basis, 1)
    return points


def props(joints, scale, stance):
    """[(points (V, 3) metres, triangles, colour)] of what stands still around legs: a floor, and a stool to sit on."""
    if stance == "none":
        return []
    ankle = JOINTS.index("left_ankle"), JOINTS.index("right_ankle")
    floor = joints[0, ankle, 1].mean() / scale - 0.086
    ahead = 0.04 if stance == "standing" else 0.16
    found = [([[floor - 0.012, 0.02], [floor - 0.012, 0.46], [floor, 0.46], [floor, 0.0]], ahead, FLOOR)]
    if stance == "sitting":
        profile = [[floor, 0.14], [floor + 0.02, 0.13], [floor + 0.03, 0.03], [-0.19, 0.03], [-0.185, 0.18],
                   [-0.15, 0.19], [-0.12, 0.18], [-0.118, 0.0]]  # fmt: skip
        found.append((profile, 0.0, STOOL))
    return [(*_turned(np.array(profile), forward, scale), color) for profile, forward, color in found]


def _turned(profile, forward, scale):
    """Points and triangles of a body of revolution: rows of height and radius, in the character's units."""
    centers = np.zeros((1, len(profile), 3))
    centers[..., 1], centers[..., 2] = profile[:, 0] * scale, forward * scale
    ways = (np.broadcast_to(np.eye(3)[axis], centers.shape) for axis in (0, 2))
    points, _ = rings(centers, *ways, profile[:, 1] * scale, profile[:, 1] * scale, 2 * SIDES, power=2.0)
    return points[0], grid_triangles(len(profile), 2 * SIDES)


def make_puppets(clips, stance):
    """[Figure], [Puppet] and {"trunk", "head": Shape} of clips, all of which share the shapes."""
    figures = [Figure(clip.positions, clip.face_model) for clip in clips]
    posed = [pose(figure, clip, stance) for figure, clip in zip(figures, clips, strict=True)]
    trunk, trunks = fit_shape([each[2] for each in posed], TOLERANCE)
    head, heads = fit_shape([each[3] for each in posed], TOLERANCE / HEIGHT)
    puppets = [
        Puppet(joints, turn, {"trunk": t, "head": h}, figure.scale, clip.fps)
        for figure, clip, (joints, turn, _, _), t, h in zip(figures, clips, posed, trunks, heads, strict=True)
    ]
    return figures, puppets, {"trunk": trunk, "head": head}
