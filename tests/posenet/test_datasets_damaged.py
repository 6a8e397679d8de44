"""Data sets with damage: one clear line each, the rest of the data used, and what was left out counted."""

import warnings

import numpy as np
import pytest

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.posenet import JOINTS17
from cospeech.posenet.datasets import open_dataset
from cospeech.posenet.datasets.h36m import H36M17, H36M32
from cospeech.posenet.datasets.lsp import LSP14
from cospeech.posenet.datasets.mpii import MPII16
from tests.posenet import owners


def test_names_folders_and_options_are_checked(tmp_path):
    with pytest.raises(CospeechError, match="'h37m' is unknown; known: mpi_inf_3dhp_train"):
        open_dataset("h37m", tmp_path)
    with pytest.raises(CospeechError, match="no such folder"):
        open_dataset("lsp", tmp_path / "absent")
    with pytest.raises(CospeechError, match="no option 'ever'; it has every, subjects"):
        open_dataset("mpi_inf_3dhp_train", tmp_path, ever=3)


@pytest.mark.parametrize(
    "name", ["mpi_inf_3dhp_train", "mpi_inf_3dhp_test", "h36m", "mpii", "lsp", "lspet", "coco_wholebody"]
)
def test_an_empty_folder_is_told_in_one_line(tmp_path, name):
    with pytest.raises(CospeechError) as error:
        list(open_dataset(name, tmp_path))
    assert str(tmp_path) in str(error.value) and "\n" not in str(error.value)


def cut(path, share=0.5):
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_one_truncated_annotation_is_told_and_the_other_sequence_used(tmp_path, share):
    who = owners.people(2)
    owners.write_3dhp_train(tmp_path, who, sequence=1)
    place = owners.write_3dhp_train(tmp_path, who, sequence=2)
    cut(place / "annot.mat", share)
    data = open_dataset("mpi_inf_3dhp_train", tmp_path, cameras=[0])
    with pytest.warns(CospeechNotice, match=r"annot.mat: (not a readable|damaged) MATLAB file"):
        assert len(list(data)) == 2
    assert data.dropped == {"sequence without readable annotation": 1}


def test_a_missing_annotation_and_a_truncated_test_file_are_told(tmp_path):
    who = owners.people(2, JOINTS17)
    for sequence in (1, 2, 3):
        place = owners.write_3dhp_test(tmp_path, who, sequence)
        if sequence == 2:
            cut(place / "annot_data.mat")
        if sequence == 3:
            (place / "annot_data.mat").unlink()
    data = open_dataset("mpi_inf_3dhp_test", tmp_path, sequences=[1, 2, 3])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert len(list(data)) == 2
    lines = " | ".join(str(w.message) for w in told)
    assert "TS2" in lines and "not a readable MATLAB v7.3 file" in lines and "TS3" in lines and "no such file" in lines
    assert data.dropped["sequence without readable annotation"] == 2


def test_images_that_are_missing_or_damaged_are_counted(tmp_path):
    who = owners.people(5, LSP14)
    owners.write_lsp(tmp_path, who, np.zeros((5, 14)))
    (tmp_path / "images" / "im0001.jpg").unlink()
    (tmp_path / "images" / "im0002.jpg").write_bytes(b"not an image")
    cut(tmp_path / "images" / "im0003.jpg")  # decodes, to half a picture and grey
    data = open_dataset("lsp", tmp_path)
    with pytest.warns(CospeechNotice, match="joints of 5 images, and 4 images"):
        assert [s.tags["image"] for s in data] == ["im0004.jpg", "im0005.jpg"]
    assert data.dropped == {"image is not there": 1, "image does not decode": 2}


def test_joints_outside_the_image_are_not_visible_and_a_person_outside_is_counted(tmp_path):
    who = owners.people(2, LSP14)
    who.points[0, LSP14.index["head_top"]] = [-3, 20]
    who.points[1] += 500
    owners.write_lsp(tmp_path, who, np.zeros((2, 14)))
    data = open_dataset("lsp", tmp_path)
    (sample,) = data
    assert sample.visible.tolist() == [False] + [True] * 13
    assert data.dropped == {"no joint inside the image": 1}


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_a_film_that_is_cut_off_gives_its_first_frames(tmp_path, share):
    who = owners.people(8)
    place = owners.write_3dhp_train(tmp_path, who)
    cut(place / "imageSequence" / "video_0.avi", share)
    data = open_dataset("mpi_inf_3dhp_train", tmp_path, cameras=[0])
    with pytest.warns(CospeechNotice, match=r"video_0.avi: (ends|damaged) after"):
        samples = list(data)
    assert 1 <= len(samples) < 8 and data.dropped == {"annotation without a frame of the film": 8 - len(samples)}
    for sample in samples[:-1]:
        assert owners.disc_error(sample.image, sample.joints2d, sample.visible) < 60


def test_a_film_that_does_not_open_leaves_the_other_camera(tmp_path):
    place = owners.write_3dhp_train(tmp_path, owners.people(2), cameras=(0, 1))
    cut(place / "imageSequence" / "video_0.avi", 0.001)
    data = open_dataset("mpi_inf_3dhp_train", tmp_path, cameras=[0, 1])
    with pytest.warns(CospeechNotice, match="video_0.avi: not a readable film"):
        samples = list(data)
    assert {s.tags["camera"] for s in samples} == {"1"} and sum(data.dropped.values()) == 1


@pytest.mark.parametrize("name", ["mpii", "lsp", "coco_wholebody", "h36m"])
def test_the_only_annotation_file_truncated_is_an_error_in_one_line(tmp_path, name):
    if name == "mpii":
        path = owners.write_mpii(tmp_path, owners.people(2, MPII16))
    elif name == "lsp":
        owners.write_lsp(tmp_path, owners.people(2, LSP14), np.zeros((2, 14)))
        path = tmp_path / "joints.mat"
    elif name == "h36m":
        path = owners.write_h36m_npz(tmp_path, owners.people(2, H36M17))
    else:
        path = owners.write_coco(tmp_path, [], {1: np.zeros((8, 8, 3), np.uint8)})
    cut(path)
    with pytest.raises(CospeechError) as error:
        list(open_dataset(name, tmp_path))
    assert path.name in str(error.value) and "\n" not in str(error.value)


def test_lsp_and_its_extension_are_not_taken_for_each_other(tmp_path):
    owners.write_lsp(tmp_path, owners.people(2, LSP14), np.zeros((2, 14)), extended=True)
    with pytest.raises(CospeechError, match="is it lspet"):
        list(open_dataset("lsp", tmp_path))


def test_a_truncated_cdf_leaves_the_other_recordings(tmp_path):
    who = owners.people(3, H36M32)
    for action in ("Eating", "Walking"):
        owners.write_h36m(tmp_path, who, action=action)
    cut(tmp_path / "S1" / "MyPoseFeatures" / "D3_Positions_mono" / "Eating.54138969.cdf")
    data = open_dataset("h36m", tmp_path)
    with pytest.warns(CospeechNotice, match=r"Eating.54138969.cdf: not a readable CDF"):
        assert {s.tags["action"] for s in data} == {"Walking"}
    assert data.dropped == {"recording without readable poses or film": 1}
