"""HA2G's table from clips to CSV, on puppets whose strokes start with the bursts of their speech."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.evaluation.baseline_rows import HA2G_BASELINES
from cospeech.evaluation.evaluate import evaluate_baselines, evaluate_model
from cospeech.evaluation.ha2g_tables import TABLE_1, write_ha2g
from cospeech.evaluation.metrics import gesture_metrics
from cospeech.evaluation.metrics.expressive import Settings
from cospeech.evaluation.metrics.fgd import train_feature_net
from cospeech.evaluation.metrics.ha2g import HA2GMetrics
from cospeech.evaluation.reference import Reference
from cospeech.evaluation.result import Evaluation, write_many
from cospeech.evaluation.tables import read_evaluations, summarise
from cospeech.files import writing_hdf5


@pytest.fixture(scope="module")
def test_part(speaker):
    """{id: Clip}, {id: sound}: three takes of one puppet, two of another."""
    takes = {f"a/{seed}": speaker(seed) for seed in (20, 21, 22)} | {f"b/{seed}": speaker(seed) for seed in (23, 24)}
    truth = {name: replace(clip, subject=name[0]) for name, (clip, *_) in takes.items()}
    return truth, {name: sound for name, (_, *sound) in takes.items()}


@pytest.fixture(scope="module")
def train_part(training_part):
    return [replace(clip, subject="ab"[i % 2]) for i, clip in enumerate(training_part)]


@pytest.fixture(scope="module")
def nets(train_part):
    quick = Settings(steps=40, batch=32)
    return {name: train_feature_net(train_part, quick, preset=name)[0] for name in ("expressive", "trimodal")}


def build(truth, train, nets, audio, **options):
    return Reference.build(truth, train, nets, audio, metrics=HA2GMetrics, subject="everyone", **options)


@pytest.fixture(scope="module")
def reference(test_part, train_part, nets):
    return build(test_part[0], train_part, nets, test_part[1])


def flat(evaluation):
    """All values and deviations of an Evaluation as one dict."""
    return {(name, i): float(pair[i]) for name, pair in evaluation.found.items() for i in (0, 1)}


@pytest.fixture(scope="module")
def baselines(reference):
    return evaluate_baselines(reference)


def test_truth_is_at_no_distance_from_itself_and_in_step_with_its_speech(baselines):
    rows = {one.row: one for one in baselines}
    truth, still = rows["ground_truth"], rows["mean_pose"]
    assert list(rows) == list(HA2G_BASELINES)
    assert truth["fgd_expressive"] == truth["fgd_trimodal"] == 0
    assert 0 < truth["fgd_train_expressive"] < rows["shuffled"]["fgd_train_expressive"] < still["fgd_train_expressive"]
    wrong = [one["bc"] for one in baselines if one.row == "mismatched"]
    assert len(wrong) == 2 and truth["bc"] > max(wrong) + 0.05
    assert truth["bc_excess"] > 0.05 > abs(np.mean([one["bc_excess"] for one in baselines if one.row == "mismatched"]))


def test_what_stands_still_is_counted_and_not_hidden(baselines):
    still = next(one for one in baselines if one.row == "mean_pose")
    assert still["bc"] == 0 and still["clips_still"] == 5 and still["clips_silent"] == 0
    assert np.isnan(still["bc_without_still"]) and np.isnan(still["bc_compat"]) and np.isnan(still["genea_cca_global"])
    assert still["diversity_trimodal"] < baselines[0]["diversity_trimodal"]


def test_a_perfect_generator_is_the_truth_and_a_lazy_one_is_not(test_part, reference, baselines):
    truth, _ = test_part
    perfect = evaluate_model("perfect", {n: replace(c, generator="perfect") for n, c in truth.items()}, reference)
    assert flat(perfect) == pytest.approx(flat(baselines[0]), nan_ok=True, abs=1e-6)
    assert perfect["genea_cca_global"] == pytest.approx(1)
    assert perfect["genea_hellinger_speed"] == pytest.approx(0, abs=1e-7)
    lazy = {n: replace(c, positions=gesture_metrics.low_pass(c.positions, 20.0)) for n, c in truth.items()}
    found = evaluate_model("lazy", lazy, reference, run=3)
    assert found.seed == 3 and found["fgd_expressive"] > 0.01 and found["genea_jerk"] < 0.2 * perfect["genea_jerk"]
    assert found["diversity_expressive"] < perfect["diversity_expressive"]


def test_ripple_hides_timing_from_beats_and_a_low_pass_shows_it_again(test_part, reference, baselines):
    truth, rng = test_part[0], np.random.default_rng(0)
    made = {n: replace(c, positions=c.positions + rng.normal(0, 0.003, c.positions.shape)) for n, c in truth.items()}
    rippled, plain = evaluate_model("rippled", made, reference), baselines[0]
    assert rippled["beat_rate"] > 1.5 * plain["beat_rate"] and rippled["bc_excess"] < 0.5 * plain["bc_excess"]
    assert rippled["beat_rate_low_passed"] < rippled["beat_rate"]
    assert rippled["bc_excess_low_passed"] > 1.5 * rippled["bc_excess"]


def test_what_a_generator_has_smoothed_is_not_low_passed_again(test_part, reference):
    smoothed = {name: replace(clip, extra={"smoothing": 1.5}) for name, clip in test_part[0].items()}
    found = evaluate_model("smoothed", smoothed, reference)
    assert [found[f"{name}_low_passed"] for name in ("bc", "beat_rate")] == [found["bc"], found["beat_rate"]]


def test_fgd_and_diversity_are_those_of_the_latents(test_part, reference, nets):
    truth, _ = test_part
    net, rng = nets["expressive"], np.random.default_rng(0)
    noisy = {n: replace(c, positions=c.positions + rng.normal(0, 0.01, c.positions.shape)) for n, c in truth.items()}
    latents, real = (
        np.concatenate([net.latents(clip.positions, clip.rotation) for clip in clips.values()])
        for clips in (noisy, truth)
    )
    found = evaluate_model("noisy", noisy, reference)
    assert found["fgd_expressive"] == pytest.approx(gesture_metrics.frechet_distance(latents, real), rel=1e-6)
    draws = [gesture_metrics.diversity(latents, pairs=500, seed=seed, norm=1) for seed in range(10)]
    assert found.found["diversity_expressive"] == pytest.approx((np.mean(draws), np.std(draws, ddof=1)))
    assert found["windows"] == len(latents) == 5 * len(range(0, 300 - 33, 10))


def test_invalid_frames_of_the_truth_count_in_no_row(test_part, train_part, nets):
    truth, audio = test_part
    at = np.arange(300)
    holes = {n: replace(c, valid=at >= 100) for n, c in truth.items()}
    reference = build(holes, train_part, nets, audio)
    wild = {n: np.where(at[:, None, None] < 100, 9.0, clip.positions) for n, clip in truth.items()}
    spoilt = {n: replace(clip, positions=wild[n]) for n, clip in truth.items()}
    found = evaluate_model("spoilt", spoilt, reference)
    assert found["fgd_expressive"] == 0 and found["windows"] == 5 * len(range(0, 200 - 33, 10))
    assert found["genea_hellinger_speed"] == pytest.approx(0, abs=1e-7)


def test_a_silent_clip_is_counted_and_scores_nothing(test_part, train_part, nets):
    truth, audio = test_part
    quiet = {name: sound for name, sound in audio.items() if name != "a/20"}
    some = evaluate_baselines(build(truth, train_part, {}, quiet, threshold=0.03))[0]
    rest = {name: clip for name, clip in truth.items() if name != "a/20"}
    only = evaluate_baselines(build(rest, train_part, {}, quiet, threshold=0.03))[0]
    assert some["clips_silent"] == 1 and only["clips_silent"] == 0
    assert some["bc"] == pytest.approx(only["bc"]) and some["onsets"] == only["onsets"]
    assert "fgd_expressive" not in some.found


def test_a_speakers_only_clip_is_mismatched_with_its_own_later_half(test_part, train_part):
    truth, audio = test_part
    rows = evaluate_baselines(build({"a/20": truth["a/20"]}, train_part, {}, audio))
    wrong = [one for one in rows if one.row == "mismatched"]
    assert len(wrong) == 1 and wrong[0]["bc"] < rows[0]["bc"]


def test_a_speaker_who_is_only_tested_has_everyones_mean_pose(test_part, train_part):
    truth, audio = test_part
    known = [clip for clip in train_part if clip.subject == "a"]
    reference = build(truth, known, {}, audio)
    assert np.array_equal(reference.mean_poses["b"][0], reference.mean_poses["a"][0])
    assert reference.mean_poses["a"][0] == pytest.approx(np.concatenate([c.positions for c in known]).mean(axis=0))


def test_clips_that_do_not_fit_are_refused(test_part, reference, train_part, nets):
    truth, audio = test_part
    with pytest.raises(CospeechError, match="half: no generated clip for test clip 'a/21'"):
        evaluate_model("half", {"a/20": truth["a/20"]}, reference)
    with pytest.raises(CospeechError, match="a/22: 250 frames at 15"):
        evaluate_model("short", truth | {"a/22": truth["a/22"].section(0, 250)}, reference)
    with pytest.raises(CospeechError, match="frames a second, the training part 15"):
        build(truth | {"b/23": replace(truth["b/23"], fps=30.0)}, train_part, nets, audio)
    with pytest.raises(CospeechError, match="no valid frame"):
        build({n: replace(c, valid=np.zeros(c.frames, bool)) for n, c in truth.items()}, train_part, {}, audio)
    with pytest.raises(CospeechError, match="has no clip"):
        build({}, train_part, nets, audio)


def test_files_and_tables_keep_what_was_found(tmp_path, baselines):
    none = (np.nan, np.nan)
    found = [{"fgd_expressive": (value, np.nan), "bc": none} for value in (1.0, 2.0, 6.0)]
    runs = [Evaluation.of("everyone", "m", run, one) for run, one in enumerate(found)]
    write_many(tmp_path / "a.h5", baselines)
    write_many(tmp_path / "b.h5", runs)
    back = read_evaluations([tmp_path / "a.h5", tmp_path / "b.h5"])
    truth = next(one for one in back if one.row == "ground_truth")
    assert flat(truth) == pytest.approx(flat(baselines[0]), nan_ok=True)
    assert truth.attributes["window_frames"] == 34
    rows = {"ground_truth": "Ground truth", "absent": "x", "m": "Model"}
    write_ha2g(tmp_path / "t.csv", back, rows, TABLE_1)
    head, first, second = csv.reader((tmp_path / "t.csv").read_text().splitlines())
    assert head[:4] == ["method", "runs", "fgd_expressive", "fgd_expressive deviation"]
    assert first[:3] == ["Ground truth", "1", "0"] and second[:2] == ["Model", "3"]
    assert [float(second[2]), float(second[3])] == pytest.approx([3.0, np.std([1, 2, 6], ddof=1)], rel=1e-5)
    assert second[head.index("bc")] == "n/a"
    assert summarise(runs[:1])[0].mean["fgd_expressive"] == 1.0
    with pytest.raises(CospeechError, match="run 0 of m is in another file"):
        read_evaluations([tmp_path / "b.h5", tmp_path / "b.h5"])


def test_a_file_of_an_earlier_version_is_read(tmp_path):
    with writing_hdf5(tmp_path / "old.h5", "cospeech.ha2g_evaluation") as file:
        group = file.create_group("ha2g/1")
        group.attrs["fps"], group["metric"] = 15.0, [b"fgd_expressive", b"bc"]
        group["value"], group["deviation"] = [2.0, 0.25], [np.nan, np.nan]
    (read,) = read_evaluations([tmp_path / "old.h5"])
    assert (read.row, read.seed, read["fgd_expressive"], read["bc"]) == ("ha2g", 1, 2.0, 0.25)
    assert read.attributes == {"fps": 15.0}
