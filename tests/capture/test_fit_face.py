"""Face fitting: made-up faces are found again, from points in space and in pixels, through noise and missing frames."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from person import head, make_track
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from cospeech.capture.fit_face import FitSettings, fit_landmarks, fit_track, smooth_boxes
from cospeech.errors import CospeechError
from cospeech.face.model import FaceModel, embedded
from cospeech.face.solver import Basis, Landmarks, State, predict, smoothed_step, step

CAMERA = (1500.0, 1500.0, 960.0, 540.0)
SHOWN = ("jaw_open", "mouth_smile_left", "mouth_smile_right", "brow_inner_up")
FPS = 30.0


class Face:
    """A made-up face: what it did, and its landmarks in camera axes (metres) and in pixels."""

    def __init__(self, seconds=5.0, noise=0.001, seed=0, model=None):
        rng, self.model = np.random.default_rng(seed), model or embedded()
        self.rotation, self.expression = head(seconds, FPS)
        if model:
            self.expression = 0.5 + 0.4 * np.sin(np.outer(np.arange(len(self.rotation)) / 5, 1 + np.arange(3) / 3))
        self.identity = 0.7 * rng.normal(size=self.model.identity.shape[-1])
        vertices = self.model.landmarks if model else np.concatenate([self.model.landmarks, self.model.irises])
        points = self.model.vertices(self.expression, self.identity, vertices)
        turned = np.einsum("fab,flb->fla", Rotation.from_rotvec(self.rotation).as_matrix(), points)
        self.points = turned * [1, -1, -1] + [0.05, -0.1, 1.5] + rng.normal(size=turned.shape) * noise
        self.pixels = self.points[..., :2] / self.points[..., 2:] * 1500 + [960, 540]

    def degrees(self, fit):
        turn = Rotation.from_rotvec(fit.rotation) * Rotation.from_rotvec(self.rotation).inv()
        return np.degrees(turn.magnitude())

    def correlation(self, fit, frames=slice(None)):
        columns = [self.model.expression_names.index(name) for name in SHOWN]
        pairs = zip(fit.expression[frames, columns].T, self.expression[frames, columns].T, strict=True)
        return min(np.corrcoef(a, b)[0, 1] for a, b in pairs)


@pytest.fixture(scope="module")
def face():
    return Face()


@pytest.mark.parametrize("how", ["metric", "scaled", "pixels"])
def test_head_and_expression_are_found_again(face, how):
    if how == "pixels":
        fit = fit_landmarks(face.pixels, fps=FPS, camera=CAMERA)
    elif how == "metric":
        fit = fit_landmarks(face.points, fps=FPS)
    else:
        fit = fit_landmarks((face.points - [0, 0, 1.5]) * 800, fps=FPS, metric=False)
        assert_allclose(fit.scale, 800, rtol=0.06)
    assert face.degrees(fit).mean() < 1.0 and face.correlation(fit) > 0.9
    assert (fit.score == 1).all() and fit.residual.max() < 0.003
    assert fit.expression.min() >= 0 and fit.expression.max() <= 1


def test_identity_is_one_for_the_take_and_like_the_true_one(face):
    fit = fit_landmarks(face.points, fps=FPS)
    found = embedded().vertices(identity=fit.identity) - embedded().mean
    true = embedded().vertices(identity=face.identity) - embedded().mean
    skin = embedded().regions["skin"]
    found, true = (a[skin] - a[skin].mean(axis=0) for a in (found, true))
    assert np.corrcoef(found.ravel(), true.ravel())[0, 1] > 0.7


def test_missing_frames_are_bridged_and_marked(face):
    score = np.ones(face.points.shape[:2])
    score[60:68] = 0
    points = np.where(score[..., None] > 0, face.points, 0.0)
    fit = fit_landmarks(points, score, fps=FPS)
    assert (fit.score[60:68] == 0).all() and (np.delete(fit.score, np.r_[60:68]) == 1).all()
    assert face.degrees(fit)[60:68].max() < 3.0 and face.correlation(fit, slice(50, 80)) > 0.8


@pytest.mark.parametrize("how", ["metric", "scaled", "pixels"])
def test_cuts_long_gaps_and_frames_of_few_landmarks_are_no_end(how):
    """A face that is lost for more than a chunk of frames, with a cut in it, or seen by one landmark, or of no size."""
    face = Face(seconds=20.0)
    score = np.ones(face.points.shape[:2])
    score[200:] = 0
    score[50, 1:] = 0  # one landmark
    points = face.pixels.copy() if how == "pixels" else face.points.copy()
    points[60] = points[60, :1]  # a face of no size
    options = {"camera": CAMERA} if how == "pixels" else {"metric": how == "metric"}
    fit = fit_landmarks(points, score, fps=FPS, cuts=np.array([82, 300]), **options)
    lost = np.r_[50, 60, 200 : len(points)]
    assert (fit.score[lost] == 0).all() and (np.delete(fit.score, lost) > 0).all()
    assert all(np.isfinite(value).all() for value in vars(fit).values())
    assert np.delete(face.degrees(fit)[:200], [50, 60, 80, 81, 82, 83]).max() < 4.0
    assert (fit.rotation[560:] == fit.rotation[560]).all()  # where it was seen last


def test_a_landmark_far_off_is_no_match_for_the_others(face):
    points = face.points.copy()
    points[:, 54] += [0.05, 0.0, 0.0]  # the left corner of the mouth
    robust = fit_landmarks(points[::5], fps=FPS / 5, settings=FitSettings(personal=0))
    plain = fit_landmarks(points[::5], fps=FPS / 5, settings=FitSettings(personal=0, robust=1e9))
    away = [np.linalg.norm(fit.rotation - face.rotation[::5], axis=1).mean() for fit in (robust, plain)]
    assert away[0] < 0.5 * away[1] and np.degrees(away[0]) < 1.5


def test_the_fit_is_smoother_than_frames_on_their_own():
    face = Face(seconds=2.0, noise=0.003)
    together = fit_landmarks(face.points, fps=FPS)
    apart = fit_landmarks(face.points, fps=FPS, cuts=np.arange(1, len(face.points)))  # every frame a shot of its own
    shake = lambda fit: np.abs(np.diff(fit.expression, n=2, axis=0)).mean()
    assert shake(together) < 0.6 * shake(apart)


def test_long_takes_are_solved_in_chunks_that_meet_without_a_seam():
    face = Face(seconds=20.0)
    fit = fit_landmarks(face.points, fps=FPS)
    steps = np.abs(np.diff(fit.expression, axis=0)).max(axis=1)
    assert len(steps) > 2 * 256 and steps[[255, 511]].max() <= np.percentile(steps, 99)


def test_a_model_of_the_users_with_other_sizes_is_fitted():
    whole = embedded()
    rng = np.random.default_rng(1)
    kept = whole.landmarks
    other = FaceModel(
        "other",
        whole.mean[kept],
        whole.identity[kept][..., :5],
        np.stack([whole.expression[kept][..., i] for i in (0, 9, 46)], -1),
        np.array([[0, 1, 2]]),
        np.arange(68),
        np.arange(48, 68),
        licence_note="theirs",
    )
    face = Face(seconds=2.0, model=other)
    fit = fit_landmarks(face.points + rng.normal(size=face.points.shape) * 1e-4, fps=FPS, model=other)
    assert fit.expression.shape == (60, 3) and fit.identity.shape == (5,)
    assert min(np.corrcoef(a, b)[0, 1] for a, b in zip(fit.expression.T, face.expression.T, strict=True)) > 0.95


def test_a_tracks_face_is_fitted_in_its_own_skeleton():
    track = make_track(seconds=2.0, noise=0.002)
    fit = fit_track(track)
    turn = Rotation.from_rotvec(fit.rotation) * Rotation.from_rotvec(head(2.0, 30.0)[0]).inv()
    assert np.degrees(turn.magnitude()).mean() < 1.0
    track.face_landmarks.xyz = None
    turn = Rotation.from_rotvec(fit_track(track).rotation) * Rotation.from_rotvec(head(2.0, 30.0)[0]).inv()
    assert np.degrees(turn.magnitude()).mean() < 1.5


def test_a_face_that_is_never_seen_gives_a_fit_of_score_zero():
    fit = fit_landmarks(np.zeros((5, 68, 3)), np.zeros((5, 68)), fps=FPS)
    assert (fit.score == 0).all() and np.isfinite(fit.rotation).all() and (fit.expression == 0).all()


@pytest.mark.parametrize(
    ("points", "options", "says"),
    [
        (np.zeros((5, 50, 3)), {}, "expected \\(F, 68 or 70"),
        (np.zeros((5, 68, 2)), {}, "need a camera"),
        (np.zeros((5, 68, 3)), {"score": np.ones((5, 67))}, "scores have shape"),
        (np.full((5, 68, 3), np.nan), {}, "NaN"),
    ],
)
def test_wrong_landmarks_are_one_clear_line(points, options, says):
    with pytest.raises(CospeechError, match=says):
        fit_landmarks(points, fps=FPS, **options)


@pytest.mark.parametrize("mode", ["pinhole", "metric", "scaled"])
def test_derivatives_are_the_differences(mode):
    rng = np.random.default_rng(0)
    basis = Basis(rng.normal(size=(9, 3)), rng.normal(size=(9, 3, 2)), rng.normal(size=(9, 3, 4)), False)
    width = 2 if mode == "pinhole" else 3
    marks = Landmarks(rng.normal(size=(3, 9, width)), np.ones((3, 9)), mode, np.ones(2, bool), CAMERA)

    def state():
        again = np.random.default_rng(1)
        far = again.normal(size=(3, 3)) + np.array([0, 0, 20])
        turn = Rotation.random(3, rng=again).as_matrix()
        return State(again.normal(size=(3, 4)), turn, far, 0.1 * again.normal(size=3), again.normal(size=2))

    at, own, shared = predict(basis, marks, state())
    for k in range(own.shape[-1]):
        moved, change = state(), np.zeros((3, own.shape[-1]))
        change[:, k] = 1e-6
        step(moved, change)
        assert_allclose((predict(basis, marks, moved)[0] - at) / 1e-6, own[..., k], rtol=1e-3, atol=1e-3)
    moved = state()
    moved.identity[1] += 1e-6
    assert_allclose((predict(basis, marks, moved)[0] - at) / 1e-6, shared[..., 1], rtol=1e-3, atol=1e-3)


def test_the_band_solves_what_the_whole_matrix_does():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 4, 4))
    matrix, gradient = root @ np.swapaxes(root, 1, 2) + np.eye(4), rng.normal(size=(6, 4))
    change, smoothness, linked = rng.normal(size=(5, 4)), np.array([1.0, 2, 3, 4]), np.array([1, 1, 0, 1, 1], bool)
    whole, right = np.zeros((24, 24)), gradient.ravel().copy()
    for t in range(6):
        whole[4 * t : 4 * t + 4, 4 * t : 4 * t + 4] += matrix[t]
    for t in np.flatnonzero(linked):
        d = np.zeros((4, 24))
        d[:, 4 * t : 4 * t + 4], d[:, 4 * t + 4 : 4 * t + 8] = -np.eye(4), np.eye(4)
        whole += d.T @ np.diag(smoothness) @ d
        right -= d.T @ np.diag(smoothness) @ change[t]
    expected = np.linalg.solve(whole, right).reshape(6, 4)
    assert_allclose(smoothed_step(matrix, gradient, change, smoothness, linked), expected, rtol=1e-9)


def test_boxes_are_smoothed_by_a_gaussian_and_bridge_what_is_not_seen():
    rng = np.random.default_rng(0)
    boxes = np.tile([10.0, 20, 30, 40], (100, 1)) + rng.normal(size=(100, 4))
    smooth = smooth_boxes(boxes, np.ones(100, bool), 25.0, 0.2)
    assert_allclose(smooth, gaussian_filter1d(boxes, 5.0, axis=0, mode="nearest", truncate=8), atol=1e-9)
    seen = np.arange(100) % 7 != 3
    assert np.abs(smooth_boxes(np.where(seen[:, None], boxes, 0), seen, 25.0, 0.2) - smooth).max() < 1.0
