"""A row of the results: baselines, models, invalid frames, missing sound, and the files."""

from dataclasses import replace

import numpy as np
import pytest

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.evaluation.baseline_rows import BASELINES
from cospeech.evaluation.columns import METRICS
from cospeech.evaluation.evaluate import evaluate_baseline, evaluate_model
from cospeech.evaluation.metrics.gesture_metrics import low_pass
from cospeech.evaluation.metrics.synchrony import SpeechToSpeed
from cospeech.evaluation.reference import Reference
from cospeech.evaluation.result import Evaluation
from cospeech.evaluation.takes import Take


@pytest.fixture(scope="module")
def unseen(speaker):
    """({clip id: Clip}, {clip id: (samples, rate)}) of three takes that were not trained on."""
    takes = [speaker(seed, seconds=30) for seed in (200, 201, 202)]
    return {clip.clip: clip for clip, *_ in takes}, {clip.clip: tuple(sound) for clip, *sound in takes}


@pytest.fixture(scope="module")
def reference(unseen, training_part, feature_net):
    return Reference.build(unseen[0], training_part, feature_net, unseen[1])


@pytest.fixture(scope="module")
def baselines(reference):
    return {row: evaluate_baseline(row, reference) for row in BASELINES}


def remade(clips, change):
    """The clips with other positions."""
    return {name: replace(clip, positions=change(clip.positions).astype(np.float32)) for name, clip in clips.items()}


def test_truth_beats_mismatched_truth_where_timing_counts_and_only_there(baselines):
    truth, mismatched = baselines["ground_truth"], baselines["mismatched"]
    assert truth["synchrony"] > 0.6 > mismatched["synchrony"] + 0.3
    assert truth["beat_consistency"] > mismatched["beat_consistency"] + 0.1
    assert truth["beat_excess"] > 0.1 > abs(mismatched["beat_excess"])
    for name in ("motion_variance", "jerk", "wrist_speed_left", "wrist_height_right", "fgd_train"):
        assert mismatched[name] == pytest.approx(truth[name], rel=1e-9)


def test_ground_truth_has_no_distance_to_itself_and_a_small_one_to_training(baselines):
    assert baselines["ground_truth"]["fgd"] == pytest.approx(0, abs=1e-9)
    assert 0 < baselines["ground_truth"]["fgd_train"] < baselines["mean_pose"]["fgd_train"] / 5
    assert baselines["ground_truth"]["speed_hellinger"] < 0.3 < baselines["mean_pose"]["speed_hellinger"]


def test_mean_pose_does_not_move_and_has_no_synchrony(baselines):
    mean = baselines["mean_pose"]
    still = ("motion_variance", "jerk", "wrist_speed_left", "diversity", "beat_rate", "beat_consistency")
    assert [mean[name] for name in still] == pytest.approx([0] * len(still), abs=1e-9)
    assert np.isnan(mean["synchrony"])


def test_a_model_that_repeats_the_truth_scores_as_the_truth(reference, baselines, unseen):
    row = evaluate_model("copy", unseen[0], reference)
    assert np.array_equal(row.mean, baselines["ground_truth"].mean, equal_nan=True)
    assert row.row == "copy"


def test_smoothed_clips_are_not_smoothed_again(reference, baselines, unseen):
    once = {
        name: replace(clip, extra={"smoothing": 1.5}, positions=low_pass(clip.positions, 1.5))
        for name, clip in unseen[0].items()
    }
    again = {name: replace(clip, extra={}) for name, clip in once.items()}
    truth = baselines["ground_truth"]
    assert evaluate_model("m", once, reference)["jerk"] == pytest.approx(truth["jerk"], rel=1e-6)
    assert evaluate_model("m", again, reference)["jerk"] < 0.8 * truth["jerk"]


def test_damped_motion_is_farther_and_less_varied(reference, baselines, unseen):
    row = evaluate_model("damped", remade(unseen[0], lambda p: 0.3 * p + 0.7 * p.mean(axis=0)), reference)
    truth, mean = baselines["ground_truth"], baselines["mean_pose"]
    assert truth["fgd"] < row["fgd"] < mean["fgd"]
    assert mean["diversity"] < row["diversity"] < truth["diversity"]
    assert row["motion_variance"] == pytest.approx(0.09 * truth["motion_variance"], rel=1e-5)


def test_invalid_frames_do_not_count(training_part, feature_net, unseen):
    clips, audio = unseen
    valid = np.ones(450, bool)
    valid[200:230] = False
    masked = {name: replace(clip, valid=valid) for name, clip in clips.items()}

    def spoil(positions):
        spoilt = positions.copy()
        spoilt[205:225] += 5 * np.random.default_rng(0).normal(size=(20, 55, 3))
        return spoilt

    rows = []
    for truth in (masked, remade(masked, spoil)):
        reference = Reference.build(truth, training_part, feature_net, audio, sigma=0.0)
        rows.append(evaluate_baseline("ground_truth", reference))
    assert np.array_equal(rows[0].values, rows[1].values, equal_nan=True)
    assert np.array_equal(rows[0].mean, rows[1].mean, equal_nan=True)
    whole = Reference.build(remade(clips, spoil), training_part, feature_net, audio, sigma=0.0)
    assert evaluate_baseline("ground_truth", whole)["jerk"] > 2 * rows[0]["jerk"]


def test_pieces_are_long_valid_runs_with_their_own_clock():
    valid = np.zeros(150, bool)
    valid[10:50] = valid[60:80] = valid[90:150] = True  # 40, 20 and 60 frames
    take = Take(np.arange(150), np.arange(150), valid, np.array([0.2, 1.0, 4.5, 6.4, 9.9]), 15.0)
    first, second = take.pieces()
    assert (first.positions[0], len(first.positions), second.features[0], len(second.features)) == (10, 40, 90, 60)
    assert first.onsets == pytest.approx([1.0 - 10 / 15])
    assert second.onsets == pytest.approx([6.4 - 6, 9.9 - 6])
    take.valid[:50] = take.valid[90:] = False
    assert [len(piece.positions) for piece in take.pieces()] == [20]


def test_a_mismatched_frame_counts_where_motion_and_speech_are_both_valid():
    frames = np.arange(120)
    motion = Take(frames, frames, frames >= 20, np.array([1.0]), 15.0)
    speech = Take(frames[:100] + 500, frames[:100] + 500, frames[:100] < 90, np.array([2.0, 6.6]), 15.0)
    under = motion.with_speech_of(speech)
    assert np.flatnonzero(under.valid).tolist() == list(range(20, 90))
    assert (under.positions[0], under.features[0], len(under.features)) == (0, 500, 100)
    assert under.onsets == pytest.approx([2.0, 6.6])


def test_a_single_clip_is_mismatched_by_its_halves(training_part, feature_net, speaker):
    clip, samples, rate = speaker(300, seconds=40)
    reference = Reference.build({"one": clip}, training_part, feature_net, {"one": (samples, rate)})
    truth, mismatched = (evaluate_baseline(row, reference) for row in ("ground_truth", "mismatched"))
    assert mismatched.clips == ["one first half", "one second half"]
    assert truth["synchrony"] > mismatched["synchrony"] + 0.3
    assert truth["jerk"] == pytest.approx(mismatched["jerk"], rel=0.05)  # no jump was made in the motion
    assert np.isnan(truth.deviation[list(METRICS).index("jerk")])  # one clip has no deviation


def test_without_sound_beat_consistency_alone_does_not_apply(training_part, feature_net, unseen):
    row = evaluate_baseline("ground_truth", Reference.build(unseen[0], training_part, feature_net, {}))
    absent = {name for name in METRICS if np.isnan(row[name])}
    assert absent == {"beat_consistency", "beat_excess"}


def test_short_test_clips_have_no_fgd_and_say_so(training_part, feature_net, unseen):
    clips = {name: clip.section(0, 30) for name, clip in unseen[0].items()}
    reference = Reference.build(clips, training_part, feature_net, {})
    with pytest.warns(CospeechNotice, match="fewer than two windows"):
        row = evaluate_baseline("ground_truth", reference)
    assert np.isnan(row["fgd"]) and np.isnan(row["diversity"]) and row["jerk"] > 0


def test_clips_that_do_not_belong_are_refused(reference, unseen, feature_net, training_part):
    name, clip = next(iter(unseen[0].items()))
    with pytest.raises(CospeechError, match=r"no generated clip for test clip 'take20\d'"):
        evaluate_model("m", {name: clip}, reference)
    with pytest.raises(CospeechError, match=r"449 frames at 15\.0 fps, its truth 450"):
        evaluate_model("m", unseen[0] | {name: clip.section(0, 449)}, reference)
    with pytest.raises(CospeechError, match="no valid frame"):
        Reference.build({name: replace(clip, valid=np.zeros(450, bool))}, training_part, feature_net, {})
    with pytest.raises(CospeechError, match="known: ground_truth, mismatched, mean_pose"):
        evaluate_baseline("random", reference)


def test_an_evaluation_file_holds_what_was_found(baselines, tmp_path):
    written = baselines["mean_pose"]
    for name in ("a.h5", "b.h5"):
        written.write(tmp_path / name)
    read = Evaluation.read(tmp_path / "a.h5")
    for name in ("values", "mean", "deviation", "frames"):
        assert np.array_equal(getattr(read, name), getattr(written, name), equal_nan=True)
    assert (read.subject, read.row, read.seed, read.clips) == ("puppet", "mean_pose", 0, written.clips)
    assert read.attributes == written.attributes
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_synchrony_is_found_at_any_gain_and_lost_under_other_speech(speaker):
    takes = [speaker(seed)[0] for seed in range(400, 406)]
    fit = SpeechToSpeed.fit([c.features for c in takes[:4]], [c.positions for c in takes[:4]])
    a, b = takes[4:]
    assert fit.synchrony(a.features, a.positions) > 0.6
    mean = a.positions.mean(axis=0)
    assert fit.synchrony(a.features, mean + 0.5 * (a.positions - mean)) > 0.6
    assert abs(fit.synchrony(a.features, b.positions)) < 0.35
    assert np.isnan(fit.synchrony(np.zeros_like(a.features), a.positions))
