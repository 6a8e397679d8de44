"""The k-NN generator and the training fakes of the resynchroniser."""

import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.matching import KNN, Database, fake_pairs
from cospeech.matching.knn import motion_of


def sources(database, motion):
    """(take, clip) of every 8-frame window of a motion (T, 55, 3), looked up by its frames."""
    found = []
    for window in motion.reshape(-1, 8, 55, 3):
        hits = [np.argwhere((database.positions == frame).all(axis=(2, 3))) for frame in window[[0, 7]]]
        assert len(hits[0]) == len(hits[1]) == 1 and (hits[1] - hits[0]).tolist() == [[0, 7]]
        found.append((database.takes[database.take[hits[0][0, 0]]], *map(int, hits[0][0])))
    return found


@pytest.mark.parametrize("frames", [1, 8, 61])
def test_every_generated_frame_is_traced_to_its_source(database, frames):
    features = np.random.default_rng(0).normal(size=(frames, 28))
    knn = KNN(database)
    motion, match = (
        knn.generate(features, seed=3, initial="random", k=2),
        knn.match(features, seed=3, initial="random", k=2),
    )
    assert len(motion) == frames and motion.rotation is None and motion.expression is None
    assert np.array_equal(motion.positions, motion_of(match).positions)
    for t in range(frames):
        source = database.positions[match.clip[t // 8], match.frame[t // 8] + t % 8]
        assert np.array_equal(motion.positions[t], source)


def test_head_rotation_comes_with_the_frames(random_takes):
    positions, features = random_takes(np.random.default_rng(0), (300,))
    rotations = [positions[0][:, 5]]
    database = Database.from_arrays(positions, features, ["a"], rotations=rotations)
    motion = KNN(database).generate(features[0][:50])
    assert np.array_equal(motion.rotation, motion.positions[:, 5])


def test_fakes_come_from_other_takes_and_half_of_them_are_best_matches(database):
    rng = np.random.default_rng(0)
    features = rng.normal(size=(60, 64, 28)).astype(np.float32)
    takes = np.array(["one", "two", "three"])[rng.integers(3, size=60)]
    fakes = fake_pairs(database, features, takes, seed=1)
    assert len(fakes) == 60 and fakes.shape == fakes[:].shape == (60, 64, 55, 3) and fakes[0].dtype == np.float32
    assert np.array_equal(fakes[[5, 2]], np.stack([fakes[5], fakes[2]])) and fakes[4:7].shape == (3, 64, 55, 3)
    for fake, take in zip(fakes[:], takes, strict=True):
        assert take not in {source[0] for source in sources(database, fake)}
    assert np.array_equal(fakes[:], fake_pairs(database, features, takes, seed=1)[:])
    assert not np.array_equal(fakes[:], fake_pairs(database, features, takes, seed=2)[:])


def test_ranks_of_the_fakes_are_mixed_as_published(database, monkeypatch):
    """50 % k = 1, the rest uniform in 2..15, one k per sequence (thesis 5.3.3)."""
    drawn = []

    class Found(Exception):
        pass

    def record(self, features, k, **options):
        drawn.append(k)
        raise Found

    monkeypatch.setattr("cospeech.matching.search.matcher.Matcher.search_batch", record)
    with pytest.raises(Found):
        fake_pairs(database, np.zeros((4000, 64, 28)), ["one"] * 4000)
    counts = np.bincount(drawn[0], minlength=17) / 4000
    assert abs(counts[1] - 0.5) < 0.04 and (abs(counts[2:16] - 0.5 / 14) < 0.015).all() and not counts[[0, 16]].any()


def test_a_single_take_excludes_the_sequences_own_stretch(random_takes):
    positions, features = random_takes(np.random.default_rng(0), (640,))
    database = Database.from_arrays(positions, features, ["a"])
    starts = np.arange(0, 500, 37)
    speech = np.stack([features[0][s : s + 64] for s in starts])
    fakes = fake_pairs(database, speech, ["a"] * len(starts), starts / 15.0)
    for fake, start in zip(fakes[:], starts, strict=True):
        for _, clip, frame in sources(database, fake):
            assert 64 * clip + frame + 8 <= start or 64 * clip + frame >= start + 64
    with pytest.raises(CospeechError, match="only take is 'a'"):
        fake_pairs(database, speech, ["a"] * len(starts))
