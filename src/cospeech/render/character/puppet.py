"""The character of the films made small enough for a web page: a mesh once, and few numbers a frame that move it.

Capsules follow joints. Trunk and head bend, so their vertices are written as a mean shape and a few directions
(principal components of what they do in these clips), moved by weights per frame. `player.js` puts them together
again; `rebuild` does the same here, for the tests.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.render.character.figure import Character
from cospeech.render.character.head import face_of
from cospeech.skeleton import UPPER55

STEP = 2e-4  # metres: positions are rounded to it
TOLERANCE = 2e-4  # metres: how far principal components may miss a vertex of trunk or head, root mean square in time
FITTED = 300  # frames, evenly taken from all clips, that the components are found from
LEGS = tuple(f"{side}_{name}" for side in ("left", "right") for name in ("knee", "ankle", "toe"))
JOINTS = (*UPPER55.names, "collar", "nape", "head_base", "head_center", *LEGS)


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
    {"trunk", "head": (T, K)}, scale as `Character.scale`, fps."""

    joints: np.ndarray
    head: np.ndarray
    weights: dict
    scale: float
    fps: float


def pose(figure, clip, expression):
    """Joints (T, J, 3), head rotation (T, 4), and the points (T, V, 3) of trunk and head, each in its own frame.

    Of a figure without legs, the legs' joints lie at the hips.
    """
    joints, axes = figure.skeleton(clip.positions, clip.rotation)
    trunk = np.concatenate([points for points, _ in figure.trunk(joints)], 1)
    joints = {name: joints[f"{name.split('_')[0]}_hip"] for name in LEGS} | joints
    turn = Rotation.from_matrix(axes).as_quat()
    turn *= np.cumprod(np.where(np.sum(turn * np.roll(turn, 1, 0), 1) < 0, -1, 1))[:, None]  # q and -q are one rotation
    head = figure.head.shape(clip.frames, expression)
    return np.stack([joints[name] for name in JOINTS], 1), turn, trunk / figure.scale, head


def fit_shape(parts, tolerance):
    """Shape and [weights (T, K)] of `parts`, [(T, V, 3)] of one part in several clips.

    As few components, found from FITTED frames evenly taken, as miss no vertex there by more than `tolerance`, as root
    mean square over these frames.
    """
    every = max(sum(map(len, parts)) // FITTED, 1)
    sample = np.concatenate([part[::every] for part in parts])
    mean = sample.mean(0)
    moving = np.flatnonzero(np.ptp(sample, 0).max(-1) > 1e-6)
    size = len(moving) * 3
    if not size:
        return Shape(mean, moving, np.zeros((0, 0, 3))), [np.zeros((len(part), 0)) for part in parts]
    flat = (sample[:, moving] - mean[moving]).reshape(-1, size)
    _, spread, basis = np.linalg.svd(flat, full_matrices=False)
    basis = basis[spread > 1e-6 * spread[0]]
    basis *= np.sign(np.take_along_axis(basis, np.abs(basis).argmax(1)[:, None], 1))  # a vector's sign is free
    # Components do not correlate over the sample, so what those from k on would add to a vertex' square simply sums up.
    left = np.square(basis * spread[: len(basis), None]).reshape(len(basis), -1, 3).sum(-1)[::-1].cumsum(0)[::-1]
    count = int((left.max(1) / len(sample) > tolerance**2).sum())
    basis = basis[:count]
    weights = [(part[:, moving] - mean[moving]).reshape(-1, size) @ basis.T for part in parts]
    return Shape(mean, moving, basis.reshape(count, -1, 3)), weights


def rebuild(shape, weights):
    """Points (T, V, 3) of a shape moved by weights (T, K)."""
    points = np.repeat(shape.mean[None], len(weights), 0)
    points[:, shape.moving] += np.tensordot(weights, shape.basis, 1)
    return points


def make_puppets(clips, posture, face=None):
    """[Character], [Puppet] and {"trunk", "head": Shape} of clips, all of which share the shapes.

    posture as of `Character`; face as of `face_of`.
    """
    faces = [face_of(clip, face) for clip in clips]
    figures = [Character(clip.positions, each, posture) for clip, (each, _) in zip(clips, faces, strict=True)]
    posed = [
        pose(figure, clip, expression) for figure, clip, (_, expression) in zip(figures, clips, faces, strict=True)
    ]
    trunk, trunks = fit_shape([each[2] for each in posed], TOLERANCE)
    head, heads = fit_shape([each[3] for each in posed], TOLERANCE)
    puppets = [
        Puppet(joints, turn, {"trunk": t, "head": h}, figure.scale, clip.fps)
        for figure, clip, (joints, turn, _, _), t, h in zip(figures, clips, posed, trunks, heads, strict=True)
    ]
    return figures, puppets, {"trunk": trunk, "head": head}
