"""Films of the virtual speaker show what was true, and what capture makes of them is measured rightly."""

import csv
from dataclasses import replace

import av
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cospeech.demo import read_take, write_take
from cospeech.demo.film import SETTINGS, build_set, draw_take, film_take
from cospeech.demo.take import read_motion
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.evaluation.annotation import EXPRESSIONS, HEADINGS, annotation_errors, judge_learning, write_errors
from cospeech.evaluation.metrics.fgd import Settings, train_feature_net
from cospeech.face.expressions import COSPEECH64
from cospeech.skeleton import RIGHT_HAND, UPPER55

SECONDS, SIZE = 5.0, (160, 120)


@pytest.fixture(scope="module")
def take(tmp_path_factory):
    """Sound and truth of a short take."""
    folder = tmp_path_factory.mktemp("film")
    files = {"wav": folder / "take.wav", "truth": folder / "take.h5"}
    write_take("lively", 0, seconds=SECONDS, seed=3, **files)
    return files


@pytest.fixture(scope="module")
def truth(take):
    return read_take(take["truth"], take["wav"], subject="lively", clip="take")


@pytest.mark.parametrize("domain", ["studio", "wild"])
def test_a_film_has_every_frame_and_the_voice(take, tmp_path, domain):
    paths = [tmp_path / name for name in ("once.mp4", "again.mp4")]
    for path in paths:
        film_take(path, domain=domain, size=SIZE, **take)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    with av.open(str(paths[0])) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        voice = film.streams.audio[0]
        assert float(voice.duration * voice.time_base) == pytest.approx(SECONDS, abs=0.05)
    assert len(pictures) == 75 and pictures[0].shape == (120, 160, 3)


def seen(take, number, count=6, domain="studio"):
    """Pictures of the film of a take as if it were number `number`, the same without anybody, and where joints are."""
    motion = [array[:count] for array in read_motion(take["truth"], take["wav"], 15.0)[:3]]
    stage = build_set("lively", number, 3, domain, SIZE)
    pictures = list(draw_take(*motion, stage, "lively"))
    away = [motion[0] + [0.0, 50.0, 0.0], *motion[1:]]
    empty = list(draw_take(*away, stage, "lively"))
    space, camera = stage.see(motion[0]), stage.camera
    across = space[..., :2] / space[..., 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    return np.array(pictures, int), np.array(empty, int), across


def test_joints_are_where_they_are_drawn(take):
    """At the pixel of every joint that the picture shows there is somebody; far from all of them there is nobody."""
    pictures, empty, pixels = seen(take, SETTINGS.index("plain"))
    changed = np.abs(pictures - empty).max(axis=-1) > 8
    inside = ((pixels >= 0) & (pixels <= (SIZE[0] - 1, SIZE[1] - 1))).all(axis=-1)
    trunk = UPPER55.joints("head", "neck", "spine", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow")
    assert inside[:, trunk].all()
    for t in range(len(pictures)):
        u, v = pixels[t, inside[t]].round().astype(int).T
        assert changed[t, v, u].mean() > 0.97
    assert not changed[:, :, :8].any()


def test_settings_differ_as_they_say(take):
    *_, low = seen(take, SETTINGS.index("plain"))
    *_, near = seen(take, SETTINGS.index("close"))
    hips = UPPER55.joints("left_hip", "right_hip")
    assert (low[:, hips, 1] < SIZE[1]).all() and (near[:, hips, 1] > SIZE[1]).all()
    head = np.linalg.norm(near[:, 0] - near[:, 1], axis=-1) / np.linalg.norm(low[:, 0] - low[:, 1], axis=-1)
    assert (head > 1.3).all()  # a third larger
    for setting, somebody in (("plain", False), ("company", True)):
        pictures, empty, pixels = seen(take, SETTINGS.index(setting))
        beside = slice(round(pixels[..., 0].max()) + 12, None)
        assert (np.abs(pictures - empty).max(axis=-1)[:, :, beside] > 8).any() == somebody


def test_another_domain_is_refused(take, tmp_path):
    with pytest.raises(CospeechError, match="moon"):
        film_take(tmp_path / "film.mp4", domain="moon", **take)


def errors_of(clip, truth):
    return {error.part: error for error in annotation_errors({"take": clip}, {"take": truth})}


def test_known_errors_are_measured(truth):
    """Joints moved by 30 mm, a head turned by 10 degrees, an expression turned upside down, fingers not seen."""
    clear = errors_of(truth, truth)
    assert all(error.median == 0 for part, error in clear.items() if not part.startswith("expression"))
    assert all(clear[part].median == pytest.approx(1) for part in EXPRESSIONS)
    positions, confidence = truth.positions.copy(), truth.confidence.copy()
    positions[:, UPPER55.joints("left_wrist", "right_wrist")] += [0.0, 0.03, 0.0]
    positions[:, RIGHT_HAND] += [0.1, 0.0, 0.0]  # the hand as a whole: no error of a hand that is judged by its wrist
    confidence[: truth.frames // 5, RIGHT_HAND] = 0
    turned = (Rotation.from_rotvec(truth.rotation) * Rotation.from_euler("X", 10, degrees=True)).as_rotvec()
    clip = replace(
        truth,
        positions=positions,
        confidence=confidence,
        rotation=turned.astype(np.float32),
        expression=1 - truth.expression,
    )
    found = errors_of(clip, truth)
    assert found["wrists"].median == pytest.approx(30, abs=0.01) and found["elbows"].median == 0
    assert found["right hand"].median == pytest.approx(0, abs=0.01)
    assert found["right hand"].excluded == pytest.approx(0.2) and found["left hand"].excluded == 0
    assert found["head rotation"].median == pytest.approx(10, abs=0.01)
    assert all(found[part].median == pytest.approx(-1) for part in EXPRESSIONS)
    expression = truth.expression.copy()
    expression[:, COSPEECH64.index("jaw_open")] *= -1  # the jaw alone is wrong
    found = errors_of(replace(truth, expression=expression), truth)
    assert [round(found[part].median) for part in EXPRESSIONS] == [1, 1, -1]


def test_an_annotation_of_another_length_is_an_error(truth):
    with pytest.raises(CospeechError, match="take"):
        annotation_errors({"take": truth.section(0, 20)}, {"take": truth})


def test_a_perfect_annotation_loses_nothing(toy_clips):
    """Where the annotation is the truth, the rows of both are equal; films that show nothing are told and have none."""
    truth = {clip.clip: clip for clip in toy_clips}
    split = {"train": list(truth)[:2], "test": list(truth)[2:]}
    train = [truth[name] for name in split["train"]]
    feature_net, _ = train_feature_net(train, replace(Settings(), steps=3, batch=4))
    rows = {e.row: e for e in judge_learning(truth, truth, split, {}, feature_net)}
    for one, other in (("ground_truth", "annotation"), ("knn_from_truth", "knn_from_films")):
        np.testing.assert_array_equal(rows[one].mean, rows[other].mean)
    assert not np.array_equal(rows["annotation"].mean, rows["knn_from_truth"].mean)
    blind = {name: replace(clip, valid=np.zeros(clip.frames, bool)) for name, clip in truth.items()}
    with pytest.warns(CospeechNotice, match="no row knn_from_films"):
        found = judge_learning(blind, truth, split, {}, feature_net)
    assert [e.row for e in found] == ["ground_truth", "mean_pose", "annotation", "knn_from_truth"]


def test_the_table(truth, tmp_path):
    write_errors(tmp_path / "table.csv", {"ada": annotation_errors({"take": truth}, {"take": truth})})
    with open(tmp_path / "table.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == HEADINGS
    assert [row["median"] for row in rows if row["part"] in ("body", "hands", "expression")] == ["0", "0", "1"]
