"""The face model: equation 2.4, what its named expressions do, models of the user's in their usual layouts."""

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.io import savemat

from cospeech.cli import main
from cospeech.errors import CospeechError
from cospeech.face.expressions import COSPEECH64
from cospeech.face.model import FaceModel, convert, embedded

FACE = embedded()
REST = FACE.mean[FACE.landmarks]
EYES = np.r_[45:41:-1, 47, 46, 39:35:-1, 41, 40]
MIRROR = np.r_[16:-1:-1, 26:16:-1, 27:31, 35:30:-1, EYES, 54:47:-1, 59:54:-1, 64:59:-1, 67:64:-1]


def landmarks(**expression):
    """(68, 3) millimetres of what named expressions do to the landmarks; a name without side does both."""
    coefficients = np.zeros(64)
    for name, value in expression.items():
        names = [name] if name in COSPEECH64 else [f"{name}_left", f"{name}_right"]
        coefficients[[COSPEECH64.index(n) for n in names]] = value
    return 1000 * FACE.vertices(coefficients, chosen=FACE.landmarks)


def test_vertices_are_equation_2_4():
    rng = np.random.default_rng(0)
    identity, expression = rng.normal(size=FACE.identity.shape[2]), rng.random(64)
    expected = FACE.mean.copy()
    for k, a in enumerate(identity):
        expected += a * FACE.identity[:, :, k]
    for k, a in enumerate(expression):
        expected += a * FACE.expression[:, :, k]
    assert_allclose(FACE.vertices(expression, identity), expected, atol=1e-12)
    assert_allclose(FACE.vertices(np.stack([expression, 0 * expression]))[1], FACE.mean, atol=1e-12)


def test_its_expressions_are_cospeech64_and_every_component_moves_something():
    assert FACE.expression_names == COSPEECH64 and FACE.expression.shape[2] == 64
    assert np.abs(FACE.expression).max(axis=(0, 1)).min() > 1e-3
    assert np.abs(FACE.identity).max(axis=(0, 1)).min() > 1e-3 and 16 <= FACE.identity.shape[2] <= 32


def test_it_is_a_mesh_of_a_face():
    assert 1000 < len(FACE.mean) < 3000
    corners = FACE.mean[FACE.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    skin = np.isin(FACE.triangles, FACE.regions["skin"]).all(axis=1)
    front = skin & (np.abs(corners[..., 0].mean(axis=1)) < 0.05) & (corners[..., 1].min(axis=1) > -0.1)
    assert (normals[front, 2] > 0).mean() > 0.96  # seen from the front, not from behind
    assert np.unique(FACE.triangles).size == len(FACE.mean)
    width, height = np.ptp(FACE.mean[:, 0]), np.ptp(REST[:, 1])
    assert 0.13 < width < 0.16 and 0.12 < height < 0.16
    assert 0.06 < REST[42:48, 0].mean() - REST[36:42, 0].mean() < 0.066  # adults' pupils: 63 mm apart


def test_landmarks_stand_in_ibugs_order():
    assert (np.diff(REST[0:17, 0]) > 0).all() and REST[8, 1] == REST[:, 1].min()
    assert (np.diff(REST[27:31, 1]) < 0).all() and np.argmax(REST[:, 2]) == 30  # down the nose to its tip
    assert REST[36, 0] < REST[39, 0] < 0 < REST[42, 0] < REST[45, 0]
    assert REST[37, 1] > REST[41, 1] and REST[51, 1] > REST[62, 1] > REST[66, 1] > REST[57, 1]
    assert REST[48, 0] < 0 < REST[54, 0]
    assert_allclose(REST[MIRROR] * [-1, 1, 1], REST, atol=1e-9)


@pytest.mark.parametrize("name", [n for n in COSPEECH64 if n.endswith("_left") and n[:-5] not in ("jaw", "mouth")])
def test_left_and_right_are_mirror_images(name):
    left, right = landmarks(**{name: 1}), landmarks(**{name[:-5] + "_right": 1})
    assert_allclose(left[MIRROR] * [-1, 1, 1], right, atol=1e-6)


def test_expressions_do_what_they_are_called():
    rest, gap = landmarks(), lambda p, a, b: np.linalg.norm(p[a] - p[b])
    assert gap(landmarks(jaw_open=1), 62, 66) > 20 > 3 > gap(rest, 62, 66)
    assert_allclose(landmarks(jaw_open=1)[17:48], rest[17:48], atol=1.5)  # brows, nose and eyes stay
    closed = landmarks(jaw_open=1, mouth_close=1)
    assert gap(closed, 62, 66) < 10 and closed[8, 1] < rest[8, 1] - 15
    for lids in ((37, 41), (38, 40)):
        assert gap(landmarks(eye_blink_right=1), *lids) < 0.3 * gap(rest, *lids)
    assert_allclose(landmarks(eye_blink_right=1)[42:48], rest[42:48], atol=0.1)  # the left eye stays open
    smile = landmarks(mouth_smile=1) - rest
    assert smile[54, 0] > 4 and smile[54, 1] > 4 and smile[48, 0] < -4
    assert gap(landmarks(mouth_pucker=1), 48, 54) < 0.7 * gap(rest, 48, 54) < gap(landmarks(mouth_stretch=1), 48, 54)
    assert (landmarks(mouth_pucker=1) - rest)[51, 2] > 4
    assert (landmarks(brow_inner_up=1) - rest)[[21, 22], 1].min() > 5
    assert (landmarks(brow_down=1) - rest)[18:26, 1].max() < -2


def test_eyes_turn_about_their_centres():
    left = FACE.irises[1]
    out, up = (FACE.expression[left, :, COSPEECH64.index(f"eye_look_{way}_left")] for way in ("out", "up"))
    assert out[0] > 0.004 and abs(out[1]) < 1e-9 and up[1] > 0.004 and abs(up[0]) < 1e-9


def test_lip_vertices_are_the_lips_in_metres():
    expression = np.zeros((2, 64))
    expression[1, COSPEECH64.index("jaw_open")] = 1
    lips = FACE.lip_vertices(expression)
    assert lips.shape == (2, len(FACE.lips), 3) and set(FACE.landmarks[48:68]) <= set(FACE.lips)
    assert_allclose(lips[0], FACE.mean[FACE.lips])
    assert np.ptp(lips[1, :, 1]) > np.ptp(lips[0, :, 1]) + 0.02


def test_a_model_is_written_and_read_with_its_licence(tmp_path):
    FaceModel(**{**vars(FACE), "licence_note": "mine", "name": "own"}).write(tmp_path / "own.h5")
    again = FaceModel.load(tmp_path / "own.h5")
    assert again.licence_note == "mine" and again.expression_names == COSPEECH64 and again.name == "own"
    assert_allclose(again.vertices(np.ones(64)), FACE.vertices(np.ones(64)))


RNG = np.random.default_rng(0)
MEAN = RNG.normal(size=(10, 3)) * [60, 80, 40]
IDENTITY, EXPRESSION, VARIANCE = RNG.normal(size=(30, 4)), RNG.normal(size=(30, 3)), np.array([4.0, 1.0, 0.25, 9.0])
TRIANGLES = np.array([[0, 1, 2], [7, 8, 9]])


def write_layout(kind, folder):
    """The same small face, in millimetres, as different projects would store it."""
    if kind == "npz":
        path = folder / "a.npz"
        np.savez(path, mean=MEAN, identity=IDENTITY * 2, expression=EXPRESSION, triangles=TRIANGLES)
    elif kind == "flame":
        path = folder / "b.npz"
        both = np.concatenate([np.zeros((10, 3, 300)), EXPRESSION.reshape(10, 3, 3)], axis=-1)
        both[..., :4] = 2 * IDENTITY.reshape(10, 3, 4)
        np.savez(path, v_template=MEAN, shapedirs=both, f=TRIANGLES)
    elif kind == "mat":
        path = folder / "c.mat"
        savemat(
            path,
            {
                "meanshape": MEAN.reshape(1, -1),
                "idBase": IDENTITY * 2,
                "exBase": EXPRESSION,
                "tri": TRIANGLES + 1,
                "keypoints": np.arange(68)[None] % 10 + 1,
            },
        )
    else:
        path = folder / "d.h5"
        with h5py.File(path, "w") as file:
            file["shape/model/mean"], file["shape/model/pcaBasis"] = MEAN.ravel() - 1, IDENTITY
            file["shape/model/pcaVariance"] = np.full(4, 4.0)
            file["expression/model/mean"], file["expression/model/pcaBasis"] = np.ones(30), EXPRESSION
            file["shape/representer/cells"] = TRIANGLES.T
    return path


@pytest.mark.parametrize("kind", ["npz", "flame", "mat", "h5"])
def test_usual_layouts_become_the_same_model(kind, tmp_path):
    model = convert(write_layout(kind, tmp_path), units="mm", licence="for research only")
    assert_allclose(model.mean, MEAN / 1000) and np.array_equal(model.triangles, TRIANGLES)
    assert_allclose(model.identity[..., :4].reshape(30, 4), 2 * IDENTITY / 1000)
    assert_allclose(model.expression.reshape(30, 3), EXPRESSION / 1000)
    assert "for research only" in model.licence_note and "sha256" in model.licence_note
    assert (model.landmarks >= 0).all() if kind == "mat" else (model.landmarks == -1).all()


def test_the_command_converts_and_says_so(tmp_path, capsys):
    (tmp_path / "marks.txt").write_text(", ".join(str(i % 10) for i in range(68)))
    given, made = str(write_layout("flame", tmp_path)), str(tmp_path / "own.h5")
    asked = ["face-model", given, "--out", made, "--licence", "research"]
    assert main([*asked, "--landmarks", str(tmp_path / "marks.txt")]) == 0
    model = FaceModel.load(made)
    assert "research" in model.licence_note and model.landmarks[11] == 1
    assert "10 vertices" in capsys.readouterr().out
    (tmp_path / "marks.txt").write_text("one two")
    assert main([*asked, "--landmarks", str(tmp_path / "marks.txt")]) == 2


def test_units_are_told_by_the_faces_height(tmp_path):
    model = convert(write_layout("npz", tmp_path))
    assert_allclose(model.mean, MEAN / 1000)


def broken(tmp_path, **change):
    arrays = {"mean": MEAN, "identity": IDENTITY, "expression": EXPRESSION, "triangles": TRIANGLES} | change
    np.savez(tmp_path / "x.npz", **{name: array for name, array in arrays.items() if array is not None})
    return tmp_path / "x.npz"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"identity": IDENTITY[:-1]}, "identity has shape \\(29, 4\\)"),
        ({"expression": None}, "no expression found"),
        ({"triangles": TRIANGLES + 5}, "beyond the model's 10"),
        ({"landmarks": np.arange(51)}, "51 landmarks"),
        ({"mean": np.array([{"a": 1}], dtype=object)}, "without unpickling"),
    ],
)
def test_a_model_that_does_not_fit_is_one_clear_line(change, says, tmp_path):
    with pytest.raises(CospeechError, match=says) as error:
        FaceModel.load(broken(tmp_path, **change))
    assert "\n" not in str(error.value)


def test_other_numbers_of_coefficients_are_one_clear_line():
    with pytest.raises(CospeechError, match="50 expression coefficients, it has 64"):
        FACE.lip_vertices(np.zeros((3, 50)))
    with pytest.raises(CospeechError, match="no such file"):
        FaceModel.load("nowhere.h5")
