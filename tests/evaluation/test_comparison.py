"""Networks of several seeds judged together: every number where it belongs, deviations over seeds, and the table."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from cospeech.evaluation.comparison import LIPS, SYNC, compare, write_comparison
from cospeech.evaluation.generated import generate_clips
from cospeech.evaluation.metrics.sync_classifier import WARNING, Settings, train_sync_classifier
from cospeech.evaluation.reference import Reference
from cospeech.evaluation.result import read_many, write_many


class Shaking:
    """A generator of a clip's own motion with noise of a size."""

    def __init__(self, clips, size):
        self.known, self.size = {clip.features.tobytes(): clip for clip in clips}, size

    def generate(self, features, *, seed=0):
        clip = self.known[features.tobytes()]
        noise = self.size * np.random.default_rng(seed).normal(size=clip.positions.shape)
        return replace(clip.motion, positions=clip.positions + noise)


@pytest.fixture(scope="module")
def compared(speaker, training_part, feature_net):
    takes = [speaker(seed) for seed in (20, 21)]
    turned = lambda clip: replace(clip, rotation=np.zeros((clip.frames, 3), "f4"))
    truth, train = {take[0].clip: turned(take[0]) for take in takes}, [turned(clip) for clip in training_part]
    reference = Reference.build(truth, train, feature_net, {take[0].clip: take[1:] for take in takes})
    settings = Settings(steps=30, batch=8, frames=32, width=0.1)
    classifiers = {seed: train_sync_classifier(train, settings, seed=seed)[0] for seed in (3, 5)}
    networks = {
        "steady": dict.fromkeys((3, 5), Shaking(truth.values(), 0.0)),
        "shaking": {3: Shaking(truth.values(), 0.03), 5: Shaking(truth.values(), 0.06)},
    }
    return compare(networks, truth, train, reference, classifiers), classifiers, truth


def one_of(found, row, seed):
    (one,) = [one for one in found if (one.row, one.seed) == (row, seed)]
    return one


def test_every_row_of_every_seed_is_judged(compared):
    found, classifiers, truth = compared
    rows = {"ground_truth", "mismatched", "mean_pose", "random", "steady", "shaking"}
    assert {(one.row, one.seed) for one in found} == {(row, seed) for row in rows for seed in (3, 5)}
    assert one_of(found, "steady", 3)["fgd"] < one_of(found, "shaking", 3)["fgd"] < one_of(found, "shaking", 5)["fgd"]
    # The published Gaussian is on the generated motion and, in the evaluation, on the truth: the same motion again.
    assert one_of(found, "steady", 5)["fgd"] == pytest.approx(0, abs=1e-3)
    assert one_of(found, "random", 3)["fgd"] != one_of(found, "random", 5)["fgd"]
    for seed, classifier in classifiers.items():
        share = np.mean([classifier.score(clip.features, clip.motion) for clip in truth.values()])
        assert one_of(found, "ground_truth", seed).attributes[SYNC] == pytest.approx(share)
    assert all(np.isnan(one.attributes[LIPS]) for one in found)  # the puppet has no face


def test_generated_clips_are_smoothed_as_published(compared):
    _, _, truth = compared
    made = generate_clips(Shaking(truth.values(), 0.05), truth, "gesture_gan", seed=1)
    raw = generate_clips(Shaking(truth.values(), 0.05), truth, "knn", seed=1)
    for name, clip in truth.items():
        assert made[name].extra["smoothing"] == 1.5 and raw[name].extra["smoothing"] == 0
        jerk = [np.abs(np.diff(clips[name].positions, n=3, axis=0)).mean() for clips in (made, raw)]
        assert jerk[0] < 0.1 * jerk[1]
        np.testing.assert_array_equal(made[name].features, clip.features)


def test_table_has_mean_and_deviation_over_seeds(compared, tmp_path):
    found = compared[0]
    write_many(tmp_path / "found.h5", found)
    again = read_many(tmp_path / "found.h5")
    attributes = [sorted(one_of(some, "shaking", 5).attributes.items()) for some in (again, found)]
    assert repr(attributes[0]) == repr(attributes[1])
    write_comparison(tmp_path / "table.csv", again, {"shaking": "shaking hands", "steady": "steady"})
    with open(tmp_path / "table.csv", newline="") as file:
        lines = {line["row"]: line for line in csv.DictReader(file)}
    assert list(lines) == ["ground_truth", "mismatched", "mean_pose", "random", "shaking hands", "steady"]
    values = [one_of(found, "shaking", seed)["jerk"] for seed in (3, 5)]
    assert float(lines["shaking hands"]["jerk [m/s^3]"]) == pytest.approx(np.mean(values), rel=1e-4)
    assert float(lines["shaking hands"]["jerk deviation [m/s^3]"]) == pytest.approx(np.std(values, ddof=1), rel=1e-4)
    assert lines["steady"]["runs"] == "2" and lines["steady"]["lip error [mm]"] == "n/a"
    assert {line["warning"] for line in lines.values()} == {WARNING}
