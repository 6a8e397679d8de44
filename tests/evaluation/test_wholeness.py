"""Motion as it is shown: bodies that come apart, borders that jump, frames that freeze, by known amounts."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from cospeech.clip import Trace
from cospeech.evaluation.baseline_rows import BASELINES
from cospeech.evaluation.evaluate import evaluate_baseline, evaluate_model
from cospeech.evaluation.metrics.wholeness import (
    MotionMetrics,
    border_step_ratio,
    frozen_frames,
    stressed_onsets,
    stroke_lags,
    stroke_times,
    window_borders,
)
from cospeech.evaluation.motion_table import HEADINGS, write_motion
from cospeech.evaluation.reference import Reference
from cospeech.skeleton import LEFT_HAND, UPPER55

LEFT_HIP, TIP = UPPER55.joints("left_hip", "right_index_3")
BONE_OF_TIP = [UPPER55.tree[TIP], TIP]


@pytest.fixture(scope="module")
def unseen(speaker):
    takes = [speaker(seed) for seed in (200, 201)]
    return {clip.clip: clip for clip, *_ in takes}, {clip.clip: tuple(sound) for clip, *sound in takes}


@pytest.fixture(scope="module")
def reference(unseen, training_part):
    return Reference.build(unseen[0], training_part, {}, unseen[1], metrics=MotionMetrics)


@pytest.fixture(scope="module")
def truth(reference):
    return evaluate_baseline("ground_truth", reference)


def judged(reference, clips, change):
    """The row of clips whose first one's positions `change` alters in place."""
    name, clip = next(iter(clips.items()))
    positions = clip.positions.copy()
    change(positions)
    return evaluate_model("m", clips | {name: replace(clip, positions=positions)}, reference)


def test_recorded_motion_is_whole(truth):
    whole = ("bone_mm", "hand_root_mm", "hip_mm", "frozen_frames")
    assert [truth[name] for name in whole] == pytest.approx([0] * 4, abs=1e-3)
    assert truth["border_step_ratio"] == pytest.approx(1, abs=0.2)


def test_a_longer_bone_is_found_in_millimetres(reference, unseen, truth):
    def stretch(positions):
        bone = np.diff(positions[7, BONE_OF_TIP], axis=0)[0]
        positions[7, TIP] += 0.005 * bone / np.linalg.norm(bone)

    found = judged(reference, unseen[0], stretch)
    assert found["bone_mm"] == pytest.approx(5, abs=1e-3) and found["hand_root_mm"] == truth["hand_root_mm"]


def test_a_hand_off_its_wrist_is_found_though_its_bones_are_whole(reference, unseen):
    def tear(positions):
        positions[7, LEFT_HAND] += np.array([0.0, 0.03, 0.0], "f4")

    found = judged(reference, unseen[0], tear)
    assert found["hand_root_mm"] == pytest.approx(30, abs=1e-3) and found["bone_mm"] == pytest.approx(0, abs=1e-3)


def test_hips_count_beyond_what_the_speaker_does(unseen, training_part):
    swaying = [replace(clip, positions=clip.positions.copy()) for clip in training_part]
    swaying[0].positions[5, LEFT_HIP, 2] += 0.05

    def push(positions):
        positions[9, LEFT_HIP, 2] += 0.211

    for train, expected in ((training_part, 211), (swaying, 211 - 50)):
        reference = Reference.build(unseen[0], train, {}, unseen[1], metrics=MotionMetrics)
        assert judged(reference, unseen[0], push)["hip_mm"] == pytest.approx(expected, abs=0.2)


def moving(steps):
    """(T, 55, 3): all joints go along x by these steps, in mm."""
    at = np.concatenate([[0], np.cumsum(steps)]) / 1000
    return np.zeros((len(at), 55, 3)) + at[:, None, None] * [1.0, 0.0, 0.0]


def test_border_steps_by_hand():
    steps = np.where(np.arange(1, 32) % 8 == 0, 10.0, 2.0)  # 10 mm into frames 8, 16 and 24
    assert border_step_ratio(moving(steps), window_borders(32)) == pytest.approx(5)
    assert np.isnan(border_step_ratio(moving(np.zeros(31)), window_borders(32)))
    assert np.isnan(border_step_ratio(moving([1.0, 2.0]), window_borders(3)))


def test_only_borders_at_which_the_source_jumps_count():
    """Frames 8..15 go on where 0..7 ended; 16 is from elsewhere in the take, 24 from another; 20 is no border."""
    time = np.arange(32) / 15 + np.where(np.arange(32) >= 16, 3.0, 0) + np.where(np.arange(32) >= 20, 1.0, 0)
    trace = Trace({"take": (np.arange(32) >= 24).astype(int), "time": time}, {"take": ["a", "b"]})
    assert np.flatnonzero(window_borders(32, trace)).tolist() == [0, 16, 24]
    steps = np.full(31, 2.0)
    steps[[7, 15, 23]] = 2.0, 6.0, 10.0
    assert border_step_ratio(moving(steps), window_borders(32, trace)) == pytest.approx(4)


def test_frozen_frames_count_where_the_speaker_moves():
    recorded = moving(np.where(np.arange(20) < 10, 3.0, 0.0))  # moves, then rests
    still = moving(np.where(np.isin(np.arange(20), [2, 3, 12]), 0.0, 1.0))
    assert frozen_frames(still, recorded) == 2
    assert frozen_frames(recorded, recorded) == 0


def test_frozen_frames_and_speeds_of_a_row(reference, unseen, truth):
    clips = {name: replace(clip, positions=clip.positions[::-1].copy()) for name, clip in unseen[0].items()}
    backwards = evaluate_model("m", clips, reference)
    for name in ("wrist_speed_p50", "wrist_speed_p95", "jerk"):
        assert backwards[name] == pytest.approx(truth[name], rel=1e-4)
    half = {n: replace(c, positions=(c.positions / 2).astype("f4")) for n, c in unseen[0].items()}
    assert evaluate_model("m", half, reference)["wrist_speed_p95"] == pytest.approx(truth["wrist_speed_p95"] / 2)

    def hold(positions):
        positions[40:44] = positions[40]

    assert judged(reference, unseen[0], hold)["frozen_frames"] == 3


def test_strokes_are_where_the_wrist_is_fastest(swing):
    at, middles = np.arange(120) / 15, np.array([1.5, 3.1, 5.0, 6.4])
    angle = sum(0.8 / (1 + np.exp(-(at - t) * 8)) * (-1) ** i for i, t in enumerate(middles))
    assert stroke_times(swing(angle), 15.0, 0.1) == pytest.approx(middles, abs=0.04)
    assert not stroke_times(swing(0.001 * angle), 15.0, 0.1).size


def test_lags_to_the_louder_onsets_by_hand():
    features = np.zeros((150, 28))
    features[[16, 47, 91], 13] = 2.0, 1.0, 3.0  # at 1.07, 3.13 and 6.07 s
    onsets = np.array([1.0, 3.0, 6.0])
    assert stressed_onsets(onsets, features, 15.0).tolist() == [1.0, 6.0]
    assert stroke_lags([1.1, 4.0], [1.0, 6.0]) == pytest.approx([0.1, 2.0])
    assert not stroke_lags([1.1], []).size


def test_strokes_of_the_speaker_are_nearer_to_the_speech_than_others(reference, truth):
    assert truth["stroke_lag_s"] < 0.7 * evaluate_baseline("mismatched", reference)["stroke_lag_s"]


def test_table(reference, unseen, training_part, feature_net, tmp_path):
    summary = Reference.build(unseen[0], training_part, feature_net, unseen[1])
    shown, others = ([evaluate_baseline(row, one) for row in BASELINES] for one in (reference, summary))
    write_motion(tmp_path / "motion.csv", shown, others)
    with open(tmp_path / "motion.csv", newline="") as file:
        lines = {line["row"]: line for line in csv.DictReader(file)}
    assert list(lines) == list(BASELINES) and tuple(lines["mean_pose"]) == HEADINGS
    still, recorded = lines["mean_pose"], lines["ground_truth"]
    nothing = ("border_step_ratio", "synchrony", "synchrony_deviation", "stroke_lag_s")
    assert [still[name] for name in nothing] == ["n/a"] * 4
    assert (still["jerk"], still["wrist_speed_p95"], still["seeds"]) == ("0", "0", "1")
    assert int(still["frozen_frames"]) > 500 and recorded["frozen_frames"] == "0"
    assert float(recorded["synchrony"]) == pytest.approx(others[0]["synchrony"], rel=1e-5)
    assert float(recorded["fgd_train"]) == pytest.approx(others[0]["fgd_train"], rel=1e-5)
