"""`cospeech posenet prepare`: from owners' files to a store in which crops, 2D and 3D agree."""

import warnings

import numpy as np
import pytest

from cospeech import cli
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.posenet import EVALUATED, JOINTS17, JOINTS21, JOINTS28
from cospeech.posenet.datasets.lsp import LSP14
from cospeech.posenet.evaluation import pose_metrics as metrics
from cospeech.posenet.prepare import FEW, prepare
from cospeech.posenet.store import Store
from cospeech.posenet.training.augment import augment
from tests.posenet import owners


def quiet(*arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CospeechNotice)
        return prepare(*arguments, progress=False, **options)


@pytest.mark.parametrize("correction", ["none", "yaw", "full"])
def test_crops_show_the_joints_where_the_labels_say(tmp_path, correction):
    owners.write_3dhp_train(tmp_path / "data", owners.people(5, size=(480, 400), aside=300, radius=10))
    options = {"every": 1, "size": 160, "margin": 1.5, "correction": correction, "cameras": [0]}
    count, dropped = quiet("mpi_inf_3dhp_train", tmp_path / "data", tmp_path / "a.h5", **options)
    store = Store(tmp_path / "a.h5")
    assert count == len(store) == 5 and dropped == {} and store.size == 240
    assert store.attrs["correction"] == correction and "non-commercial" in store.attrs["licence_note"]
    for batch in (store[:], augment(store[:], np.random.default_rng(0), 160, margin=store.margin, colour=0, flip=0)):
        assert batch.visible.sum() > 40
        for image, points, visible in zip(batch.images, batch.joints2d, batch.visible, strict=True):
            assert owners.disc_error(image, points, visible) < 90


def test_targets_are_in_the_frame_of_a_camera_that_faces_the_person(tmp_path):
    """The person stands 25 degrees aside: corrected, picture and pose are those of a camera that is turned to it."""
    who = owners.people(3, size=(640, 240), aside=4000 * np.tan(np.radians(25)))
    who.camera[0, 0] = who.camera[1, 1] = 400.0
    who.points[:] = owners.project(who.poses, who.camera)
    rng = np.random.default_rng(0)
    who.images[:] = [owners.picture(p, JOINTS28, (640, 240), rng) for p in who.points]
    owners.write_3dhp_train(tmp_path / "data", who)
    quiet("mpi_inf_3dhp_train", tmp_path / "data", tmp_path / "a.h5", every=1, cameras=[0], scale="metric", size=240)
    batch = Store(tmp_path / "a.h5")[:]
    truth = who.relative[:, JOINTS28.joints(*JOINTS21.names)]
    assert metrics.mpjpe(batch.joints3d, truth) > 50  # turned against the camera's frame
    np.testing.assert_allclose(metrics.mpjpe(metrics.align(batch.joints3d, truth, "procrustes"), truth), 0, atol=0.05)
    heatmaps = JOINTS21.joints(*EVALUATED)
    for pose, points, visible in zip(batch.joints3d, batch.joints2d, batch.visible, strict=True):
        flat = pose[heatmaps][visible, :2]  # facing the person, image and pose have the same left, right, up and down
        assert min(np.corrcoef(flat[:, i], points[visible, i])[0, 1] for i in (0, 1)) > 0.99


def test_a_perfect_network_scores_perfectly_on_the_prepared_3dhp_test_set(tmp_path):
    """Activities, scenes and poses arrive together in the official tables."""
    for sequence in (1, 3, 5):
        who = owners.people(4, JOINTS17, seed=sequence)
        owners.write_3dhp_test(tmp_path / "data", who, sequence, activity=[1, 2, 7, sequence], valid=[1, 1, 1, 0])
    quiet("mpi_inf_3dhp_test", tmp_path / "data", tmp_path / "a.h5", correction="yaw", margin=1.0)
    batch = Store(tmp_path / "a.h5")[:]
    truth = batch.joints3d[:, :17]
    pred = truth + 0.0
    pred[batch.tags["sequence"] == "3"] *= 2  # and one scene is wrong
    scenes = metrics.scene_table(pred, truth, batch.tags["sequence"].astype(int))["unscaled"]
    assert scenes["GS"] == scenes["Outdoor"] == 100 and scenes["No GS"] < 100
    good = batch.tags["scene"] != "No GS"
    rows = metrics.activity_table(truth[good], truth[good], batch.tags["activity"][good].astype(int))
    assert set(rows) == {"Standing/Walking", "Exercising", "Miscellaneous", "All"}
    assert all(row["Total"] == 100 for row in rows.values())
    assert metrics.official(truth, truth)["MPJPE"] == 0
    assert not batch.labelled3d.any()  # hands and toes have no labels, so nobody trains on it by mistake


def test_too_few_joints_are_counted_and_told_by_the_command(tmp_path, capsys):
    who = owners.people(4, LSP14)
    who.points[2, 2:] = -100  # two joints are left
    owners.write_lsp(tmp_path / "data", who, np.ones((4, 14)))  # all hidden, all labelled
    (tmp_path / "data" / "images" / "im0004.jpg").write_bytes(b"")
    out = tmp_path / "lsp.h5"
    assert cli.main(["posenet", "prepare", "lsp", str(tmp_path / "data"), "--out", str(out), "--size", "64"]) == 0
    told = capsys.readouterr().out
    assert "2 samples of lsp" in told and f"left out 1: {FEW}" in told and "left out 1: image does not decode" in told
    assert Store(out).attrs["dropped"] == {FEW: 1, "image does not decode": 1}


def test_hands_and_faces_are_prepared_from_coco(tmp_path):
    rng = np.random.default_rng(0)
    keypoints = lambda n: np.column_stack([rng.uniform(20, 100, (n, 2)), np.full(n, 2)]).ravel().tolist()
    annotation = {
        "id": 1,
        "image_id": 7,
        "righthand_valid": True,
        "righthand_kpts": keypoints(21),
        "lefthand_valid": True,
        "lefthand_kpts": keypoints(21),
        "face_valid": True,
        "face_kpts": keypoints(68),
    }
    owners.write_coco(tmp_path / "data", [annotation], {7: rng.integers(0, 255, (150, 200, 3), np.uint8)})
    for part, count, joints in (("hand", 2, 21), ("face", 1, 68)):
        quiet("coco_wholebody", tmp_path / "data", tmp_path / f"{part}.h5", part=part, size=64)
        batch = Store(tmp_path / f"{part}.h5")[:]
        assert batch.joints2d.shape == (count, joints, 2) and batch.visible.all() and not batch.labelled3d.any()


def test_wrong_requests_are_told_in_one_line(tmp_path, capsys):
    assert cli.main(["posenet", "prepare", "lsp", str(tmp_path), "--out", str(tmp_path / "a.h5"), "--every", "2"]) == 2
    assert "lsp: has no option 'every'" in capsys.readouterr().err
    for options, line in [
        ({"part": "hand"}, "lsp: has no hand to prepare"),
        ({"part": "foot"}, "part 'foot' is unknown"),
        ({"correction": "pitch"}, "perspective correction 'pitch' is unknown"),
        ({"margin": 0.5}, "margin 0.5: expected"),
    ]:
        with pytest.raises(CospeechError, match=line):
            quiet("lsp", tmp_path, tmp_path / "a.h5", **options)
    assert not list(tmp_path.iterdir())
