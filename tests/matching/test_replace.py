"""Frame replacement: these frames from that clip, exactly, led to and back, with the motion's own bones."""

import numpy as np
import pytest

from cospeech.clip import Clip
from cospeech.errors import CospeechError
from cospeech.matching.control.replace import Replacement, replaced
from cospeech.matching.search.seams import BLEND
from cospeech.skeleton import bone_lengths, to_parent_relative
from tests.conftest import make_clip

FPS = 15.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory, toy_clips):
    folder = tmp_path_factory.mktemp("sources")
    toy_clips[1].write(folder / "other.h5")
    Clip("toy", "big", FPS, toy_clips[1].positions * np.float32(1.3), toy_clips[1].features).write(folder / "big.h5")
    Clip("toy", "fast", 30.0, toy_clips[1].positions, toy_clips[1].features).write(folder / "fast.h5")
    return folder


def test_frames_are_those_of_the_clip_and_lead_there_and_back(folder, toy_clips):
    own, other = toy_clips[0], toy_clips[1]
    made = replaced(own.motion, [f"3.0-4.5={folder / 'other.h5'}@10.2"], FPS)
    inside, source = slice(45, 68), slice(153, 176)
    np.testing.assert_allclose(made.positions[inside], other.positions[source], atol=1e-5)
    np.testing.assert_allclose(made.rotation[inside], other.rotation[source], atol=1e-5)
    np.testing.assert_allclose(made.expression[inside], other.expression[source], atol=1e-5)
    outside = np.r_[0 : 45 - BLEND, 68 + BLEND : 256]
    for name in ("positions", "rotation", "expression"):
        assert np.array_equal(getattr(made, name)[outside], getattr(own, name)[outside])
    jumps = np.linalg.norm(np.diff(made.positions, axis=0), axis=2).mean(axis=1)
    hard = own.positions.copy()
    hard[inside] = other.positions[source]
    worst = np.linalg.norm(np.diff(hard, axis=0), axis=2).mean(axis=1)
    assert (jumps[[44, 67]] < 0.6 * worst[[44, 67]]).all()
    assert np.array_equal(own.positions, make_clip(0).positions), "the motion that was given is left as it was"


def test_bones_keep_their_lengths_whoever_the_source_is(folder, toy_clips):
    made = replaced(toy_clips[0].motion, [Replacement(3.0, 4.5, str(folder / "big.h5"), 10.2)], FPS)
    found = np.linalg.norm(to_parent_relative(made.positions.astype(float)), axis=-1)
    assert np.abs(found - bone_lengths(toy_clips[0].positions)).max() < 1e-5


def test_without_a_time_the_stretch_that_joins_best_is_taken(folder, toy_clips):
    """Of a clip's own motion that is the motion itself."""
    made = replaced(toy_clips[1].motion, [{"start": 6.0, "end": 8.0, "clip": str(folder / "other.h5")}], FPS)
    np.testing.assert_allclose(made.positions, toy_clips[1].positions, atol=1e-5)
    assert np.abs(made.trace.columns["time"][90:120] - np.arange(90, 120) / FPS).max() < 1.5 / FPS


def test_the_trace_tells_of_it(folder, toy_clips):
    text = f"3-4.5={folder / 'other.h5'}@10.2"
    trace = replaced(toy_clips[0].motion, [text], FPS).trace
    assert [text] * 23 == trace.texts("control")[45:68] and set(trace.texts("control")[:45]) == {""}
    assert set(trace.texts("take")[45:68]) == {"other.h5"}
    np.testing.assert_allclose(trace.columns["time"][45:68], (153 + np.arange(23)) / FPS)


@pytest.mark.parametrize(("first", "last"), [(0.0, 1.0), (16.0, 17.0667), (0.0, 17.0667)])
def test_at_the_ends_of_a_motion(folder, toy_clips, first, last):
    made = replaced(toy_clips[0].motion, [Replacement(first, last, str(folder / "other.h5"), 0.0)], FPS)
    a, b = round(first * FPS), round(last * FPS)
    np.testing.assert_allclose(made.positions[a:b], toy_clips[1].positions[: b - a], atol=1e-5)


MISTAKES = {
    "3-4": ["START-END=CLIP"],
    "soon=other.h5": ["START-END=CLIP"],
    "4-3=other.h5@1": ["4-3=other.h5@1", "after its start"],
    "3-3.01=other.h5@1": ["one frame"],
    "16-18=other.h5@1": ["17.07 s"],
    "3-5=other.h5@16": ["other.h5", "too short", "2.00 s", "17.07 s"],
    "3-5=absent.h5": ["absent.h5", "no such file"],
    "3-5=fast.h5": ["fast.h5", "30 fps", "15"],
    "3-5=note.txt": ["note.txt"],
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_one_line(folder, toy_clips, monkeypatch, text):
    monkeypatch.chdir(folder)
    (folder / "note.txt").write_text("no clip")
    with pytest.raises(CospeechError) as error:
        replaced(toy_clips[0].motion, [text], FPS)
    assert all(word in str(error.value) for word in MISTAKES[text]) and "\n" not in str(error.value)


def test_two_replacements_follow_each_other_but_do_not_overlap(folder, toy_clips):
    clip = str(folder / "other.h5")
    both = [Replacement(5.0, 6.0, clip, 2.0), Replacement(3.0, 5.0, clip, 8.0)]
    made = replaced(toy_clips[0].motion, both, FPS).positions
    np.testing.assert_allclose(made[75 + BLEND : 90], toy_clips[1].positions[30 + BLEND : 45], atol=1e-5)
    np.testing.assert_allclose(made[45 : 75 - BLEND], toy_clips[1].positions[120 : 150 - BLEND], atol=1e-5)
    with pytest.raises(CospeechError, match="both want the same frames"):
        replaced(toy_clips[0].motion, [*both, Replacement(4.5, 5.5, clip, 1.0)], FPS)
    with pytest.raises(CospeechError, match="expected start, end, clip"):
        replaced(toy_clips[0].motion, [{"start": 1, "clip": clip}], FPS)
