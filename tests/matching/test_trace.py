"""The trace: every generated frame is the take's own at the time it tells, in the file as in memory."""

import numpy as np
import pytest

from cospeech.clip import Clip, Words
from cospeech.commands.describe import describe
from cospeech.matching import KNN, Database
from cospeech.matching.control.keywords import Keyword
from cospeech.matching.explain import explain

FPS = 15.0


@pytest.fixture(scope="module")
def takes(random_takes):
    """Positions and features of three stretches; the first take has two of them, the second begins at 40 s."""
    return random_takes(np.random.default_rng(7), (200, 140, 150))


@pytest.fixture(scope="module")
def motion(takes):
    said = [Words.none(), Words(np.array([3.0]), np.array([3.2]), ["there"]), Words.none()]
    knn = KNN(Database.from_arrays(*takes, ["a", "a", "b"], starts=[0.0, 40.0, 0.0], words=said))
    words = Words(np.array([4.0]), np.array([4.4]), ["far"])
    controls = ["left_wrist_height=high@6-", Keyword("far", "there")]
    return knn.generate(np.zeros((155, 28)), controls=controls, words=words, k=2, seed=3)


def test_every_frame_is_the_takes_own_at_the_time_it_tells(takes, motion):
    stretches = {("a", 0): takes[0][0], ("a", 1): takes[0][1], ("b", 0): takes[0][2]}
    seen = set()
    for t, (take, time) in enumerate(zip(motion.trace.texts("take"), motion.trace.columns["time"], strict=True)):
        late = take == "a" and time >= 40
        source = stretches[take, int(late)][round((time - 40 * late) * FPS)]
        assert np.array_equal(motion.positions[t], source)
        seen.add((take, late))
    assert len(seen) > 1


def test_it_tells_ranks_distances_and_what_was_asked(motion):
    trace = motion.trace
    texts, columns = trace.texts("control"), trace.columns
    called = np.flatnonzero(np.array(texts) == "far=there")
    assert 63 in called and called[0] % 8 == 0 and len(called) in (16, 24)  # the middle of 4.0 to 4.4 s
    assert set(texts[96:]) == {"left_wrist_height=high@6-"} and set(texts[:40]) == {""}
    assert (columns["pose_rank"][called] == -1).all() and (columns["pose_distance"][called] == -1).all()
    others = np.setdiff1d(np.arange(155), called)
    assert (columns["pose_distance"][others] > 0).all()
    assert (columns["candidates"][96:] < columns["candidates"][0]).all()
    assert trace.settings == {"seams": "off", "k": 2, "seed": 3}


def test_a_clip_keeps_it_through_write_read_and_section(motion, tmp_path, toy_clips):
    features = np.zeros((155, 28), np.float32)
    Clip("s", "talk", FPS, motion.positions, features, trace=motion.trace).write(tmp_path / "talk.h5")
    read = Clip.read(tmp_path / "talk.h5")
    for part, cut in ((read, slice(0, 155)), (read.section(20, 90), slice(20, 90))):
        assert part.trace.settings == motion.trace.settings
        for name, column in motion.trace.columns.items():
            assert np.array_equal(part.trace.columns[name], column[cut]) and len(part.trace.columns[name]) == len(part)
        assert part.trace.texts("take") == motion.trace.texts("take")[cut]
    part.write(tmp_path / "part.h5")
    assert Clip.read(tmp_path / "part.h5").trace.texts("control") == motion.trace.texts("control")[20:90]
    assert "trace/" in describe(tmp_path / "part.h5") and "pose_rank" in describe(tmp_path / "part.h5")
    toy_clips[0].write(tmp_path / "recorded.h5")
    assert Clip.read(tmp_path / "recorded.h5").trace is None


def test_the_table_has_a_line_per_window(motion):
    lines = explain(motion.trace, FPS).splitlines()
    assert len(lines) == 2 + 20 and lines[0] == "seams off, k 2, seed 3"
    rows = [line for line in lines if "far=there" in line]
    assert all(" - " in row for row in rows) and len(rows) in (2, 3)
    assert lines[-1].startswith("10.13") and lines[-1].endswith("left_wrist_height=high@6-")
