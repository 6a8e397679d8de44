"""The learned audio rank: what it learns, and that the search goes on as ever with it."""

import numpy as np
import pytest
import yaml

from cospeech.errors import CospeechError
from cospeech.matching import KNN, Database, Matcher
from cospeech.matching.search.similarity import Settings, Similarity, motion_windows, train_similarity, usable
from cospeech.synthesis import load
from tests.conftest import make_clip
from tests.workflow.conftest import ROOT

SMALL = Settings(steps=300, batch=64, hidden=48, embedding=16, dropout=0.1)


def built(seeds):
    clips = [make_clip(seed, 200) for seed in seeds]
    return Database.from_clips(clips)


@pytest.fixture(scope="module")
def database():
    return built(range(6))


@pytest.fixture(scope="module")
def similarity(database):
    return train_similarity(database, SMALL, seed=1)[0]


def test_unheard_speech_is_nearer_to_its_own_motion_than_to_other(database, similarity):
    """The toy speaker's bones turn with the speech, so the right motion can be told for speech of other takes."""
    other = built([20, 21])
    raw = lambda normal, rows: normal.mean + rows * normal.std
    other.audio = database.audio_normalization(raw(other.audio_normalization, other.audio))
    other.pose = database.pose_normalization(raw(other.pose_normalization, other.pose))
    clip, frame = (index[::9] for index in usable(other))
    heard = similarity.embed("audio", other.audio[clip, frame])
    cosines = heard @ similarity.embed("motion", motion_windows(other, clip, frame)).T
    nearer = (cosines > np.diag(cosines)[:, None]).mean()
    assert nearer < 0.15  # chance is 0.5


def test_search_stays_as_it_is(database, similarity):
    """Plain, compiled, batched and streamed searches of the learned database agree, and rank by cosine alone."""
    learned = similarity.applied(database)
    features = make_clip(30, 130).features
    plain = Matcher(learned, compiled=False).search(features, k=2)
    compiled = Matcher(learned, compiled=True).search(features, k=2)
    (batched, _) = Matcher(learned).search_batch([features, features[:50]], k=2)
    stream = Matcher(learned).stream(k=2)
    for i in range(0, len(features), 7):
        stream.feed(features[i : i + 7])
    stream.finish()
    for match in (compiled, batched, stream):
        assert np.array_equal(match.clip, plain.clip) and np.array_equal(match.frame, plain.frame)
    audio = Matcher(learned).search(features, variant="audio")
    query = Matcher(learned).query_features(features)[0]
    cosines = np.where(learned.eligible, learned.audio @ query, -np.inf).max(axis=1)
    assert audio.audio_rank[0] == (cosines > cosines[audio.clip[0]]).sum()


def test_the_database_itself_is_left_alone(database, similarity):
    before = database.audio.copy()
    learned = similarity.applied(database)
    assert learned.audio.shape == (*database.eligible.shape, 16) and np.array_equal(database.audio, before)
    norms = np.linalg.norm(learned.audio[database.eligible], axis=1)
    np.testing.assert_allclose(norms, 1, atol=1e-5)
    assert KNN(learned).generate(make_clip(31, 40).features).positions.shape == (40, 55, 3)


def test_file_round_trip_and_a_database_that_changed(database, similarity, tmp_path):
    similarity.save(tmp_path / "weights.safetensors")
    found = Similarity.load(tmp_path / "weights.safetensors")
    assert np.array_equal(found.applied(database).audio, similarity.applied(database).audio)
    with pytest.raises(CospeechError, match="trained on another database; train it again"):
        found.applied(built([3]))


def test_same_seed_same_weights(database):
    one, two = (train_similarity(database, Settings(steps=20, embedding=8), seed=3)[0].arrays for _ in range(2))
    assert all(np.array_equal(one[name], two[name]) for name in one)


@pytest.mark.parametrize(
    ("model", "audio_rank", "words"),
    [("knn", "clever", "known: plain, learned"), ("regression", "learned", "use knn or resync")],
)
def test_a_wrong_audio_rank_is_one_line(tmp_path, model, audio_rank, words):
    with pytest.raises(CospeechError, match=words):
        load(model, tmp_path, audio_rank=audio_rank)


def test_generator_with_the_learned_rank(database, similarity, tmp_path):
    database.save(tmp_path / "database.h5")
    with pytest.raises(CospeechError, match=r"audio_rank/weights\.safetensors: no such file"):
        load("knn", tmp_path, audio_rank="learned")
    similarity.save(tmp_path / "models/audio_rank/weights.safetensors")
    features = make_clip(32, 90).features
    plain, learned = (load("knn", tmp_path, audio_rank=r).generate(features) for r in ("plain", "learned"))
    assert not np.array_equal(plain.positions, learned.positions)


def test_budget_keys_are_the_settings():
    schema = yaml.safe_load((ROOT / "workflow/schemas/budget.schema.yaml").read_text())
    assert set(schema["properties"]["audio_rank"]["properties"]) == set(Settings.__dataclass_fields__)
