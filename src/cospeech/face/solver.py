"""The least squares behind the face fit: landmarks of a morphable model under three cameras, solved by Gauss-Newton.

The unknowns of a frame are its expression, a turn of the head (a rotation vector on the left of the current rotation),
its translation and, without a metric scale, the logarithm of its size. Frames are coupled to their neighbours by the
smoothness of each unknown alone, so the normal equations are a band no wider than one frame's unknowns, and LAPACK
solves them for all frames in one call.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation

MODES = ("pinhole", "metric", "scaled")
AXES = np.array([1.0, -1.0, -1.0])  # camera axes (x right, y down, z away) to x left, y up, z to the camera
OUTSIDE = 400.0  # how much more it costs to leave 0..1 than to be off the prior's mean, in its own variance


@dataclass
class Landmarks:
    """What is to be explained: targets (F, L, 2 pixels or 3), weights (F, L) one over the variance, mode, camera.

    mode "pinhole": pixels under `camera` (fx, fy, cx, cy); "metric": points (x left, y up, z to the camera) in metres;
    "scaled": the same in units of unknown size (`unit` metres each, about). linked (F - 1,): whether a frame and the
    next belong to one movement.
    """

    targets: np.ndarray
    weights: np.ndarray
    mode: str
    linked: np.ndarray
    camera: tuple = ()

    def __len__(self):
        return len(self.targets)

    def section(self, where):
        """Some of the frames: a slice, or indices, which are then not linked."""
        linked = (
            self.linked[where.start : where.stop - 1] if isinstance(where, slice) else np.zeros(len(where) - 1, bool)
        )
        return Landmarks(self.targets[where], self.weights[where], self.mode, linked, self.camera)


@dataclass
class State:
    """F frames of unknowns: expression (F, E), rotation (F, 3, 3), translation (F, 3), log_scale (F,), of a face with
    `identity` (I,)."""

    expression: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    log_scale: np.ndarray
    identity: np.ndarray

    def section(self, where):
        """Some of the frames, with the same identity."""
        parts = (self.expression, self.rotation, self.translation, self.log_scale)
        return State(*(part[where].copy() for part in parts), self.identity)


@dataclass
class Basis:
    """A model at its landmarks: mean (L, 3), identity (L, 3, I), expression (L, 3, E); `bounded` as in `FaceModel`."""

    mean: np.ndarray
    identity: np.ndarray
    expression: np.ndarray
    bounded: bool


def start(basis, marks, identity=None):
    """A `State` of a face at rest (the mean face without `identity`), posed by closed form; where nothing is
    seen, as it was before.

    In 3D by Umeyama's similarity; in pixels by the best affine camera, made orthogonal (POS).
    """
    frames = len(marks)
    seen = marks.weights.sum(axis=1) > 0
    identity = np.zeros(basis.identity.shape[-1]) if identity is None else identity
    rest = basis.mean + basis.identity @ identity
    state = State(
        np.zeros((frames, basis.expression.shape[-1])),
        np.tile(np.eye(3), (frames, 1, 1)),
        np.zeros((frames, 3)),
        np.zeros(frames),
        identity,
    )
    if not seen.any():
        return state
    pose = _affine(rest, marks, seen) if marks.mode == "pinhole" else _similarity(rest, marks, seen)
    place = np.clip(np.cumsum(seen) - 1, 0, None)  # of what is missing, the frame seen last before it
    state.rotation, state.translation, state.log_scale = (part[place] for part in pose)
    return state


def _similarity(rest, marks, seen):
    """Rotation, translation and log scale of the weighted best similarity from the mean face to each frame's points."""
    weights = marks.weights[seen] / marks.weights[seen].sum(axis=1, keepdims=True)
    middle = np.einsum("fl,lc->fc", weights, rest)
    center = np.einsum("fl,flc->fc", weights, marks.targets[seen])
    model, points = rest - middle[:, None], marks.targets[seen] - center[:, None]
    left, sizes, right = np.linalg.svd(np.einsum("fl,fla,flb->fab", weights, points, model))
    sign = np.ones_like(sizes)
    sign[:, 2] = np.linalg.det(left @ right)
    rotation = (left * sign[:, None]) @ right
    scale = np.ones(len(sizes))
    if marks.mode == "scaled":
        scale = (sizes * sign).sum(axis=1) / np.einsum("fl,flc->f", weights, model**2)
    translation = center - scale[:, None] * np.einsum("fab,fb->fa", rotation, middle)
    return rotation, translation, np.log(scale)


def _affine(rest, marks, seen):
    """Rotation, translation and zeros from the affine camera that maps the mean face to each frame's pixels."""
    fx, fy, cx, cy = marks.camera
    weight = (marks.weights[seen].mean(axis=0) > 0)[:, None]
    model = np.concatenate([rest * AXES, np.ones((len(rest), 1))], axis=1) * weight
    rays = (marks.targets[seen] - [cx, cy]) / [fx, fy]
    affine = np.einsum("al,flc->fca", np.linalg.pinv(model), rays * weight)
    rows = affine[..., :3]
    scale = np.linalg.norm(rows, axis=-1).mean(axis=1)
    left, _, right = np.linalg.svd(rows / scale[:, None, None], full_matrices=False)
    two = left @ right
    rotation = np.concatenate([two, np.cross(two[:, 0], two[:, 1])[:, None]], axis=1)
    depth = 1 / scale
    shift = np.stack([affine[:, 0, 3] * depth, affine[:, 1, 3] * depth, depth], axis=1)
    return rotation * AXES[:, None] * AXES, shift, np.zeros(len(scale))


def predict(basis, marks, state, own=True, shared=True):
    """Predicted targets (F, L, D), and their derivatives by a frame's unknowns (F, L, D, n) and by identity
    (F, L, D, I), each None unless asked for; n = E + 6, or E + 7 in mode "scaled"."""
    shape = basis.mean + basis.identity @ state.identity
    points = shape + (state.expression @ basis.expression.reshape(-1, basis.expression.shape[-1]).T).reshape(
        len(marks), *shape.shape
    )
    turned = points @ np.swapaxes(state.rotation, 1, 2)
    scale = np.exp(state.log_scale)[:, None, None]
    placed = (
        scale * turned + state.translation[:, None]
        if marks.mode != "pinhole"
        else (turned * AXES + state.translation[:, None])
    )
    project, predicted = _project(marks, placed)
    if not own:
        return predicted, None, None
    outer = (
        scale[..., None] * state.rotation[:, None]
        if marks.mode != "pinhole"
        else (AXES[:, None] * state.rotation[:, None])
    )
    if project is not None:
        outer = project @ outer
    x, y, z = np.moveaxis(scale * turned, -1, 0) if marks.mode != "pinhole" else np.moveaxis(turned, -1, 0)
    zero = np.zeros_like(x)
    spin = np.stack([np.stack(r, -1) for r in ((zero, z, -y), (-z, zero, x), (y, -x, zero))], -2)  # w x point, by w
    move = np.broadcast_to(np.eye(3), spin.shape)
    if marks.mode == "pinhole":
        spin = project @ (AXES[:, None] * spin)
        move = project
    parts = [outer @ basis.expression, spin, move] + ([(scale * turned)[..., None]] if marks.mode == "scaled" else [])
    return predicted, np.concatenate(parts, axis=-1), outer @ basis.identity if shared else None


def _project(marks, placed):
    """Derivative (F, L, 2, 3) of the pinhole camera and pixels (F, L, 2); None and the points themselves in 3D."""
    if marks.mode != "pinhole":
        return None, placed
    fx, fy, cx, cy = marks.camera
    x, y, depth = np.moveaxis(placed, -1, 0)
    depth = np.maximum(depth, 1e-3)
    zero = np.zeros_like(x)
    rows = (np.stack([fx / depth, zero, -fx * x / depth**2], -1), np.stack([zero, fy / depth, -fy * y / depth**2], -1))
    return np.stack(rows, -2), np.stack([fx * x / depth + cx, fy * y / depth + cy], -1)


def normal_equations(basis, marks, state, prior, robust, identity=True):
    """A (F, n, n), its gradient (F, n), and if `identity` its coupling (F, n, I), its own (I, I) and gradient (I, 1).

    prior (n,): one over the variance of each unknown about 0 (0 for the pose). robust: residuals beyond so many
    standard deviations count linearly (Huber).
    """
    predicted, own, shared = predict(basis, marks, state, shared=identity)
    residual = marks.targets - predicted
    size = np.linalg.norm(residual, axis=-1) * np.sqrt(marks.weights)
    weights = marks.weights * np.minimum(1, robust / np.maximum(size, 1e-12))
    rows = own.shape[1] * own.shape[2]
    root = np.repeat(np.sqrt(weights), own.shape[2], axis=1)[..., None]
    own = own.reshape(len(marks), rows, -1) * root
    residual = residual.reshape(len(marks), rows, 1) * root
    across = np.swapaxes(own, 1, 2)
    matrix, gradient = across @ own, (across @ residual)[..., 0]
    unknowns = np.concatenate(
        [state.expression, np.zeros((len(marks), len(prior) - state.expression.shape[1]))], axis=1
    )
    diagonal = np.tile(prior + 1e-9 * matrix.diagonal(axis1=1, axis2=2).mean(), (len(marks), 1))
    gradient -= prior * unknowns
    if basis.bounded:
        beyond = unknowns - np.clip(unknowns, 0, 1)
        diagonal += OUTSIDE * prior * (beyond != 0)
        gradient -= OUTSIDE * prior * beyond
    index = np.arange(len(prior))
    matrix[:, index, index] += diagonal
    if not identity:
        return matrix, gradient, None, None, None
    shared = shared.reshape(len(marks), rows, -1) * root
    both = np.swapaxes(shared, 1, 2)
    return matrix, gradient, across @ shared, (both @ shared).sum(axis=0), (both @ residual).sum(axis=0)


def step(state, change):
    """`state` with each frame's unknowns moved by `change` (F, n)."""
    count = state.expression.shape[1]
    state.expression = state.expression + change[:, :count]
    spin = Rotation.from_rotvec(np.clip(change[:, count : count + 3], -0.5, 0.5)).as_matrix()
    state.rotation = spin @ state.rotation
    state.translation = state.translation + change[:, count + 3 : count + 6]
    if change.shape[1] > count + 6:
        state.log_scale = state.log_scale + change[:, count + 6]


def differences(state, count):
    """(F - 1, n) by how much each unknown changes from frame to frame."""
    turn = state.rotation[1:] @ np.swapaxes(state.rotation[:-1], 1, 2)
    parts = [
        np.diff(state.expression, axis=0),
        Rotation.from_matrix(turn).as_rotvec(),
        np.diff(state.translation, axis=0),
        np.diff(state.log_scale)[:, None],
    ]
    return np.concatenate(parts, axis=1)[:, :count]


def smoothed_step(matrix, gradient, change, smoothness, linked):
    """The step (F, n) of all frames together: their own equations, and `smoothness` (n,) times the squares of the
    `change` (F - 1, n) between linked frames."""
    frames, n = gradient.shape
    tie = smoothness * linked[:, None]
    gradient, matrix = gradient.copy(), matrix.copy()
    gradient[:-1] += tie * change
    gradient[1:] -= tie * change
    index = np.arange(n)
    matrix[:-1, index, index] += tie
    matrix[1:, index, index] += tie
    band = np.zeros((n + 1, frames, n))
    row, column = np.tril_indices(n)
    band[row - column, :, column] = matrix[:, row, column].T
    band[n, :-1] = -tie
    return solveh_banded(
        band.reshape(n + 1, -1), gradient.ravel(), lower=True, overwrite_ab=True, check_finite=False
    ).reshape(frames, n)
