"""Fitting a morphable face to a take's landmarks: one identity, an expression and a pose a frame, smooth in time.

The most probable face under Gaussian errors of the landmarks and Gaussian priors on identity, expression and their
change: regularised non-linear least squares, as the thesis' tracker (4.3.1, Garrido et al.) has.
"""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.face import solver
from cospeech.face.expressions import LANDMARKS
from cospeech.face.model import embedded
from cospeech.face.solver import AXES, Basis, Landmarks
from cospeech.files import read_yaml

IDENTITY_FRAMES = 12, 48  # from the fourth part of a take's frames, spread over it, but so many, the identity is found
INDEPENDENT = 4.0  # as how many they count: how a model fails to fit a face is the same in all of them
SIZE = 0.02  # standard deviation of the face's size where it cannot be seen
LEAST_LANDMARKS = 6  # of a frame that tells a pose, size and some expression
CHUNK, OVERLAP = 256, 16  # frames that are solved together, and by how many neighbouring chunks overlap
MOVABLE = 2e-4  # metres by which an expression must move some landmark to be fitted at all


@dataclass(frozen=True)
class FitSettings:
    """Standard deviations of what the fit weighs against each other; our own choices, none is published.

    landmark : metres between a landmark and the model. expression, identity : of the coefficients. personal :
    metres by which a person's landmarks lie elsewhere than the model's, the same in all frames. change : of an
    expression coefficient within a second; turn and shift : the same of the head in radians and metres (all grow with
    the square root of time). robust : standard deviations beyond which a landmark counts less. iterations : of
    Gauss-Newton. box_sigma : seconds, of the Gaussian on the face's boxes.
    """

    landmark: float = 0.002
    expression: float = 0.5
    identity: float = 1.0
    personal: float = 0.002
    change: float = 1.5
    turn: float = 1.5
    shift: float = 0.4
    robust: float = 3.0
    iterations: int = 3
    box_sigma: float = 0.2


@dataclass
class FaceFit:
    """A face over F frames. expression (F, E); rotation (F, 3) axis-angle in radians, 0 looks into the camera;
    translation (F, 3); scale (F,) tracker units a metre; identity (I,); personal (L, 3) metres, where this person's
    landmarks (or the tracker's idea of them) lie off the model's; score (F,), 0 where no face was seen;
    residual (F,) metres, root mean square over the landmarks."""

    expression: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    scale: np.ndarray
    identity: np.ndarray
    personal: np.ndarray
    score: np.ndarray
    residual: np.ndarray


def fit_landmarks(
    points, score=None, *, fps, camera=None, metric=True, model=None, settings=None, cuts=(), name="landmarks"
):
    """`FaceFit` to landmarks of F frames.

    points : (F, L, 2) pixels seen by `camera` (fx, fy, cx, cy), or (F, L, 3) in the camera's axes (x right, y down, z
    away), in metres if `metric` and in any one unit if not. L = 68 (iBUG), or 70 with the irises (right, left).
    score (F, L) : confidence; a landmark of score 0 is not there, a frame with fewer than LEAST_LANDMARKS, or with all
    of them in one place, is bridged by its neighbours.
    cuts : first frames of new shots. Raises CospeechError for shapes that do not fit the model.
    """
    model, settings = model or embedded(), settings or FitSettings()
    points = np.asarray(points, float)
    score = np.ones(points.shape[:2]) if score is None else np.asarray(score, float)
    vertices = _checked(points, score, camera, model, name)
    basis, active = _basis(model, vertices)
    score = score * _posed(points, score * (vertices >= 0))[:, None]
    marks, sigma = _landmarks(points, score * (vertices >= 0), fps, camera, metric, cuts, basis, settings)
    prior, smoothness = _priors(basis, marks, sigma, fps, settings)
    state = solver.start(basis, marks, _fit_identity(basis, marks, prior, settings))
    if marks.weights.any():
        _fit_frames(basis, marks, state, prior, smoothness, settings)
    predicted, _, _ = solver.predict(basis, marks, state, own=False)
    error = np.linalg.norm(marks.targets - predicted, axis=-1) / sigma[:, None] * settings.landmark
    used = marks.weights > 0
    residual = np.sqrt((error**2 * used).sum(axis=1) / np.maximum(used.sum(axis=1), 1))
    expression = np.zeros((len(points), model.expression.shape[-1]))
    expression[:, active] = np.clip(state.expression, 0, 1) if model.bounded else state.expression
    seen, own = score.max(axis=1) > 0, model.identity.shape[-1]
    return FaceFit(
        expression,
        Rotation.from_matrix(state.rotation).as_rotvec(),
        state.translation,
        np.exp(state.log_scale),
        state.identity[:own],
        state.identity[own:].reshape(-1, 3),
        np.where(seen, score.mean(axis=1), 0.0),
        residual,
    )


def fit_track(track, model=None, settings=None, name="track"):
    """`FaceFit` to a `Track`'s face landmarks: in three dimensions where it has them, else under its camera."""
    points = track.face_landmarks
    chosen = _table().get(points.skeleton)
    if chosen is None:
        raise CospeechError(
            f"{name}: no way from {points.skeleton!r} to the 68 landmarks; known: {', '.join(_table())}"
        )
    score = np.where(points.observed[:, None], points.score[:, chosen], 0.0)
    options = {"fps": track.fps, "model": model, "settings": settings, "cuts": track.cuts, "name": name}
    if points.xyz is not None:
        return fit_landmarks(points.xyz[:, chosen], score, metric=points.metric, **options)
    camera = track.camera.fx, track.camera.fy, track.camera.cx, track.camera.cy
    return fit_landmarks(points.xy[:, chosen], score, camera=camera, **options)


def smooth_boxes(boxes, seen, fps, sigma=0.2):
    """Face boxes (F, 4) = left, top, right, bottom in pixels, filtered over time by a Gaussian of `sigma` seconds.

    The published tracker crops the face by boxes filtered in time, which shakes less than following each frame's
    landmarks. Frames not `seen` (F,) take part with weight 0; without any, the boxes come back.
    """
    weight = gaussian_filter1d(np.asarray(seen, float), sigma * fps, mode="nearest", truncate=8)
    total = gaussian_filter1d(np.where(seen[:, None], boxes, 0.0), sigma * fps, axis=0, mode="nearest", truncate=8)
    near = np.interp(np.arange(len(seen)), np.flatnonzero(seen), np.arange(seen.sum())) if seen.any() else None
    far = boxes if near is None else boxes[seen][np.round(near).astype(int)]
    return np.where(weight[:, None] > 1e-6, total / np.maximum(weight, 1e-6)[:, None], far)


@cache
def _table():
    """{skeleton: indices of its points that are iBUG's 68 and, where it has them, the irises}."""
    table = read_yaml(files("cospeech.capture") / "data" / "landmarks.yaml")
    return {
        name: np.arange(p) if isinstance(p := entry["points"], int) else np.array(p) for name, entry in table.items()
    }


def _checked(points, score, camera, model, name):
    """(L,) vertices of the landmarks, after checking the shapes."""
    count = points.shape[1] if points.ndim == 3 else 0
    if points.ndim != 3 or count not in (LANDMARKS, LANDMARKS + 2) or points.shape[2] not in (2, 3):
        raise CospeechError(f"{name}: landmarks have shape {points.shape}, expected (F, 68 or 70, 2 or 3)")
    if score.shape != points.shape[:2]:
        raise CospeechError(f"{name}: scores have shape {score.shape}, the landmarks {points.shape[:2]}")
    if points.shape[2] == 2 and camera is None:
        raise CospeechError(f"{name}: landmarks in pixels need a camera (fx, fy, cx, cy)")
    if not np.isfinite(points).all():
        raise CospeechError(f"{name}: landmarks hold NaN or infinity")
    if (model.landmarks < 0).all():
        raise CospeechError(
            f"{name}: face model {model.name} does not tell which vertices are the landmarks; convert it with them"
        )
    irises = model.irises if len(model.irises) == 2 else np.array([-1, -1])
    return np.concatenate([model.landmarks, irises])[:count]


def _posed(points, score):
    """(F,) frames whose landmarks can tell a pose: enough of them, and not all in one place."""
    there = score > 0
    low, high = (np.where(there[..., None], points, sign * np.inf) for sign in (1, -1))
    extent = (high.max(axis=1, initial=-np.inf) - low.min(axis=1, initial=np.inf)).max(axis=1)
    return (there.sum(axis=1) >= LEAST_LANDMARKS) & (extent > 1e-6)


def _basis(model, vertices):
    """The model at its landmarks, with the expressions that move any, and which these are. The identity goes on with
    a displacement of each landmark."""
    # a landmark that the model lacks (-1) reads some vertex; its weight is 0
    moves = np.abs(model.expression[vertices]).max(axis=(0, 1))
    active = np.flatnonzero(moves > MOVABLE)
    personal = np.eye(3 * len(vertices)).reshape(len(vertices), 3, -1)
    identity = np.concatenate([model.identity[vertices], personal], axis=-1)
    return Basis(model.mean[vertices], identity, model.expression[vertices][..., active], model.bounded), active


def _landmarks(points, score, fps, camera, metric, cuts, basis, settings):
    """`Landmarks`, and sigma (F,): what one standard deviation of a landmark is in their unit, by the face's size."""
    linked = np.ones(len(points) - 1, bool)
    linked[np.asarray(cuts, int) - 1] = False
    mode = "pinhole" if points.shape[2] == 2 else "metric" if metric else "scaled"
    targets = points if mode == "pinhole" else points * AXES
    seen = score.max(axis=1) > 0
    low, high = (np.where(score[..., None] > 0, targets[..., :2], s * np.inf) for s in (1, -1))
    boxes = np.where(seen[:, None], np.concatenate([low.min(axis=1), high.max(axis=1)], axis=1), 0.0)
    height = np.maximum(np.ptp(smooth_boxes(boxes, seen, fps, settings.box_sigma)[:, 1::2], axis=1), 1e-6)
    unit = np.ones(len(points)) if mode == "metric" else height / np.ptp(basis.mean[:, 1])
    sigma = settings.landmark * unit
    weights = score * IMPORTANCE[: points.shape[1]] / sigma[:, None] ** 2
    return Landmarks(targets, weights, mode, linked, camera or ()), sigma


# The jaw's outline slides with the view; lips and lids are what an expression is read from.
IMPORTANCE = np.concatenate(
    [np.full(6, 0.1), np.full(5, 0.5), np.full(6, 0.1), np.full(19, 1.0), np.full(32, 1.5), [0.7] * 2]
)


def _priors(basis, marks, sigma, fps, settings):
    """(n,) one over the variance of each unknown, and of its change from frame to frame."""
    count = basis.expression.shape[-1]
    extra = 1 if marks.mode == "scaled" else 0
    unit = float(np.median(sigma)) / settings.landmark if extra else 1.0
    prior = np.concatenate([np.full(count, settings.expression**-2), np.zeros(6 + extra)])
    change = [settings.change] * count + [settings.turn] * 3 + [settings.shift * unit] * 3 + [0.05] * extra
    return prior, fps / np.square(change)


def _fit_identity(basis, marks, prior, settings):
    """(I,) from frames spread over the take, whose own unknowns are eliminated from the equations frame by frame."""
    seen = np.flatnonzero(marks.weights.sum(axis=1) > 0)
    if not len(seen):
        return np.zeros(basis.identity.shape[-1])
    count = np.clip(len(seen) // 4, *IDENTITY_FRAMES)
    some = marks.section(seen[np.unique(np.linspace(0, len(seen) - 1, count).round().astype(int))])
    state, prior_matrix = (
        solver.start(basis, some),
        len(some) / INDEPENDENT * _identity_prior(basis, marks.mode, settings),
    )
    for _ in range(settings.iterations):
        matrix, gradient, across, square, pull = solver.normal_equations(basis, some, state, prior, settings.robust)
        solved = np.linalg.solve(matrix, np.concatenate([across, gradient[..., None]], axis=2))
        back = np.swapaxes(across, 1, 2)
        inner = square + prior_matrix - (back @ solved[..., :-1]).sum(axis=0)
        outer = pull[:, 0] - prior_matrix @ state.identity - (back @ solved[..., -1:]).sum(axis=0)[:, 0]
        change = np.linalg.solve(inner, outer)
        state.identity = state.identity + change
        solver.step(state, solved[..., -1] - solved[..., :-1] @ change)
    return state.identity


def _identity_prior(basis, mode, settings):
    """(I, I) of the identity's Gaussian. Where nothing tells how large the face is, it is held near the mean's size: a
    smaller face with livelier expressions would always explain the landmarks more cheaply."""
    personal = basis.mean.size
    sigma = [settings.identity] * (basis.identity.shape[-1] - personal) + [max(settings.personal, 1e-6)] * personal
    prior = np.diag(np.square(sigma) ** -1.0)
    centered = basis.mean - basis.mean.mean(axis=0)
    growth = np.einsum("lc,lci->i", centered, basis.identity) / np.sum(centered**2)
    return prior if mode == "metric" else prior + np.outer(growth, growth) / SIZE**2


def _fit_frames(basis, marks, state, prior, smoothness, settings):
    """Expressions and poses of all frames for this identity, chunk by chunk: memory does not grow with the take."""
    for first in range(0, len(marks), CHUNK):
        where = slice(max(0, first - OVERLAP), min(len(marks), first + CHUNK + OVERLAP))
        some, own = marks.section(where), state.section(where)
        if not some.weights.any():  # nothing to solve by; the head stays where it was seen last
            continue
        for _ in range(settings.iterations):
            matrix, gradient, *_ = solver.normal_equations(basis, some, own, prior, settings.robust, identity=False)
            change = solver.differences(own, len(prior))
            solver.step(own, solver.smoothed_step(matrix, gradient, change, smoothness, some.linked))
        kept = slice(first - where.start, min(first + CHUNK, len(marks)) - where.start)
        target = slice(first, min(first + CHUNK, len(marks)))
        for key in ("expression", "rotation", "translation", "log_scale"):
            getattr(state, key)[target] = getattr(own, key)[kept]
