"""Tables 5.3 and 5.4 and figure 5.5: numbers that can be worked out by hand, and a real search under them."""

import csv
import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from cospeech.clip import Motion
from cospeech.errors import CospeechError
from cospeech.evaluation.control import FREE, TABLE, ControlStudy, control_rows, study_controls, write_csv, write_hdf5
from cospeech.evaluation.reference import Reference
from cospeech.evaluation.result import Evaluation
from cospeech.evaluation.tables import write_csv as write_table
from cospeech.evaluation.variants import METRICS, VARIANTS, evaluate_variants, ordered
from cospeech.matching import KNN, Database
from cospeech.matching.control.controlled_sampler import ControlledSampler
from cospeech.matching.control.signals import LEFT
from cospeech.render.curves import plot_control
from cospeech.render.pages.control_section import control_section

HIGH, SLOW = ("left_wrist_height", "high"), ("left_wrist_speed", "slow")


@pytest.fixture
def study():
    """Two clips, the second one's last frame invalid; heights around 0.2, speeds around 1."""
    valid = {"a": np.ones(4, bool), "b": np.array([True, True, False])}
    series = {}
    for clip, knn, resync in (("a", [0.3, 0.3, 0.2, 0.1], [0.3, 0.2, 0.2, 0.2]), ("b", [0.4, 0.4, 9], [0.3, 0.3, 9])):
        for model, values in (("knn", knn), ("resync", resync)):
            height = np.array(values, "f4")
            series |= {(clip, model, *HIGH): height, (clip, model, HIGH[0], FREE): height - np.float32(0.15)}
            series |= {(clip, model, *SLOW): height * 5, (clip, model, SLOW[0], FREE): height * 10}
    return ControlStudy("ada", 15.0, {HIGH: 0.25, SLOW: 1.2}, valid, series)


def test_rows_by_hand(study):
    rows = {(row.signal, row.model): row for row in control_rows(study)}
    knn, resync = rows["left_wrist_height", "knn"], rows["left_wrist_height", "resync"]
    values = np.array([0.3, 0.3, 0.2, 0.1, 0.4, 0.4])
    assert (knn.mean, knn.deviation) == pytest.approx((values.mean(), values.std(ddof=1)))
    assert (knn.kept, resync.kept) == pytest.approx((4 / 6, 3 / 6)) and np.isnan(knn.change)
    assert resync.change == pytest.approx((0 + 0.1 + 0 + 0.1 + 0.1 + 0.1) / 6)
    assert (knn.free_mean, knn.free_kept) == pytest.approx((values.mean() - 0.15, 2 / 6))
    assert (knn.threshold, knn.unit, knn.frames, knn.clips) == (0.25, "m", 6, 2)
    assert rows["left_wrist_speed", "knn"].kept == pytest.approx(2 / 6)  # a lower level: at or under 1.2 m/s


def test_file_round_trip(study, tmp_path):
    study.write(tmp_path / "control.h5")
    assert repr(control_rows(ControlStudy.read(tmp_path / "control.h5"))) == repr(control_rows(study))
    with pytest.raises(CospeechError, match="no such file"):
        ControlStudy.read(tmp_path / "none.h5")


def test_tables_on_disk(study, tmp_path):
    rows = control_rows(study)
    write_csv(tmp_path / "t.csv", rows)
    write_hdf5(tmp_path / "t.h5", rows)
    with open(tmp_path / "t.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    assert [(line["signal"], line["level"], line["model"]) for line in lines] == [
        (*HIGH, "knn"),
        (*HIGH, "resync"),
        (*SLOW, "knn"),
        (*SLOW, "resync"),
    ]
    assert (lines[0]["change"], lines[0]["threshold"], lines[0]["unit"]) == ("n/a", "0.25", "m")
    with h5py.File(tmp_path / "t.h5") as file:
        np.testing.assert_allclose(file["kept"][()], [row.kept for row in rows])
        assert list(file["model"][()]) == [b"knn", b"resync"] * 2


@pytest.fixture(scope="module")
def puppet(training_part, speaker):
    return KNN(Database.from_clips(training_part)), {"t": speaker(50)[0], "u": speaker(51, seconds=12)[0]}


@pytest.fixture(scope="module")
def searched(puppet):
    return study_controls("puppet", {"knn": puppet[0]}, puppet[1], seed=4)


def test_a_search_under_control_goes_where_it_is_sent(puppet, searched):
    rows = {(row.signal, row.level): row for row in control_rows(searched)}
    assert list(rows) == list(TABLE)
    for (signal, level), row in rows.items():
        percentile = 85 if level in ("high", "fast", "asymmetric") else 15
        assert row.threshold == pytest.approx(puppet[0].signals.percentile(signal, percentile), abs=1e-6)
        assert row.kept > row.free_kept + 0.2 and row.frames == 300 + 180, (signal, level)
    assert rows["left_wrist_height", "high"].mean > rows["left_wrist_height", "low"].mean


class Told:
    """A control variant: its target on every frame is the height of the left wrist, or the signal asked for is 0."""

    targets, description = {15: 0.1, 50: 0.2, 85: 0.3}, {"fps": 15.0}

    def generate(self, features, *, seed, temperature, target):
        positions = np.zeros((len(features), 55, 3))
        positions[:, LEFT, 1] = target
        return Motion(positions)


def test_a_network_for_each_signal_is_asked_for_its_own(puppet):
    """MoGlow's column of Table 5.3: thresholds become targets, no control the median, and k-NN is nothing to refine."""
    knn, clips = puppet
    told = {signal: ControlledSampler(signal, Told()) for signal, _ in TABLE}
    study = study_controls("puppet", {"knn": knn, "moglow": told}, clips, seed=4)
    rows = {(row.signal, row.level): row for row in control_rows(study) if row.model == "moglow"}
    for level, target in (("high", 0.3), ("low", 0.1)):
        row = rows["left_wrist_height", level]
        assert (row.mean, row.deviation, row.free_mean) == pytest.approx((target, 0, 0.2)) and np.isnan(row.change)
    assert rows["left_wrist_speed", "slow"].mean == 0 and rows["symmetry", "asymmetric"].mean == pytest.approx(0.3)


def test_figures_are_the_same_bytes_for_the_same_numbers(searched, tmp_path):
    for kind in ("png", "svg"):
        one, two = tmp_path / f"one.{kind}", tmp_path / f"two.{kind}"
        plot_control(one, searched)
        plot_control(two, searched, clip="t")
        assert one.read_bytes() == two.read_bytes()
    drawn = (tmp_path / "one.svg").read_text()
    for text in ("left wrist height: high", "left wrist speed: slow", "threshold", "k-NN, unconstrained", "puppet, t"):
        assert text in drawn
    with pytest.raises(CospeechError, match=r"\.jpg.*\.png \.svg"):
        plot_control(tmp_path / "x.jpg", searched)


def test_section_of_the_report_holds_rows_and_pictures(study, tmp_path):
    (tmp_path / "c.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    html = control_section(control_rows(study), [("figure <1>", tmp_path / "c.svg")])
    assert html.count("<tr>") == 1 + 4 and "data:image/svg+xml;base64," in html and "figure &lt;1&gt;" in html
    assert re.search(r"left wrist height = high</td><td>k-NN</td><td>0.250 m</td><td>0.283 ± 0.117</td><td>67 %", html)
    assert control_section([], []) == ""


def test_variants_are_judged_and_stand_in_the_tables_order(puppet, training_part, feature_net, tmp_path):
    knn, clips = puppet
    reference = Reference.build(clips, training_part, feature_net, {})
    found = evaluate_variants(knn, clips, reference, seed=4)
    assert list(found) == list(VARIANTS) and all(np.isfinite(e["fgd"]) for e in found.values())
    again = knn.generate(clips["t"].features, seed=4, variant="pose_only")
    assert found["knn_pose_only"].values.shape[0] == 2 and len(again) == 300
    head = found["knn_audio"]
    row = lambda name: Evaluation("puppet", name, 4, head.clips, head.frames, head.values, head.mean, head.deviation)
    everything = ordered([row("resync"), *found.values(), row("knn"), row("ground_truth"), row("gesture_gan")])
    names = [e.row for e in everything]
    assert names == [
        "ground_truth",
        "gesture_gan",
        "knn_pose_only",
        "knn_audio",
        "knn",
        "knn_mean_pose",
        "knn_fifth",
        "resync",
    ]
    write_table(tmp_path / "t.csv", everything, METRICS)
    header = Path(tmp_path / "t.csv").read_text().splitlines()[0].split(",")
    assert len(header) == 4 + 2 * len(METRICS) and header[4] == "fgd"


def test_a_fifth_best_of_fewer_clips_is_the_last(training_part, feature_net, speaker):
    clips = {"t": speaker(50)[0]}
    tiny = KNN(Database.from_clips(training_part[:1]))
    reference = Reference.build(clips, training_part, feature_net, {})
    assert np.isfinite(evaluate_variants(tiny, clips, reference)["knn_fifth"]["fgd"])
