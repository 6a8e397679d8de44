"""Export and prediction: ONNX equals torch, the manifest tells the truth, poses land where the person is."""

import csv
import hashlib

import cv2
import h5py
import numpy as np
import pytest
import torch
import yaml

from cospeech.cli import main
from cospeech.errors import CospeechError
from cospeech.posenet import JOINTS21
from cospeech.posenet.camera import camera_matrix
from cospeech.posenet.draw import SIDES, draw_pose
from cospeech.posenet.network import DESIGNS
from cospeech.posenet.onnx_export import load_network
from cospeech.posenet.predict import PosePredictor, assumed_camera, box_of
from tests.posenet.conftest import POSE, SIZE

# ---- export ---------------------------------------------------------------------------------------------------------


def test_onnx_computes_what_torch_does_for_any_number_of_crops(random_model):
    crops = np.random.default_rng(0).integers(0, 256, (5, SIZE, SIZE, 3), np.uint8)
    network, description = load_network(random_model.with_name("weights.safetensors"))
    with torch.inference_mode():
        output = network(torch.from_numpy(crops).permute(0, 3, 1, 2).float() / 255)
    for count in (1, 5):
        found = PosePredictor(random_model, threads=1).predict(crops[:count])
        np.testing.assert_allclose(found.joints3d / 1000, output.pose[:count].numpy(), atol=1e-4)
        pixels = ((output.points[:count].numpy() + 1) * SIZE - 1) / 2
        np.testing.assert_allclose(found.joints2d, pixels, atol=1e-3)
    assert description["licence_note"] == PosePredictor(random_model).licence_note == "for tests alone"


def test_manifest_says_what_the_file_is(random_model):
    manifest = yaml.safe_load(random_model.with_name("manifest.yaml").read_text())
    assert manifest["sha256"] == hashlib.sha256(random_model.read_bytes()).hexdigest()
    assert manifest["model"] == "model.onnx" and manifest["part"] == "body"
    assert manifest["input"]["size"] == [SIZE, SIZE] and manifest["input"]["range"] == [0.0, 1.0]
    assert tuple(manifest["skeleton"]["joints"]) == JOINTS21.names and manifest["licence_note"] == "for tests alone"
    assert str(random_model.parent) not in random_model.with_name("manifest.yaml").read_text()
    assert str(random_model.parent).encode() not in random_model.read_bytes()


def test_hands_are_answered_in_millimetres_too(constant_hand):
    predictor = PosePredictor(constant_hand, threads=1)
    found = predictor.predict(np.zeros((1, SIZE, SIZE, 3), np.uint8)).joints3d[0]
    np.testing.assert_allclose(found, 100 * (POSE - POSE[0]), rtol=1e-4, atol=1e-3)  # a unit is 10 cm
    assert predictor.part == "hand" and predictor.joints[0] == "hand_root"


def test_a_network_of_another_kind_is_one_line(tmp_path):
    (tmp_path / "model.onnx").write_bytes(b"no network")
    with pytest.raises(CospeechError, match=r"model.onnx: not a readable ONNX"):
        PosePredictor(tmp_path / "model.onnx")
    with pytest.raises(CospeechError, match=r"gone.onnx: no such file"):
        PosePredictor(tmp_path / "gone.onnx")


# ---- prediction -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def known(constant_model):
    """A predictor that sees `POSE` in every crop."""
    return PosePredictor(constant_model, threads=1)


def test_a_person_in_the_middle_is_where_the_box_is(known):
    image = np.zeros((100, 200, 3), np.uint8)
    found = known.predict_images([image], [[80, 30, 120, 70]], [camera_matrix(1000.0, 200, 100)], margin=1.5)
    np.testing.assert_allclose(found.joints3d[0, :2], 1000 * POSE[:2], atol=0.1)
    # half the crop's side, 1.5 * 40 / 2 = 30 pixels, for a value of 1
    np.testing.assert_allclose(found.joints2d[0, [14, 1]], [[100, 50], [115, 57.5]], atol=0.05)


def test_a_person_off_axis_is_turned_back_to_the_cameras_axes(known):
    camera = camera_matrix(200.0, 400, 100)
    image, center = np.zeros((100, 400, 3), np.uint8), 200 + 200 * np.tan(np.radians(25))
    found = known.predict_images([image], [[center - 1, 49, center + 1, 51]], [camera])
    expected = 1000 * np.array([np.sin(np.radians(25)), 0, np.cos(np.radians(25))])
    np.testing.assert_allclose(found.joints3d[0, 0], expected, atol=0.5)
    np.testing.assert_allclose(found.joints2d[0, 14], [center, 50], atol=0.1)


def test_left_hands_are_seen_in_a_mirror(known):
    image = np.zeros((100, 200, 3), np.uint8)
    found = known.predict_images([image] * 2, [[80, 30, 120, 70]] * 2, mirrored=[False, True])
    np.testing.assert_allclose(found.joints3d[1, :2], found.joints3d[0, :2] * [-1, 1, 1], atol=0.1)
    np.testing.assert_allclose(found.joints2d[1, 1, 0] + found.joints2d[0, 1, 0], 200, atol=0.1)


def test_box_of_joints_is_the_next_box(known):
    image = np.zeros((100, 200, 3), np.uint8)
    found = known.predict_images([image], [[80, 30, 120, 70]])
    assert box_of(found.joints2d).shape == (1, 4)
    np.testing.assert_allclose(box_of(np.array([[[3, 9], [5, 1.0]]])), [[3, 1, 5, 9]])
    assert known.predict_images([image], None).joints2d.shape == (1, 21, 2)
    assert known.predict_images([], np.zeros((0, 4))).joints3d.shape == (0, 21, 3)


def test_joints_without_a_heatmap_take_the_score_of_their_neighbours(known):
    spread = known._spread
    names, maps = JOINTS21.names, list(DESIGNS["body"].heatmaps)
    share = lambda joint: {maps[k] for k in np.flatnonzero(spread[names.index(joint)])}
    assert share("right_wrist") == {"right_wrist"} == share("right_hand")
    assert share("pelvis") == {"right_hip", "left_hip"} and share("left_toe") == {"left_ankle"}
    np.testing.assert_allclose(spread.sum(axis=1), 1)


def test_assumed_camera_sees_53_degrees():
    k = assumed_camera(640, 480)
    assert np.degrees(2 * np.arctan(320 / k[0, 0])) == pytest.approx(53.13, abs=0.01)


# ---- the command ----------------------------------------------------------------------------------------------------


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for name, shape in {"b.png": (60, 80, 3), "a.jpg": (90, 50, 3)}.items():
        cv2.imwrite(str(folder / name), np.full(shape, 120, np.uint8))
    (folder / "broken.jpg").write_bytes(b"\xff\xd8 no image")
    (folder / "empty.png").touch()
    (folder / "notes.txt").write_text("not an image")
    return folder


def test_predict_uses_what_decodes_and_counts_the_rest(photos, random_model, tmp_path, capsys):
    out = tmp_path / "out"
    assert (
        main(["posenet", "predict", str(photos), "--model", str(random_model), "--out", str(out), "--threads", "1"])
        == 0
    )
    said = capsys.readouterr()
    assert "2 images, 2 left out" in said.out
    assert all(f"{name}: does not decode" in said.err for name in ("broken.jpg", "empty.png"))
    assert sorted(path.name for path in out.iterdir()) == ["a.jpg.png", "b.png.png", "poses.csv", "poses.h5"]
    assert cv2.imread(str(out / "b.png.png")).shape == (60, 80 + 2 * 60, 3)
    with open(out / "poses.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    with h5py.File(out / "poses.h5") as file:
        assert file["image"].asstr()[:].tolist() == ["a.jpg", "b.png"]
        assert file["joints3d"].shape == (2, 21, 3) and file.attrs["licence_note"] == "for tests alone"
        assert float(rows[22]["z [mm]"]) == pytest.approx(file["joints3d"][1, 1, 2], abs=0.01)
    assert len(rows) == 42 and rows[22]["joint"] == JOINTS21.names[1]


def test_predict_draws_the_joints_where_they_are(known, tmp_path):
    image = np.zeros((100, 100, 3), np.uint8)
    points = np.full((21, 2), 50.0)
    points[4] = [80, 20]  # right wrist
    picture = draw_pose(image, points, POSE * 1000, known.joints, known.parents)
    assert picture.shape == (100, 300, 3) and tuple(picture[20, 80]) == SIDES["right"]
    assert not image.any()  # the given one is not drawn into


@pytest.mark.parametrize(
    ("source", "words"),
    [("gone", "no such file or folder"), ("photos/notes", "no image in it"), ("photos/broken.jpg", "no image in it")],
)
def test_predict_names_what_it_cannot_use(photos, random_model, tmp_path, source, words, capsys):
    (photos / "notes").mkdir()
    arguments = ["--model", str(random_model), "--out", str(tmp_path / "out")]
    assert main(["posenet", "predict", str(tmp_path / source), *arguments]) == 2
    assert words in capsys.readouterr().err and not (tmp_path / "out").exists()
