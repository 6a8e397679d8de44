"""Data sets of people, from files in their owners' formats: what was written comes back, under the right names."""

import numpy as np
import pytest

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.posenet import EVALUATED, JOINTS17, JOINTS21, JOINTS28
from cospeech.posenet.camera import project
from cospeech.posenet.datasets import open_dataset, parts
from cospeech.posenet.datasets.coco_wholebody import COCO_HAND21
from cospeech.posenet.datasets.h36m import H36M17, H36M32, action_name
from cospeech.posenet.datasets.lsp import LSP14
from cospeech.posenet.datasets.mpi_inf_3dhp import read_calibration
from cospeech.posenet.datasets.mpii import MPII16
from cospeech.skeleton import RIGHT_HAND, UPPER55
from tests.posenet import owners

INDEX28 = [7, 5, 14, 15, 16, 9, 10, 11, 23, 24, 25, 18, 19, 20, 4, 3, 6, 17, 12, 27, 22]  # of the 21, as published


def expected3d(who, skeleton, names):
    return who.relative[:, skeleton.joints(*names)]


# ---- joint sets -----------------------------------------------------------------------------------------------------


def test_h36m_has_the_published_parents_and_the_published_17():
    parents = [
        -1,
        0,
        1,
        2,
        3,
        4,
        0,
        6,
        7,
        8,
        9,
        0,
        11,
        12,
        13,
        14,
        12,
        16,
        17,
        18,
        19,
        20,
        19,
        22,
        12,
        24,
        25,
        26,
        27,
        28,
    ]
    assert list(H36M32.parents) == [*parents, 27, 30]
    published = [0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27]
    assert H36M32.joints(*H36M17.names) == published


def test_2d_sets_stand_in_their_owners_order():
    assert MPII16.joints(*EVALUATED) == [9, 8, 12, 11, 10, 13, 14, 15, 2, 1, 0, 3, 4, 5]
    assert LSP14.joints(*EVALUATED) == [13, 12, 8, 7, 6, 9, 10, 11, 2, 1, 0, 3, 4, 5]
    assert COCO_HAND21.joints("thumb_3", "index_3", "middle_3", "ring_3", "little_3") == [4, 8, 12, 16, 20]


def test_every_set_and_part_has_two_sides():
    assert {name: (len(part.heatmaps), len(part.skeleton)) for name, part in parts.PARTS.items()} == {
        "body": (14, 21),
        "hand": (21, 21),
        "face": (68, 68),
    }
    skeletons = [part.skeleton for part in parts.PARTS.values()]
    for skeleton in (*skeletons, H36M32, H36M17, MPII16, LSP14):
        assert list(skeleton.mirror[skeleton.mirror]) == list(range(len(skeleton)))
        assert len(skeleton.order) == len(skeleton)
    assert [EVALUATED[i] for i in parts.PARTS["body"].mirror2d[:4]] == [*EVALUATED[:2], "left_shoulder", "left_elbow"]


def test_the_hand_is_the_right_one_of_the_clip_file():
    assert [f"right_{name}" for name in parts.HAND21.names] == list(UPPER55.names[RIGHT_HAND])


def test_the_face_is_mirrored_as_300w_is():
    published = {
        0: 16,
        7: 9,
        8: 8,
        17: 26,
        21: 22,
        30: 30,
        31: 35,
        36: 45,
        37: 44,
        39: 42,
        40: 47,
        41: 46,
        48: 54,
        49: 53,
    }
    published |= {51: 51, 55: 59, 56: 58, 60: 64, 61: 63, 66: 66, 67: 65}
    assert {i: parts.FACE68.mirror[i] for i in published} == published


# ---- MPI-INF-3DHP ---------------------------------------------------------------------------------------------------


def test_3dhp_training_films_give_what_was_annotated(tmp_path):
    who = owners.people(6)
    owners.write_3dhp_train(tmp_path, who)
    samples = list(open_dataset("mpi_inf_3dhp_train", tmp_path, cameras=[0], scale="metric"))
    assert len(samples) == 6
    np.testing.assert_allclose([s.joints3d for s in samples], who.relative[:, INDEX28], atol=0.01)
    np.testing.assert_allclose([s.joints2d for s in samples], who.points[:, INDEX28[:14]], atol=0.01)
    np.testing.assert_allclose(samples[0].camera, who.camera, atol=1e-4)
    for sample in samples:
        assert owners.disc_error(sample.image, sample.joints2d, sample.visible) < 60


def test_3dhp_is_of_universal_size_unless_asked_otherwise(tmp_path):
    who = owners.people(3)
    owners.write_3dhp_train(tmp_path, who, shrink=0.8)
    samples = list(open_dataset("mpi_inf_3dhp_train", tmp_path, cameras=[0]))
    np.testing.assert_allclose([s.joints3d for s in samples], 0.8 * who.relative[:, INDEX28], atol=0.01)


def test_3dhp_frames_that_the_film_lacks_are_counted(tmp_path):
    """The annotation is longer than the film, as in S6/Seq2/video_2."""
    owners.write_3dhp_train(tmp_path, owners.people(6), rows=11)
    data = open_dataset("mpi_inf_3dhp_train", tmp_path, every=2, cameras=[0])
    with pytest.warns(CospeechNotice, match="ends after 6 frames"):
        samples = list(data)
    assert [s.tags["frame"] for s in samples] == ["0", "2", "4"]
    assert data.dropped == {"annotation without a frame of the film": 3}


def test_3dhp_rows_beyond_the_owners_frame_count_are_not_read(tmp_path):
    from cospeech.posenet.datasets import mpi_inf_3dhp

    assert len(mpi_inf_3dhp.FRAMES) == 16 and mpi_inf_3dhp.FRAMES[6, 2] == 6145
    owners.write_3dhp_train(tmp_path, owners.people(6))
    mpi_inf_3dhp.FRAMES[1, 1], kept = 4, mpi_inf_3dhp.FRAMES[1, 1]
    try:
        assert len(list(open_dataset("mpi_inf_3dhp_train", tmp_path, cameras=[0]))) == 4
    finally:
        mpi_inf_3dhp.FRAMES[1, 1] = kept


def test_3dhp_masks_join_person_and_chair_where_the_green_screen_is_good(tmp_path):
    who = owners.people(2)
    person, chair = np.zeros_like(who.images), np.full_like(who.images, 255)
    person[:, 40:80, 40:80, 0] = 255  # red is the green screen's mask; green and blue are clothing
    person[..., 1:] = 255
    chair[:, 80:100, 40:80, 0] = 0  # a chair is black
    for sequence in (1, 2):
        place = owners.write_3dhp_train(tmp_path, who, sequence=sequence)
        owners.write_film(place / "FGmasks" / "video_0.avi", person)
        owners.write_film(place / "ChairMasks" / "video_0.avi", chair)
    good, bad = list(open_dataset("mpi_inf_3dhp_train", tmp_path, every=2, cameras=[0]))
    wanted = np.zeros((160, 160))
    wanted[40:100, 40:80] = 255
    assert np.abs(good.mask.astype(float) - wanted).mean() < 5
    assert bad.mask is None  # S1/Seq2, whose masks the owners advise against


def test_3dhp_cameras_are_parsed_by_key_not_by_column(tmp_path):
    """Column slicing gave 204 for 2048 in a published file."""
    matrix = np.array([[1497.693, 0, 1024.704], [0, 1497.103, 1051.394], [0, 0, 1]])
    text = owners.calibration(matrix, [0, 13]).replace("  intrinsic   ", "intrinsic ").replace("  size", "\tsize")
    (tmp_path / "camera.calibration").write_text(text)
    cameras = read_calibration(tmp_path / "camera.calibration")
    assert sorted(cameras) == [0, 13]
    np.testing.assert_allclose(cameras[13], matrix)


def test_3dhp_test_frames_are_the_valid_ones_with_their_activity(tmp_path):
    who = owners.people(5, JOINTS17)
    owners.write_3dhp_test(tmp_path, who, 5, valid=[1, 0, 1, 1, 0], activity=[1, 2, 3, 7, 5])
    data = open_dataset("mpi_inf_3dhp_test", tmp_path)
    with pytest.warns(CospeechNotice, match="TS1, TS2, TS3, TS4, TS6 not there"):
        samples = list(data)
    assert [s.tags["activity"] for s in samples] == ["1", "3", "7"]
    assert {(s.tags["scene"], s.tags["sequence"]) for s in samples} == {("Outdoor", "5")}
    assert data.dropped["frame that its owners call invalid"] == 2
    poses = np.array([s.joints3d for s in samples])
    np.testing.assert_allclose(poses[:, :17], 0.8 * who.relative[[0, 2, 3]], atol=0.01)
    assert np.isnan(poses[:, 17:]).all()  # hands and toes are not labelled
    for sample in samples:  # images count from 1
        assert owners.disc_error(sample.image, sample.joints2d, sample.visible) < 60


def test_3dhp_test_focal_length_is_the_published_one(tmp_path):
    who = owners.people(1, JOINTS17, size=(2048, 2048))
    owners.write_3dhp_test(tmp_path, who, 2)
    with pytest.warns(CospeechNotice):
        (sample,) = open_dataset("mpi_inf_3dhp_test", tmp_path)
    np.testing.assert_allclose(sample.camera, [[1499.2, 0, 1024], [0, 1499.2, 1024], [0, 0, 1]])


def test_3dhp_test_arrays_that_disagree_are_cut_to_the_shortest(tmp_path):
    """And the activities are found under the name that the owners' README misspells."""
    who = owners.people(5, JOINTS17)
    owners.write_3dhp_test(tmp_path, who, 1, valid=[1, 1, 1], images=4, spelling="activity_annnotation")
    with pytest.warns(CospeechNotice) as told:
        samples = list(open_dataset("mpi_inf_3dhp_test", tmp_path, sequences=[1]))
    assert [s.tags["frame"] for s in samples] == ["1", "2", "3"]
    lines = " | ".join(str(w.message) for w in told)
    assert "arrays of 5, 5, 3, 5 frames; the first 3 are used" in lines and "4 images and 3 annotated frames" in lines


# ---- Human3.6M ------------------------------------------------------------------------------------------------------


def test_h36m_cdf_and_film_give_all_21_joints_and_a_camera(tmp_path):
    who = owners.people(8, H36M32)
    owners.write_h36m(tmp_path, who, action="TakingPhoto 1")
    samples = list(open_dataset("h36m", tmp_path, every=3))
    assert [s.tags["frame"] for s in samples] == ["0", "3", "6"]
    assert samples[0].tags["action"] == "Photo" and samples[0].tags["subject"] == "S1"
    truth = expected3d(who, H36M32, JOINTS21.names)[::3]
    np.testing.assert_allclose([s.joints3d for s in samples], truth, atol=0.01)
    np.testing.assert_allclose(samples[0].camera, who.camera, atol=0.05)  # found from the poses alone
    for sample in samples:
        assert owners.disc_error(sample.image, sample.joints2d, sample.visible) < 80


def test_h36m_frames_without_2d_or_without_film_are_left_out(tmp_path):
    who = owners.people(8, H36M32)
    owners.write_h36m(tmp_path, who, rows2d=6)
    place = tmp_path / "S1" / "Videos" / "Directions 1.54138969.mp4"
    owners.write_film(place, who.images[:4], "libx264")
    data = open_dataset("h36m", tmp_path)
    with pytest.warns(CospeechNotice) as told:
        assert len(list(data)) == 4
    lines = " | ".join(str(w.message) for w in told)
    assert "8 frames in 3D and 6 in 2D" in lines and "ends after 4 frames" in lines
    assert data.dropped == {"annotation without a frame of the film": 2}


def test_h36m_frame_lists_choose_frames(tmp_path):
    owners.write_h36m(tmp_path, owners.people(8, H36M32))
    listing = tmp_path / "h80k.csv"
    listing.write_text("subject,action,camera,frame\nS1,Directions 1,54138969,5\n1,Directions 1,54138969,2\n")
    samples = list(open_dataset("h36m", tmp_path, frame_list=listing))
    assert [s.tags["frame"] for s in samples] == ["2", "5"]
    listing.write_text("subject,action,frame\nS1,Directions 1,5\n")
    with pytest.raises(CospeechError, match="no column 'camera'"):
        list(open_dataset("h36m", tmp_path, frame_list=listing))


def test_h36m_can_be_of_universal_size(tmp_path):
    who = owners.people(4, H36M32)
    owners.write_h36m(tmp_path, who)
    poses = np.array([s.joints3d for s in open_dataset("h36m", tmp_path, scale="universal")])
    bone = lambda a, b: np.linalg.norm(poses[:, JOINTS21.index[a]] - poses[:, JOINTS21.index[b]], axis=1)
    height = bone("left_knee", "left_hip") + bone("pelvis", "spine") + bone("spine", "neck")
    assert np.median(height) == pytest.approx(920, abs=0.1)


def test_h36m_npz_of_mmpose_is_in_metres_and_counts_from_1(tmp_path):
    who = owners.people(6, H36M17)
    owners.write_h36m_npz(tmp_path, who, subject=9, subset="test")
    samples = list(open_dataset("h36m", tmp_path, subset="test", every=5))
    assert [s.tags["frame"] for s in samples] == ["0", "5"]
    poses = np.array([s.joints3d for s in samples])
    np.testing.assert_allclose(poses[:, :17], expected3d(who, H36M17, JOINTS17.names)[::5], atol=0.01)
    assert np.isnan(poses[:, 17:]).all()
    projected = project(who.poses[::5], samples[0].camera)
    np.testing.assert_allclose(projected, who.points[::5], atol=0.01)


def test_h36m_actions_have_one_name():
    assert action_name("WalkingDog 1") == "WalkDog" and action_name("TakingPhoto_2", numbered=True) == "Photo 2"
    assert action_name("Directions") == "Directions" == action_name("Directions", numbered=True)


# ---- MPII and LSP ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 3])  # scipy gives one struct another type than several
def test_mpii_structs_count_from_1_and_have_gaps(tmp_path, count):
    who = owners.people(count, MPII16)
    labelled, visible = np.ones((count, 16), bool), np.ones((count, 16), int)
    labelled[0, 9], visible[0, 0] = False, 0  # no head top; the right ankle is hidden
    owners.write_mpii(tmp_path, who, labelled, visible)
    samples = list(open_dataset("mpii", tmp_path))
    assert len(samples) == count
    truth = who.points[:, MPII16.joints(*EVALUATED)]
    ankle = EVALUATED.index("right_ankle")
    seen = np.ones(14, bool)
    seen[[0, ankle]] = False
    np.testing.assert_array_equal(samples[0].visible, seen)
    np.testing.assert_allclose(samples[0].joints2d[seen], truth[0][seen], atol=1e-3)
    assert samples[0].joints3d is None and samples[0].camera is None
    assert owners.disc_error(samples[0].image, samples[0].joints2d, samples[0].visible) < 60
    hidden = next(iter(open_dataset("mpii", tmp_path, occluded=True)))
    assert hidden.visible[ankle] and not hidden.visible[0]


def test_mpii_visibility_is_a_number_a_character_or_empty(tmp_path):
    visible = np.ones((2, 16), object)
    visible[0, MPII16.index["right_ankle"]] = "0"
    visible[0, MPII16.index["right_knee"]] = np.zeros((0, 0))
    owners.write_mpii(tmp_path, owners.people(2, MPII16), visible=visible)
    first = next(iter(open_dataset("mpii", tmp_path)))
    assert [EVALUATED[k] for k in np.flatnonzero(~first.visible)] == ["right_ankle"]


def test_mpii_without_people_and_test_images_are_counted(tmp_path):
    owners.write_mpii(tmp_path, owners.people(4, MPII16), train=[1, 0, 1, 1], nobody=[2])
    data = open_dataset("mpii", tmp_path)
    assert len(list(data)) == 2
    assert data.dropped == {"test image, whose joints its owners keep": 1, "image without an annotated person": 1}


def test_mpii_json_counts_from_1_too(tmp_path):
    who = owners.people(2, MPII16)
    visible = np.ones((2, 16), bool)
    visible[1, 15] = False
    owners.write_mpii_json(tmp_path, who, visible, "valid.json")
    samples = list(open_dataset("mpii", tmp_path, subset="val"))
    np.testing.assert_allclose(samples[0].joints2d, who.points[0, MPII16.joints(*EVALUATED)], atol=1e-3)
    assert not samples[1].visible[EVALUATED.index("left_wrist")] and samples[1].visible.sum() == 13


def test_lsp_marks_hidden_joints_and_its_extension_visible_ones(tmp_path):
    who = owners.people(3, LSP14)
    flags = np.zeros((3, 14))
    flags[:, LSP14.index["left_knee"]] = 1
    owners.write_lsp(tmp_path / "lsp", who, flags)
    owners.write_lsp(tmp_path / "lspet", who, flags, extended=True)
    knee = EVALUATED.index("left_knee")
    lsp = list(open_dataset("lsp", tmp_path / "lsp"))
    lspet = list(open_dataset("lspet", tmp_path / "lspet"))
    assert [s.visible.tolist() for s in lsp] == [[k != knee for k in range(14)]] * 3
    assert [s.visible.tolist() for s in lspet] == [[k == knee for k in range(14)]] * 3
    truth = who.points[:, LSP14.joints(*EVALUATED)]
    np.testing.assert_allclose(np.array([s.joints2d for s in lsp])[:, :knee], truth[:, :knee], atol=1e-3)
    np.testing.assert_allclose([s.joints2d[knee] for s in lspet], truth[:, knee], atol=1e-3)
    assert all(s.visible.all() for s in open_dataset("lsp", tmp_path / "lsp", occluded=True))


def test_lsp_trains_on_its_first_thousand(tmp_path):
    who = owners.people(2, LSP14)
    owners.write_lsp(tmp_path, who, np.zeros((2, 14)))
    from cospeech.posenet.datasets import lsp

    lsp.TRAINING, kept = 1, lsp.TRAINING
    try:
        names = [
            [s.tags["image"] for s in open_dataset("lsp", tmp_path, subset=subset)] for subset in ("train", "test")
        ]
    finally:
        lsp.TRAINING = kept
    assert kept == 1000 and names == [["im0001.jpg"], ["im0002.jpg"]]


# ---- COCO-WholeBody -------------------------------------------------------------------------------------------------


def hand(rng, wrist=(60, 60)):
    """(21, 3) keypoints in the owners' order, all visible."""
    return np.column_stack([rng.uniform(-40, 40, (21, 2)) + wrist, np.full(21, 2)])


def test_coco_left_hands_become_right_ones(tmp_path):
    rng = np.random.default_rng(0)
    right, left = hand(rng), hand(rng, (90, 70))
    left[4, 2] = 0  # its thumb's tip is not labelled
    image = rng.integers(0, 255, (150, 200, 3), np.uint8)
    annotation = {
        "id": 1,
        "image_id": 7,
        "righthand_valid": True,
        "righthand_kpts": right.ravel().tolist(),
        "lefthand_valid": True,
        "lefthand_kpts": left.ravel().tolist(),
        "face_valid": False,
        "face_kpts": [0] * 204,
    }
    owners.write_coco(tmp_path, [annotation], {7: image})
    one, two = open_dataset("coco_wholebody", tmp_path)
    assert (one.tags["side"], two.tags["side"]) == ("right", "left")
    middle, thumb = (parts.HAND21.index[name] for name in ("middle_0", "thumb_3"))
    np.testing.assert_allclose(one.joints2d[middle], right[9, :2], atol=1e-3)
    np.testing.assert_allclose(two.joints2d[middle], [199 - left[9, 0], left[9, 1]], atol=1e-3)
    np.testing.assert_array_equal(two.image, one.image[:, ::-1])
    assert not two.visible[thumb] and two.visible.sum() == 20


def test_coco_faces_and_what_is_not_labelled(tmp_path):
    rng = np.random.default_rng(0)
    face = np.column_stack([rng.uniform(20, 100, (68, 2)), np.full(68, 1.0)])
    tiny = face * [0.1, 0.1, 1]
    common = {"righthand_valid": False, "lefthand_valid": False}
    annotations = [
        {"id": i, "image_id": 7, "face_valid": valid, "face_kpts": points.ravel().tolist(), **common}
        for i, (valid, points) in enumerate([(True, face), (False, face), (True, tiny)])
    ]
    owners.write_coco(tmp_path, annotations, {7: np.zeros((120, 120, 3), np.uint8)}, "val")
    data = open_dataset("coco_wholebody", tmp_path, part="face", subset="val")
    (sample,) = data
    np.testing.assert_allclose(sample.joints2d, face[:, :2], atol=1e-3)
    assert data.part == "face"
    assert data.dropped == {"person without a labelled face": 1, "face smaller than 32 pixels": 1}


def test_3dhp_joint_order_is_by_name():
    assert JOINTS28.joints(*JOINTS21.names) == INDEX28
