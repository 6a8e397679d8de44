"""What a database holds, and what it refuses."""

import h5py
import numpy as np
import pytest

from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.matching import Database
from cospeech.skeleton import UPPER55


def test_features_are_those_of_the_thesis_and_look_past_the_clips_end(random_takes):
    """Feature 60 of the first clip holds frames 60, 62, 64, 66 of the take, in their published order of joints."""
    (positions,), (features,) = random_takes(np.random.default_rng(0), (200,))
    database = Database.from_arrays([positions], [features], ["a"])
    joints = "right_elbow right_wrist left_elbow left_wrist right_index_0 right_little_0 left_index_0 left_little_0"
    joints = [UPPER55.names.index(name) for name in joints.split()]
    assert sorted(joints) == [3, 4, 6, 7, 14, 20, 35, 41]
    pose, audio = database.pose_normalization, database.audio_normalization
    assert np.allclose(
        (database.pose[0, 60] * pose.std + pose.mean).reshape(4, 8, 3), positions[60:67:2][:, joints], atol=1e-5
    )
    assert np.allclose(
        (database.audio[0, 60] * audio.std + audio.mean).reshape(8, 14), features[60:75:2, :14], atol=1e-4
    )


def test_normalised_by_the_real_frames(random_takes):
    database = Database.from_arrays(*random_takes(np.random.default_rng(0), (640, 700)), ["a", "b"])
    real = np.ones(database.eligible.shape, bool)
    real[9, 50:] = False  # the first take ends here; the second goes on for 60 frames after its last clip
    for features in (database.pose, database.audio):
        assert np.allclose(features[real].mean(axis=0), 0, atol=1e-4)
        assert np.allclose(features[real].std(axis=0), 1, atol=1e-4)


def test_a_dimension_that_never_moves_does_not_explode(random_takes):
    positions, features = random_takes(np.random.default_rng(0), (200,))
    positions[0][:, 7] = 0.25
    features[0][:, 3] = -7.0
    database = Database.from_arrays(positions, features, ["a"])
    assert np.isfinite(database.pose).all() and np.abs(database.pose).max() < 20
    assert np.allclose(database.audio.reshape(-1, 64, 8, 14)[..., 3], 0, atol=1e-4)


def test_eligible_frames_have_real_features_and_a_whole_window(random_takes):
    positions, features = random_takes(np.random.default_rng(0), (128, 150))
    valid = [np.ones(128, bool), np.ones(150, bool)]
    valid[1][30] = False
    eligible = Database.from_arrays(positions, features, ["a", "b"], valid=valid).eligible
    assert [np.flatnonzero(row).tolist() for row in eligible] == [
        list(range(57)),  # r + 7 <= 63; the look-ahead reaches into the next clip
        list(range(50)),  # r + 14 <= 63: the take ends with the clip
        [*range(16), *range(31, 57)],  # frame 30 is not in any r .. r + 14
        list(range(57)),
    ]


def test_stretches_of_a_take_keep_its_name_and_time(random_takes):
    positions, features = random_takes(np.random.default_rng(0), (130, 70, 64))
    database = Database.from_arrays(positions, features, ["a", "b", "a"], starts=[0, 0, 100.0])
    assert [database.takes[t] for t in database.take] == ["a", "a", "b", "a"]
    assert np.allclose(database.time([1, 3], [0, 15]), [64 / 15, 101.0])


def clip(name, positions, features, **more):
    return Clip("someone", name, 15.0, positions, features, **more)


def test_from_clips_with_rotations_and_words(tmp_path, random_takes):
    positions, features = random_takes(np.random.default_rng(0), (130, 70))
    rotations = [np.random.default_rng(1).normal(size=(len(p), 3)).astype(np.float32) for p in positions]
    words = [Words(np.array([1.0]), np.array([1.5]), ["größer"]), Words.none()]
    clips = [
        clip(name, p, f, rotation=r, words=w)
        for name, p, f, r, w in zip("ab", positions, features, rotations, words, strict=True)
    ]
    Database.from_clips(clips, starts=[5.0, 0.0]).save(tmp_path / "database.h5")
    database = Database.load(tmp_path / "database.h5", fps=15.0)
    assert np.array_equal(database.rotation[1], rotations[0][64:128])
    assert database.words.text == ["größer"] and database.words.start.tolist() == [6.0]
    assert database.takes[database.word_take[0]] == "a"
    assert np.array_equal(
        database.gestures([[1, 2], [0, 0]], [[4, 9], [0, 1]], "rotation")[0],
        np.concatenate([rotations[0][68:76], rotations[1][9:17]]),
    )


def test_saved_and_loaded_is_the_same_and_is_mapped(database, tmp_path):
    path = tmp_path / "database.h5"
    database.save(path)
    first = path.read_bytes()
    database.save(path)
    assert path.read_bytes() == first
    again = Database.load(path)
    for name in ("pose", "audio", "positions", "eligible", "take", "start"):
        assert np.array_equal(getattr(again, name), getattr(database, name))
    assert again.takes == database.takes and again.rotation is None
    assert isinstance(again.pose.base, np.memmap)
    again.pose[:] = 0  # a copy in memory: the file keeps its numbers
    assert path.read_bytes() == first


def test_a_compressed_copy_reads_the_same(database, tmp_path):
    """Someone repacked the file: nothing can be mapped, all can be read."""
    database.save(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        del file["pose"]
        file.create_dataset("pose", data=database.pose, compression="gzip")
    assert np.array_equal(Database.load(tmp_path / "a.h5").pose, database.pose)


def nan_at(array, frame):
    array = array.copy()
    array[frame] = np.nan
    return array


P, F = np.random.default_rng(0).normal(size=(100, 55, 3)), np.random.default_rng(1).normal(size=(100, 28))


@pytest.mark.parametrize(
    ("positions", "features", "options", "message"),
    [
        (P[:40], F[:40], {}, "no training clip long enough: the longest has 40 frames, one needs 64"),
        (nan_at(P, 17), F, {}, "take 'a': positions holds NaN or infinity, first in frame 17"),
        (P, nan_at(F, 3), {}, "take 'a': features holds NaN or infinity, first in frame 3"),
        (P, F[:90], {}, r"features has shape \(90, 28\), expected \(100, 28\)"),
        (P[:, :50], F, {}, "positions has shape"),
        (P, F, {"rotations": [nan_at(P[:, 0], 5)]}, "rotation holds NaN"),
        (P, F, {"valid": [np.arange(100) % 10 > 0]}, "no frame has 14 valid frames after it"),
        (P, F, {"clip_frames": 4}, "cannot hold a window"),
    ],
)
def test_mistakes_get_one_line(positions, features, options, message):
    with pytest.raises(CospeechError, match=message) as error:
        Database.from_arrays([positions], [features], ["a"], **options)
    assert "\n" not in str(error.value)


def test_no_takes_and_mixed_rates():
    with pytest.raises(CospeechError, match="no training clip long enough"):
        Database.from_arrays([], [], [])
    with pytest.raises(CospeechError, match="different rates"):
        Database.from_clips([clip("a", P, F), Clip("someone", "b", 30.0, P, F)])


def test_takes_without_a_whole_clip_are_left_out_with_a_notice(random_takes):
    positions, features = random_takes(np.random.default_rng(0), (100, 63))
    with pytest.warns(CospeechNotice, match="shorter than one clip of 64 frames: b"):
        database = Database.from_arrays(positions, features, ["a", "b"])
    assert len(database) == 1


def test_files_that_are_no_database_of_ours(database, tmp_path):
    path = tmp_path / "database.h5"
    database.save(path)
    with pytest.raises(CospeechError, match="made for 15 fps, but 30 fps"):
        Database.load(path, fps=30.0)
    with h5py.File(path, "r+") as file:
        file.attrs["skeleton"] = "smplx"
    with pytest.raises(CospeechError, match="'smplx', expected 'upper55'"):
        Database.load(path)
    with h5py.File(path, "r+") as file:
        file.attrs["skeleton"] = "upper55"
        del file["audio"]
    with pytest.raises(CospeechError, match="no complete database, audio is missing; build it again"):
        Database.load(path)
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = "cospeech.clip"
    with pytest.raises(CospeechError, match="expected 'cospeech\\.database'"):
        Database.load(path)
    with pytest.raises(CospeechError, match="no such file"):
        Database.load(tmp_path / "none.h5")
