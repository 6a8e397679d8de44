"""Parts are disjoint in time, and in take where there are takes enough."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.split import PARTS, Split, split_clips

SHARES = {"train": 0.8, "val": 0.1, "test": 0.1}


def frames_of(split, clips):
    """{clip: (frames,) how many parts use each frame}."""
    used = {clip: np.zeros(n, int) for clip, n in clips.items()}
    for part in PARTS:
        for clip, start, stop in split.of(part):
            used[clip][start:stop] += 1
    return used


@given(st.lists(st.integers(50, 900), min_size=3, max_size=20), st.integers(0, 9))
def test_takes_stay_whole_and_every_frame_is_used_once(lengths, seed):
    clips = {f"t{i}": n for i, n in enumerate(lengths)}
    split = split_clips(clips, {}, SHARES, "take", seed)
    assert all((used == 1).all() for used in frames_of(split, clips).values())
    assert sorted(clip for part in PARTS for clip, _, _ in split.of(part)) == sorted(clips)
    assert split.of("train") and split.of("test")


@given(st.lists(st.integers(50, 900), min_size=1, max_size=6))
def test_by_time_no_frame_is_in_two_parts(lengths):
    clips = {f"t{i}": n for i, n in enumerate(lengths)}
    split = split_clips(clips, {}, SHARES, "time")
    assert all((used == 1).all() for used in frames_of(split, clips).values())


def test_equal_takes_meet_the_shares():
    split = split_clips({f"t{i:02d}": 100 for i in range(10)}, {}, SHARES)
    assert [len(split.of(part)) for part in PARTS] == [8, 1, 1]


def test_named_parts_are_kept():
    clips = {"a": 100, "b": 100, "c": 50}
    split = split_clips(clips, {"a": "train", "b": "train", "c": "test"}, SHARES)
    assert split.of("test") == [("c", 0, 50)] and split.of("val") == []


def test_a_named_test_take_is_test_enough():
    split = split_clips({"a": 100, "b": 100, "c": 50}, {"c": "test"}, SHARES)
    assert [clip for clip, _, _ in split.of("train")] == ["a", "b"] and split.of("test") == [("c", 0, 50)]


def test_one_take_is_cut_in_time_with_a_notice():
    with pytest.warns(CospeechNotice, match="cut in time"):
        split = split_clips({"only": 100}, {}, SHARES)
    assert split.of("train") == [("only", 0, 80)] and split.of("test") == [("only", 90, 100)]


def test_empty_part_is_named():
    with pytest.raises(CospeechError, match="'test' is empty"):
        split_clips({"a": 100}, {"a": "train"}, SHARES)


def test_same_seed_same_split_other_seed_other(tmp_path):
    clips = {f"t{i}": 100 for i in range(12)}
    first, second = (split_clips(clips, {}, SHARES, seed=1) for _ in range(2))
    assert first == second
    assert any(split_clips(clips, {}, SHARES, seed=s) != first for s in range(2, 6))
    first.write(tmp_path / "split.h5")
    assert Split.read(tmp_path / "split.h5") == first
