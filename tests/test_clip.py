"""The clip file: what is written is read, by us and by plain h5py, and damage is named."""

import os

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError
from cospeech.files import writing, writing_hdf5
from tests.conftest import make_clip


def full_clip(frames=20):
    clip = make_clip(3, frames)
    clip.root = np.ones((frames, 3), np.float32)
    clip.face_confidence = np.full(frames, 0.5, np.float32)
    clip.words = Words(np.array([0.1, 0.4]), np.array([0.3, 0.6]), ["grüße", "world"])
    clip.audio, clip.sample_rate, clip.loudness_lufs = "../media/take.wav", 22050, -20.5
    clip.extra = {"smoothing": 1.5}
    return clip


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(frames=st.integers(1, 70), words=st.lists(st.text(st.characters(exclude_categories=["Cs", "Cc"])), max_size=4))
def test_round_trip(tmp_path, frames, words):
    clip = full_clip(frames)
    clip.words = Words(np.arange(len(words)) / 10, np.arange(len(words)) / 10 + 0.05, words)
    clip.write(tmp_path / "clip.h5")
    back = Clip.read(tmp_path / "clip.h5")
    for name in ("positions", "features", "valid", "confidence", "root", "expression", "rotation", "face_confidence"):
        np.testing.assert_array_equal(getattr(back, name), getattr(clip, name), err_msg=name)
    assert (back.words.text, back.audio, back.sample_rate, back.loudness_lufs) == (words, clip.audio, 22050, -20.5)
    assert (back.subject, back.clip, back.fps, back.face_model, back.extra) == (
        "toy",
        "take03",
        15.0,
        "toy",
        clip.extra,
    )


def test_file_is_the_published_schema_for_plain_h5py(tmp_path):
    full_clip().write(tmp_path / "clip.h5")
    with h5py.File(tmp_path / "clip.h5") as file:
        head = dict(file.attrs)
        assert (head["schema"], head["schema_version"], head["frames"], head["units"]) == ("cospeech.clip", 1, 20, "m")
        assert (head["axes"], head["skeleton"], head["generator"]) == ("x left, y up, z forward", "upper55", "")
        shapes = {"audio/features": (20, 28), "motion/positions": (20, 55, 3), "motion/confidence": (20, 55)}
        shapes |= {"motion/root": (20, 3), "face/expression": (20, 4), "face/rotation": (20, 3)}
        shapes |= {"face/confidence": (20,), "words/start": (2,), "words/text": (2,), "valid": (20,)}
        assert {name: file[name].shape for name in shapes} == shapes
        assert file["motion/positions"].compression == "gzip" and file["motion/positions"].shuffle
        assert file["words/text"].asstr()[0] == "grüße" and file["face"].attrs["E"] == 4
        assert file["valid"].dtype == bool and file["words/start"].dtype == np.float64


def test_same_clip_same_bytes(tmp_path):
    for name in ("a.h5", "b.h5"):
        full_clip().write(tmp_path / name)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


@pytest.mark.parametrize("name", ["positions", "features", "rotation", "expression", "root"])
def test_nan_is_named_with_its_frame(tmp_path, name):
    clip = full_clip()
    getattr(clip, name)[7] = np.nan
    with pytest.raises(CospeechError, match=rf"{name} holds NaN.*frame 7"):
        clip.write(tmp_path / "clip.h5")
    assert list(tmp_path.iterdir()) == []


def test_nan_in_a_foreign_file_is_refused_when_read(tmp_path):
    full_clip().write(tmp_path / "clip.h5")
    with h5py.File(tmp_path / "clip.h5", "a") as file:
        file["motion/positions"][4, 2, 1] = np.nan
    with pytest.raises(CospeechError, match=r"clip.h5: positions holds NaN.*frame 4"):
        Clip.read(tmp_path / "clip.h5")


def damaged(tmp_path, change):
    path = tmp_path / "clip.h5"
    full_clip().write(path)
    with h5py.File(path, "a") as file:
        change(file)
    return path


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: f.attrs.__setitem__("schema", "other"), "schema"),
        (lambda f: f.attrs.__setitem__("schema_version", 9), "schema_version is 9"),
        (lambda f: f.attrs.__setitem__("skeleton", "smpl"), "skeleton"),
        (lambda f: f.__delitem__("motion/positions"), "positions"),
        (lambda f: f.__delitem__("valid"), "valid"),
        (lambda f: f.attrs.__delitem__("fps"), "fps"),
    ],
)
def test_damage_is_one_clear_line(tmp_path, change, says):
    with pytest.raises(CospeechError) as error:
        Clip.read(damaged(tmp_path, change))
    assert "clip.h5" in str(error.value) and says in str(error.value) and "\n" not in str(error.value)


def test_missing_truncated_and_foreign_files(tmp_path):
    with pytest.raises(CospeechError, match="no such file"):
        Clip.read(tmp_path / "absent.h5")
    full_clip().write(tmp_path / "clip.h5")
    whole = (tmp_path / "clip.h5").read_bytes()
    (tmp_path / "half.h5").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.h5").write_text("not HDF5")
    for name in ("half.h5", "text.h5"):
        with pytest.raises(CospeechError, match=f"{name}: not a readable HDF5"):
            Clip.read(tmp_path / name)


def test_no_frames_is_refused():
    with pytest.raises(CospeechError, match="0 frames"):
        full_clip().section(3, 3).validate()


def test_section_cuts_every_array_and_shifts_words():
    part = full_clip().section(5, 12)
    assert part.validate().frames == 7 and part.root.shape == (7, 3)
    assert part.words.text == ["world"]
    np.testing.assert_allclose(part.words.start, [0.4 - 5 / 15])


def test_exception_while_writing_leaves_the_old_file(tmp_path):
    path = tmp_path / "clip.h5"
    full_clip().write(path)
    before = path.read_bytes()
    with pytest.raises(RuntimeError), writing_hdf5(path, "cospeech.clip") as file:
        file["half"] = 1
        raise RuntimeError("interrupted")
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["clip.h5"]


def test_full_disk_is_one_line(tmp_path):
    says = r"out.bin: cannot be written \(No space left"
    with pytest.raises(CospeechError, match=says), writing(tmp_path / "out.bin"), open("/dev/full", "w") as full:
        full.write("x" * 100_000)
