"""The onnx tracker on small graphs: dots that move through a film are found where they were drawn."""

import shutil

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from cospeech.capture.film.decoding import open_film
from cospeech.capture.trackers.crops import Crop, crop_about
from cospeech.capture.trackers.manifest import read_manifest
from cospeech.capture.trackers.onnx_network import OnnxTracker, _turned, posenet_trackers
from cospeech.capture.trackers.registry import run_trackers
from cospeech.errors import CospeechError
from cospeech.track import Camera, Points, Track
from tests.capture.films import write_film
from tests.capture.networks import constant_network, dots, simcc_network

SIZE = (96, 128)
STEPS = np.arange(12)[:, None]
# three dots that move apart and across the picture
PLACES = np.stack([50 + STEPS * [2, 1], 90 + STEPS * [3, -1], 60 + STEPS * [1, 3]], axis=1).astype(float)


def write_manifest(path, **changes):
    content = {
        "name": "dots",
        "model": "dots.onnx",
        "licence_note": "test",
        "input": {"size": list(SIZE), "scale": 1 / 255},
        "crop": {"margin": 1.6, "least_score": 0.2},
        "codec": {"kind": "simcc2d", "x": "simcc_x", "y": 1},
        "parts": {"body": {"skeleton": "dots3", "first": 0}},
    }
    path.write_text(yaml.safe_dump(content | changes), encoding="utf-8")
    return path


@pytest.fixture
def film(tmp_path):
    return open_film(write_film(tmp_path / "film.mp4", dots(PLACES)))


def dotted(tmp_path, **changes):
    """A tracker of the body's first three points: the nose red, left eye green, right eye blue, and so on."""
    simcc_network(tmp_path / "dots.onnx", SIZE, points=23)
    parts = {"body": {"skeleton": "coco23", "first": 0}}
    return OnnxTracker(write_manifest(tmp_path / "dots.yaml", **{"parts": parts} | changes))


def test_dots_are_followed_through_the_film(tmp_path, film):
    track = run_trackers(film, dotted(tmp_path))
    assert track.body.observed.all() and track.body.xyz is None and track.backend == "onnx"
    np.testing.assert_allclose(track.body.xy[:, :3], PLACES, atol=1.0)
    np.testing.assert_allclose(track.body.xy[:, 3:6], PLACES, atol=1.0)
    assert (track.licence_note, track.backend_version, len(track.model_sha256)) == ("test", "dots", 64)


def test_the_box_follows_into_a_corner_of_a_large_picture(tmp_path):
    places = PLACES + [700, 420] + STEPS[:, None] * [8, 6]
    film = open_film(write_film(tmp_path / "large.mp4", dots(places, 640, 960, radius=8)))
    track = run_trackers(film, dotted(tmp_path))
    assert track.body.observed.all()
    np.testing.assert_allclose(track.body.xy[:, :3], places, atol=2.0)


def test_pictures_that_trackers_see_smaller_are_answered_in_full_pixels(tmp_path):
    places = PLACES * 10
    film = open_film(write_film(tmp_path / "large.mp4", dots(places, 1200, 1600, radius=20)))
    assert film.size() == (1280, 960)
    track = run_trackers(film, dotted(tmp_path))
    assert (track.width, track.height) == (1600, 1200)
    np.testing.assert_allclose(track.body.xy[:, :3], places, atol=8)


def shrinking(tmp_path, film, hidden):
    """Sizes (F, 2) of what a network sees that has the body in the middle half of any crop and a point at `hidden`."""
    points = np.tile([[0.25, 0.25], [0.75, 0.75]], (12, 1))[:23]
    points[22] = hidden
    constant_network(tmp_path / "dots.onnx", SIZE, points=points)
    codec = {"kind": "direct", "points": "points", "columns": ["x", "y"], "unit": "unit"}
    parts = {"body": {"skeleton": "coco23", "first": 0}}
    crop = {"margin": 1.0, "least_score": 0.2}
    tracker = OnnxTracker(write_manifest(tmp_path / "dots.yaml", codec=codec, parts=parts, crop=crop))
    body = tracker.track(film, film.pictures(), {})["body"]
    return np.where(body.observed[:, None], np.ptp(body.xy[:, :2], axis=1), np.nan)


def test_imagined_points_beyond_the_picture_do_not_widen_the_box(tmp_path, film):
    inside, beyond = (shrinking(tmp_path, film, point) for point in ([0.5, 0.5], [0.5, 1000.0]))
    np.testing.assert_array_equal(inside, beyond)


def test_a_body_that_shrinks_to_nothing_is_lost_and_looked_for_anew(tmp_path, film):
    """The box halves again and again until it is absurd; then the whole picture is searched."""
    sizes = shrinking(tmp_path, film, [0.5, 0.5]).max(axis=1)
    assert np.nanmin(sizes) >= 0.03 * film.width and np.isnan(sizes).any()
    lost = np.flatnonzero(np.isnan(sizes))[0]
    assert (np.diff(sizes[:lost]) < 0).all() and sizes[lost + 1] == pytest.approx(sizes[0])


def test_nobody_in_the_film_is_said(tmp_path):
    film = open_film(write_film(tmp_path / "black.mp4", dots(PLACES) * 0))
    with pytest.raises(CospeechError, match="no person"):
        run_trackers(film, dotted(tmp_path))


def test_the_whole_body_comes_apart_as_coco_wholebody_orders_it(tmp_path, film):
    """RTMW's shipped manifest with a graph of RTMW's outputs: 133 points, the channels over and over."""
    simcc_network(tmp_path / "rtmw.onnx", (288, 384), points=133, batch=1)
    tracker = OnnxTracker(read_manifest("rtmw", tmp_path / "rtmw.onnx"))
    track = run_trackers(film, tracker)
    starts = {"body": 0, "face_landmarks": 23, "left_hand": 91, "right_hand": 112}
    assert {part: len(points.table) for part, points in track.parts.items()} == {
        "body": 23,
        "face_landmarks": 68,
        "left_hand": 21,
        "right_hand": 21,
    }
    for part, first in starts.items():
        point = track.parts[part].xy[:, 0]
        np.testing.assert_allclose(point, PLACES[:, first % 3], atol=1.0, err_msg=part)


def test_rtmw3d_in_space(tmp_path, film):
    """Back-projected with its authors' camera: f = (1145.05, 1143.78), hips at 5.14388 m, centre of the picture."""
    bins = np.full(133, 288)
    bins[0] = 288 + 144
    simcc_network(tmp_path / "rtmw3d.onnx", (288, 384), points=133, depth_bins=bins)
    body = run_trackers(film, OnnxTracker(read_manifest("rtmw3d", tmp_path / "rtmw3d.onnx"))).body
    assert (body.space, body.metric) == ("camera", True)
    depth = 5.14388 + 1.08724345
    across = (body.xy[:, 0] - (80, 60)) / (1145.05, 1143.78) * depth
    np.testing.assert_allclose(body.xyz[:, 0], np.column_stack([across, np.full(12, depth)]), atol=1e-4)
    np.testing.assert_allclose(body.xyz[:, 5, 2], 5.14388, atol=1e-4)


def test_a_face_is_looked_at_where_the_body_has_it(tmp_path, film):
    values = np.arange(257) / 1000
    values[224:227] = [0.1, -0.2, 0.3]
    constant_network(tmp_path / "deep.onnx", (224, 224), coefficients=values)
    face = OnnxTracker(read_manifest("deep3dfacerecon", tmp_path / "deep.onnx"))
    body = dotted(tmp_path)
    track = run_trackers(film, {"body": body, "face": face})
    np.testing.assert_allclose(track.face.expression, np.tile(values[80:144], (12, 1)), atol=1e-6)
    matrix = Rotation.from_euler("z", 0.3) * Rotation.from_euler("y", -0.2) * Rotation.from_euler("x", 0.1)
    np.testing.assert_allclose(track.face.rotation, np.tile(matrix.as_rotvec(), (12, 1)), atol=1e-6)
    assert track.face.model == "deep3dfacerecon64" and (track.face.score == 1).all()
    with pytest.raises(CospeechError, match="needs to know where the body is"):
        run_trackers(film, face)


def body_with(**places):
    """A body's `Points` over 12 frames, with some points at given pixels (2,) or (12, 2)."""
    body = Points.empty("coco23", 12, depth=False)
    body.observed[:] = True
    for name, place in places.items():
        body.xy[:, body.table.index[name]] = place
    return body


@pytest.mark.parametrize("off", [0, 110, -110])
def test_a_hand_is_found_beside_a_rough_wrist(tmp_path, off):
    """The body's wrist is off by up to three quarters of the shoulders; the hand is not in the first crop."""
    places = PLACES + np.array([300, 200])
    film = open_film(write_film(tmp_path / "film.mp4", dots(places, 480, 640, radius=6)))
    simcc_network(tmp_path / "dots.onnx", SIZE, points=21)
    parts = {"left_hand": {"skeleton": "hand21", "first": 0}}
    tracker = OnnxTracker(write_manifest(tmp_path / "dots.yaml", parts=parts))
    wrist = places.mean(axis=1) + np.array([off, off / 4])
    left, right = wrist - np.array([0, 120]), wrist - np.array([150, 120])
    arm = {"left_shoulder": left, "right_shoulder": right, "right_elbow": right, "left_elbow": wrist}
    seen = {"body": body_with(**arm, left_wrist=wrist)}
    hand = tracker.track(film, film.pictures(), seen)["left_hand"]
    assert hand.observed.all()
    np.testing.assert_allclose(hand.xy[:, :3], places, atol=2.0)


@pytest.mark.parametrize(("height", "there"), [(60, True), (100, True), (119, False), (160, False)])
def test_a_hand_below_the_picture_is_not_seen(tmp_path, film, height, there):
    """A network that has a hand in the middle half of whatever it is shown; the picture is 120 pixels high."""
    points = np.tile([[0.25, 0.25], [0.75, 0.75], [0.5, 0.5]], (7, 1))
    constant_network(tmp_path / "dots.onnx", SIZE, points=points)
    codec = {"kind": "direct", "points": "points", "columns": ["x", "y"], "unit": "unit"}
    parts = {"left_hand": {"skeleton": "hand21", "first": 0}}
    tracker = OnnxTracker(write_manifest(tmp_path / "dots.yaml", codec=codec, parts=parts))
    wrist = [80, height]
    seen = {"body": body_with(left_shoulder=[110, 10], right_shoulder=[50, 10], left_elbow=wrist, left_wrist=wrist)}
    assert (tracker.track(film, film.pictures(), seen)["left_hand"].observed == there).all()


def test_parts_come_from_different_trackers(tmp_path, film):
    simcc_network(tmp_path / "rtmw.onnx", (288, 384), points=133)
    whole = OnnxTracker(read_manifest("rtmw", tmp_path / "rtmw.onnx"))
    track = run_trackers(film, {"body": dotted(tmp_path), "left_hand": whole})
    assert set(track.parts) == {"body", "left_hand"} and track.backend_version == "dots; RTMW"
    with pytest.raises(CospeechError, match="does not see right_hand"):
        run_trackers(film, {"right_hand": dotted(tmp_path)})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"codec": {"kind": "magic"}}, ["codec kind", "magic", "simcc3d"]),
        ({"parts": {"foot": {"skeleton": "coco23", "first": 0}}}, ["foot", "left_hand"]),
        ({"model": "gone.onnx"}, ["gone.onnx", "no such file"]),
        ({"sha256": "00"}, ["another file", "sha256"]),
        ({"input": {"scale": 1}}, ["size"]),
        ({"input": {"size": [4, 4], "layout": "CHW"}}, ["layout", "CHW"]),
    ],
)
def test_mistakes_in_a_manifest(tmp_path, changes, words):
    simcc_network(tmp_path / "dots.onnx", SIZE)
    with pytest.raises(CospeechError) as error:
        read_manifest(write_manifest(tmp_path / "m.yaml", **changes))
    assert all(word in str(error.value) for word in words) and "m.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_files_that_are_no_networks(tmp_path, film):
    (tmp_path / "dots.onnx").write_text("no network")
    with pytest.raises(CospeechError, match="not a readable ONNX"):
        OnnxTracker(write_manifest(tmp_path / "m.yaml", parts={"body": {"skeleton": "coco23", "first": 0}}))
    with pytest.raises(CospeechError, match="neither a manifest"):
        read_manifest("rtmw4d")
    simcc_network(tmp_path / "dots.onnx", (32, 32), points=23)
    parts = {"body": {"skeleton": "coco23", "first": 0}}
    tracker = OnnxTracker(write_manifest(tmp_path / "m.yaml", parts=parts))
    with pytest.raises(CospeechError, match="does not run as its manifest says"):
        run_trackers(film, tracker)


def test_crops_and_their_way_back():
    """A picture whose colours are its coordinates: every pixel of a crop says where it came from."""
    rows, columns = np.mgrid[:200, :250]
    picture = np.stack([columns, rows, 0 * rows], -1).astype(np.uint8)
    for flipped in (False, True):
        crop = crop_about(np.array([120.0, 90.0, 60.0, 50.0]), 1.25, (48, 64), flipped)
        cut = crop.cut(picture).astype(float)
        grid = np.stack(np.meshgrid(np.arange(48), np.arange(64)), -1)
        np.testing.assert_allclose(cut[..., :2], crop.to_picture(grid), atol=1.0)
    assert crop.size[0] / crop.size[1] == pytest.approx(48 / 64)
    outside = Crop(np.array([-500.0, 20.0]), np.array([40.0, 40.0]), (16, 16))
    assert not outside.cut(picture).any()


def test_poses_are_turned_from_the_crops_camera_into_the_films(tmp_path):
    """Straight ahead of the camera that looks at the crop is along the ray to its centre."""
    picture = np.zeros((480, 640, 3), np.uint8)
    camera = Camera.assumed(640, 480)
    for centre in ((320.0, 240.0), (600.0, 100.0), (50.0, 400.0)):
        crop = Crop(np.array(centre), np.array([100.0, 100.0]), (64, 64))
        ray = np.array([(centre[0] - camera.cx) / camera.fx, (centre[1] - camera.cy) / camera.fy, 1])
        np.testing.assert_allclose(_turned(np.eye(3)[[2]], crop, picture)[0], ray / np.linalg.norm(ray), atol=1e-6)
        level = _turned(np.eye(3)[[0]], crop, picture)[0]
        assert level[1] == pytest.approx(0, abs=1e-6)  # the horizon stays level


def test_our_own_networks_are_one_more_manifest(tmp_path):
    """What the pose network's export writes: body from the whole picture, each hand about its wrist, left mirrored."""
    from cospeech.posenet.network import DESIGNS
    from cospeech.posenet.onnx_export import manifest_of

    rng = np.random.default_rng(0)
    truth = {}
    for part in ("body", "hand"):
        design = DESIGNS[part]
        count, maps = len(design.joints), np.full((len(design.heatmaps), 4, 4), 0.8)
        points, pose = rng.uniform(-0.5, 0.5, (count, 2)), rng.normal(size=(count, 3)) * 300
        truth[part] = points, pose
        model = tmp_path / "posenet" / part / "model.onnx"
        model.parent.mkdir(parents=True)
        constant_network(model, (design.input,) * 2, points=points, pose=pose, heatmaps=maps)
        manifest = manifest_of(design, {"part": part, "licence_note": "test"}, model)
        model.with_name("manifest.yaml").write_text(yaml.safe_dump(manifest), encoding="utf-8")
    trackers = posenet_trackers(tmp_path / "posenet")
    assert list(trackers) == ["body", "left_hand", "right_hand"]
    track = run_trackers(open_film(write_film(tmp_path / "film.mp4", dots(PLACES[:3]))), trackers)
    track.write(tmp_path / "track.h5")
    back = Track.read(tmp_path / "track.h5")
    body, left, right = back.body, back.left_hand, back.right_hand
    assert back.backend == "posenet" and body.metric and (body.space, left.space) == ("root", "wrist")
    lengths = np.linalg.norm(truth["body"][1], axis=1) / 1000  # millimetres there, metres here; a turn keeps lengths
    np.testing.assert_allclose(np.linalg.norm(body.xyz[0], axis=1), lengths, rtol=1e-5)
    centred = lambda xy: (xy - xy.mean(axis=0)) / np.ptp(xy, axis=0).max()
    hand = centred(truth["hand"][0])
    np.testing.assert_allclose(centred(body.xy[0]), centred(truth["body"][0]), atol=1e-5)
    np.testing.assert_allclose(centred(right.xy[0]), hand, atol=1e-5)
    np.testing.assert_allclose(centred(left.xy[0]), hand * [-1, 1], atol=1e-5)
    shutil.rmtree(tmp_path / "posenet" / "body")
    with pytest.raises(CospeechError, match=r"manifest.yaml: cannot be read"):
        posenet_trackers(tmp_path / "posenet")
