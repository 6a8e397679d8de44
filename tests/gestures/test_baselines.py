"""Mean pose, random motion and mismatched takes: by hand, and as members of the registry."""

from dataclasses import replace

import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.gestures.baselines import MeanPose, RandomTake, mismatched
from cospeech.split import Split
from cospeech.synthesis import load
from tests.conftest import make_clip


@pytest.fixture
def folder(tmp_path, toy_clips):
    """Results of a subject: two training takes, the second one cut, and a test take."""
    for clip in toy_clips:
        clip.write(tmp_path / "clips" / f"{clip.clip}.h5")
    Split({"train": [("take00", 0, 256), ("take01", 0, 100)], "val": [], "test": [("take02", 0, 256)]}).write(
        tmp_path / "split.h5"
    )
    return tmp_path


def test_mean_pose_is_that_of_the_valid_training_frames_alone(folder, toy_clips):
    motion = load("mean_pose", folder).generate(np.zeros((7, 28), "f4"))
    shown = np.concatenate([toy_clips[0].positions, toy_clips[1].positions[:100]])
    assert motion.positions.shape == (7, 55, 3) and motion.face_model == "toy"
    np.testing.assert_allclose(motion.positions[3], shown.mean(0), atol=1e-6)
    faces = np.concatenate([toy_clips[0].expression, toy_clips[1].expression[:100]])
    np.testing.assert_allclose(motion.expression[6], faces.mean(0), atol=1e-6)
    half = replace(toy_clips[0], valid=np.arange(256) < 64)
    np.testing.assert_allclose(
        MeanPose([half]).generate(np.zeros((1, 28))).positions[0], half.positions[:64].mean(0), atol=1e-6
    )


@pytest.mark.parametrize("seed", range(5))
def test_random_is_one_stretch_of_one_training_take(folder, toy_clips, seed):
    motion = load("random", folder).generate(np.zeros((90, 28), "f4"), seed=seed)
    again = load("random", folder).generate(np.ones((90, 28), "f4"), seed=seed)
    np.testing.assert_array_equal(motion.positions, again.positions)  # the speech changes nothing
    shown = [toy_clips[0], toy_clips[1].section(0, 100)]
    starts = [
        (i, s)
        for i, clip in enumerate(shown)
        for s in range(clip.frames - 89)
        if np.array_equal(clip.positions[s : s + 90], motion.positions)
    ]
    assert len(starts) == 1
    take, start = starts[0]
    np.testing.assert_array_equal(motion.expression, shown[take].expression[start : start + 90])


def test_random_differs_by_seed_and_joins_stretches_where_none_is_long_enough(toy_clips):
    takes = RandomTake(toy_clips)
    one, other = (takes.generate(np.zeros((90, 28)), seed=seed).positions for seed in (1, 2))
    assert not np.array_equal(one, other)
    assert takes.generate(np.zeros((1000, 28))).positions.shape == (1000, 55, 3)
    gap = replace(toy_clips[0], valid=np.r_[np.ones(50, bool), np.zeros(156, bool), np.ones(50, bool)])
    kept = {frame.tobytes() for frame in gap.positions[gap.valid]}
    assert all(frame.tobytes() in kept for frame in RandomTake([gap]).generate(np.zeros((200, 28))).positions)


def test_what_some_takes_lack_no_motion_has(toy_clips):
    motion = MeanPose([toy_clips[0], replace(toy_clips[1], expression=None)]).generate(np.zeros((2, 28)))
    assert motion.expression is None and motion.face_model == "" and motion.rotation.shape == (2, 3)
    other = replace(toy_clips[1], face_model="other")
    assert RandomTake([toy_clips[0], other]).generate(np.zeros((2, 28))).expression is None
    with pytest.raises(CospeechError, match="no valid frame"):
        MeanPose([replace(toy_clips[0], valid=np.zeros(256, bool))])


def test_mismatched_is_the_next_takes_motion_under_ones_own_speech():
    clips = {"b": make_clip(1, 80), "a": make_clip(0, 100), "c": make_clip(2, 90)}
    found = mismatched(clips)
    assert {name: clip.frames for name, clip in found.items()} == {"a": 80, "b": 80, "c": 90}
    np.testing.assert_array_equal(found["a"].features, clips["a"].features[:80])
    np.testing.assert_array_equal(found["a"].positions, clips["b"].positions)
    np.testing.assert_array_equal(found["c"].expression, clips["a"].expression[:90])
    with pytest.raises(CospeechError, match=r"mismatched: one take, a; mismatching needs two takes"):
        mismatched({"a": clips["a"]})
