"""The sync classifier: it tells belonging from not on takes it never saw, and cannot where there is nothing to tell."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from cospeech.clip import Motion
from cospeech.errors import CospeechError
from cospeech.evaluation.metrics.sync_classifier import (
    WARNING,
    Settings,
    SyncClassifier,
    train_sync_classifier,
    write_accuracies,
    write_judgement,
)
from tests.conftest import make_clip

SMALL = Settings(steps=250, batch=16, frames=32, width=0.1, learning_rate=2e-3, noise=0.3)


@pytest.fixture(scope="module")
def classifier():
    return train_sync_classifier([make_clip(seed, 512) for seed in range(3)], SMALL, seed=0)[0]


def test_tells_unseen_takes_apart(classifier):
    accuracy = classifier.accuracy([make_clip(8), make_clip(9)])
    assert accuracy["combined"] > 0.8 and min(accuracy.values()) > 0.6
    assert accuracy["combined"] == pytest.approx((accuracy["in_sync"] + accuracy["off_sync"]) / 2)


def test_cannot_tell_where_speech_says_nothing():
    """Features that have nothing to do with the motion: no more than chance on unseen takes."""
    noise = [replace(make_clip(seed, 512), features=make_clip(seed + 50, 512).features) for seed in range(5)]
    classifier, _ = train_sync_classifier(noise[:3], replace(SMALL, steps=60), seed=0)
    assert 0.3 < classifier.accuracy(noise[3:])["combined"] < 0.7


def test_threshold_is_found_on_clips_of_its_own(classifier, tmp_path):
    """A classifier that takes nearly everything for off sync finds its way back."""
    biased = SyncClassifier(classifier.network, classifier.description | {"threshold": 60.0})
    test = [make_clip(8), make_clip(9)]
    assert biased.accuracy(test)["combined"] < 0.65
    again = biased.calibrated([make_clip(6), make_clip(7)])
    assert again.accuracy(test)["combined"] > 0.8 and abs(again.description["threshold"]) < 30
    again.save(tmp_path / "sync.safetensors")
    assert SyncClassifier.load(tmp_path / "sync.safetensors").accuracy(test) == again.accuracy(test)
    assert biased.calibrated([make_clip(6, 40)]) is biased and biased.calibrated([]) is biased


def test_score_is_the_share_of_windows_in_sync(classifier):
    clip, other = make_clip(8), make_clip(9)
    whole = classifier.score(clip.features, clip.motion)
    none = classifier.score(clip.features, other.motion)
    assert whole > 0.6 and none < 0.3
    half = Motion(
        *(
            np.concatenate([a[:128], b[128:]])
            for a, b in ((clip.positions, other.positions), (clip.rotation, other.rotation))
        )
    )
    assert none < classifier.score(clip.features, half) < whole
    assert np.isnan(classifier.score(clip.features[:31], clip.section(0, 31).motion))


def test_one_test_clip_is_mismatched_with_itself_elsewhere(classifier):
    assert classifier.accuracy([make_clip(8, 512)])["combined"] > 0.75
    with pytest.raises(CospeechError, match="mismatching needs two takes"):
        classifier.accuracy([make_clip(8, 40)])
    with pytest.raises(CospeechError, match="no clip has the 32 frames"):
        classifier.accuracy([make_clip(8, 31)])


def test_saved_and_loaded_is_the_same(classifier, tmp_path):
    classifier.save(tmp_path / "sync.safetensors")
    again = SyncClassifier.load(tmp_path / "sync.safetensors")
    clip = make_clip(7)
    given = classifier.windows(clip.features, clip.motion)
    np.testing.assert_array_equal(again.logits(given), classifier.logits(given))
    assert again.frames == 32


def test_same_seed_same_bytes(classifier, tmp_path):
    again, _ = train_sync_classifier([make_clip(seed, 512) for seed in range(3)], SMALL, seed=0)
    classifier.save(tmp_path / "a"), again.save(tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_window_that_cannot_be_pooled_is_refused():
    with pytest.raises(CospeechError, match="20 frames is not a multiple of 8"):
        train_sync_classifier([make_clip()], replace(SMALL, frames=20))


def test_table(tmp_path):
    accuracy = {"in_sync": 0.827, "off_sync": 0.921, "combined": 0.874}
    write_judgement(tmp_path / "a.h5", "oliver", 64, accuracy, {"ground_truth": 0.8, "knn": 0.5})
    write_judgement(tmp_path / "b.h5", "oliver", 32, accuracy, {"ground_truth": 0.7, "knn": np.nan})
    write_accuracies(tmp_path / "table.csv", [tmp_path / "a.h5", tmp_path / "b.h5"])
    with open(tmp_path / "table.csv", newline="") as file:
        first, second = csv.DictReader(file)
    assert [first[f"{name} [%]"] for name in ("in_sync", "off_sync", "combined")] == ["82.7", "92.1", "87.4"]
    assert first["knn judged in sync [%]"] == "50.0" and second["knn judged in sync [%]"] == "n/a"
    assert first["warning"] == WARNING and second["frames"] == "32"


def test_table_over_seeds_has_the_samples_deviation(tmp_path):
    accuracy = {"in_sync": 0.8, "off_sync": 0.8, "combined": 0.8}
    paths = [tmp_path / f"{seed}.h5" for seed in range(3)]
    for seed, share in enumerate((0.1, 0.2, 0.6)):
        write_judgement(paths[seed], "oliver", 64, accuracy, {"knn": share}, seed)
    write_accuracies(tmp_path / "table.csv", paths)
    write_accuracies(tmp_path / "one.csv", paths[:1])
    with open(tmp_path / "table.csv", newline="") as several, open(tmp_path / "one.csv", newline="") as single:
        (line,), (alone,) = csv.DictReader(several), csv.DictReader(single)
    assert (line["knn judged in sync [%]"], line["runs"]) == ("30.0", "3")
    assert line["knn judged in sync deviation [%]"] == "26.5"  # root of (20^2 + 10^2 + 30^2) / 2
    assert (alone["knn judged in sync [%]"], alone["knn judged in sync deviation [%]"]) == ("10.0", "n/a")
