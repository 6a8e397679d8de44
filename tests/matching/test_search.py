"""The search against the literal Algorithm 1: same clip, frame and ranks, whatever the way it is called."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import algorithm1

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.matching import Database, Matcher

VARIANTS = ["pose", "audio", "pose_only"]


def steps(match):
    """A match as the reference gives it."""
    columns = match.clip, match.frame, match.pose_rank, match.audio_rank
    return list(zip(*(column.tolist() for column in columns), strict=True))


def expected(database, matcher, features, initial="mean", **options):
    start = np.zeros(96) if isinstance(initial, str) else initial
    queries = matcher.query_features(features)
    return algorithm1(database.pose, database.audio, database.eligible, queries, start, **options)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("kind", ["random", "tied"])
def test_thousands_of_random_queries(database, tied, kind, variant):
    """About 580 windows a case, 3500 in all: numpy, compiled, in batches, each with and without a mask."""
    database = tied if kind == "tied" else database
    rng = np.random.default_rng(5)
    plain, compiled = Matcher(database, compiled=False), Matcher(database, compiled=True)
    for masked in (False, True):
        mask = rng.random(database.eligible.shape) < 0.5 if masked else None
        speeches = [rng.normal(size=(n, 28)).astype(np.float32) for n in rng.integers(1, 70, size=60)]
        ks = rng.integers(1, 16, size=len(speeches))
        initial = rng.normal(size=(len(speeches), 96))
        initial[::2] = database.pose[rng.integers(len(database), size=30), rng.integers(64, size=30)]
        options = {"k": ks, "mask": mask, "initial": initial, "variant": variant}
        batches = plain.search_batch(speeches, **options), compiled.search_batch(speeches, **options)
        for i, speech in enumerate(speeches):
            masks = None if mask is None else [mask] * -(-len(speech) // 8)
            truth = expected(database, plain, speech, initial[i], k=int(ks[i]), mask=masks, variant=variant)
            assert [steps(batch[i]) for batch in batches] == [truth, truth]
            if i % 4 == 0:
                one = {"k": int(ks[i]), "mask": mask, "initial": initial[i], "variant": variant}
                assert steps(plain.search(speech, **one)) == steps(compiled.search(speech, **one)) == truth


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_masks_in_time_lengths_and_streams(database, tied, data):
    """Any length, any cut of a stream into pieces, a mask per window that may leave nothing."""
    database = data.draw(st.sampled_from([database, tied]))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    frames = data.draw(st.integers(1, 60))
    mask = rng.random((-(-frames // 8), *database.eligible.shape)) < data.draw(st.sampled_from([0, 0.02, 0.1, 0.6, 1]))
    options = {
        "k": data.draw(st.integers(1, 15)), "variant": data.draw(st.sampled_from(VARIANTS)),
        "mask": data.draw(st.sampled_from([mask, None])),
    }  # fmt: skip
    features = rng.normal(size=(frames, 28)).astype(np.float32)
    matcher = Matcher(database, compiled=data.draw(st.booleans()))
    cuts = sorted(data.draw(st.lists(st.integers(0, frames), max_size=6)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CospeechNotice)
        truth = expected(database, matcher, features, **options)
        whole = matcher.search(features, **options)
        stream = matcher.stream(**options)
        parts = [stream.feed(part) for part in np.split(features, cuts)] + [stream.finish()]
    assert steps(whole) == truth
    assert [step for part in parts for step in steps(part)] == steps(stream.match) == truth
    assert np.array_equal(np.concatenate([part.positions for part in parts]), whole.positions)
    assert np.array_equal(stream.positions, whole.positions)


def test_stream_latency_is_fifteen_frames(database):
    stream = Matcher(database).stream()
    features = np.random.default_rng(0).normal(size=(40, 28))
    out = [len(stream.feed(frame[None]).positions) for frame in features]
    assert np.flatnonzero(out).tolist() == [14, 22, 30, 38]


def test_positions_are_the_matched_frames_cut_to_the_speech(database):
    match = Matcher(database).search(np.random.default_rng(0).normal(size=(21, 28)))
    whole = [database.positions[c, f : f + 8] for c, f in zip(match.clip, match.frame, strict=True)]
    assert np.array_equal(match.positions, np.concatenate(whole)[:21])
    assert match.take.tolist() == [database.takes[database.take[c]] for c in match.clip]
    assert np.allclose(match.time, database.start[match.clip] + match.frame / 15)


def test_speech_that_goes_on_is_looked_ahead_to(database):
    """A stretch out of a longer speech is searched as the longer speech's beginning."""
    features, matcher = np.random.default_rng(0).normal(size=(90, 28)), Matcher(database)
    short = matcher.search(features, frames=29)
    assert len(short.positions) == 29 and steps(short) == steps(matcher.search(features))[:4]
    assert not np.array_equal(matcher.query_features(features[:29])[3], matcher.query_features(features)[3])


def test_own_sound_and_pose_find_themselves():
    """Speech of the database after the pose before it: the first window is the one that was really there."""
    rng = np.random.default_rng(3)
    positions = [rng.normal(size=(640, 55, 3)).astype(np.float32)]
    features = [rng.normal(size=(640, 28)).astype(np.float32)]
    database = Database.from_arrays(positions, features, ["a"])
    at = 3 * 64 + 20
    for variant in ("pose", "audio"):
        match = Matcher(database).search(features[0][at : at + 30], initial=database.pose[3, 20], variant=variant)
        assert (match.clip[0], match.frame[0], match.pose_rank[0], match.audio_rank[0]) == (3, 20, 0, 0)


def test_an_empty_mask_is_set_aside_for_its_window_with_a_notice(database):
    features = np.random.default_rng(0).normal(size=(24, 28))
    mask = np.ones((3, *database.eligible.shape), bool)
    mask[1] = False
    matcher = Matcher(database)
    with pytest.warns(CospeechNotice, match="window 1;"):
        match = matcher.search(features, mask=mask)
    assert match.unmasked.tolist() == [False, True, False]
    assert steps(match) == steps(matcher.search(features))


def test_mask_tests_only_first_and_last_frame_of_a_window(database):
    mask = np.zeros(database.eligible.shape, bool)
    mask[5, [10, 17]] = True
    match = Matcher(database).search(np.random.default_rng(0).normal(size=(16, 28)), mask=mask)
    assert (match.clip == 5).all() and (match.frame == 10).all() and not match.unmasked.any()


@pytest.mark.parametrize("compiled", [False, True])
def test_excluded_takes_and_stretches(database, compiled):
    rng = np.random.default_rng(4)
    speeches = [rng.normal(size=(40, 28)).astype(np.float32) for _ in range(12)]
    excluded = [None, "one", "two", "three", "unheard of", ("one", 3.0, 7.5)] * 2
    matcher = Matcher(database, compiled=compiled)
    first = np.rint(database.start * 15).astype(int)[:, None] + np.arange(64)
    for speech, what, match in zip(
        speeches, excluded, matcher.search_batch(speeches, exclude_take=excluded, k=2), strict=True
    ):
        take = what[0] if isinstance(what, tuple) else what
        out = np.repeat([[database.takes[t] == take] for t in database.take], 64, axis=1)
        if isinstance(what, tuple):
            out &= (first < 7.5 * 15) & (first + 8 > 3.0 * 15)
        assert steps(match) == expected(database, matcher, speech, k=2, excluded=out)
        assert steps(matcher.search(speech, exclude_take=what, k=2)) == steps(match)


def test_nothing_left_after_an_exclusion():
    rng = np.random.default_rng(0)
    database = Database.from_arrays([rng.normal(size=(80, 55, 3))], [rng.normal(size=(80, 28))], ["only"])
    for compiled in (False, True):
        with pytest.raises(CospeechError, match="nothing is left"):
            Matcher(database, compiled).search(rng.normal(size=(9, 28)), exclude_take="only")
    match = Matcher(database).search(rng.normal(size=(9, 28)), k=4)  # the only clip is also the fourth best
    assert match.clip.tolist() == [0, 0]


def test_random_starts_follow_the_seed_and_the_mask(database):
    features = np.random.default_rng(0).normal(size=(8, 28))
    matcher = Matcher(database)
    seeds = list(range(30))
    batch = matcher.search_batch([features] * 30, initial="random", seed=seeds)
    alone = [matcher.search(features, initial="random", seed=seed) for seed in seeds]
    assert [steps(m) for m in batch] == [steps(m) for m in alone]
    assert len({m.clip[0] for m in alone}) > 2
    mask = np.zeros(database.eligible.shape, bool)
    mask[2, [30, 37]] = True  # only one frame may start, so it is the initial pose as well
    masked = matcher.search(features, initial="random", mask=mask, seed=9, variant="pose_only")
    given = matcher.search(features, initial=database.pose[2, 30], mask=mask)
    assert steps(masked)[0][:3] == steps(given)[0][:3] == (2, 30, 0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"k": 0}, "k is 0"),
        ({"variant": "voice"}, "known: pose, audio, pose_only"),
        ({"initial": "median"}, "mean, random"),
        ({"initial": np.full(96, np.nan)}, "NaN"),
        ({"mask": np.ones((2, 64), bool)}, "expected bool of shape"),
        ({"mask": np.ones((9, 64))}, "float64"),
        ({"features": np.full((9, 28), np.nan)}, "NaN or infinity, first in frame 0"),
        ({"frames": 10}, "9 frames, but 10 are asked"),
        ({"features": np.zeros((0, 28))}, "expected .frames, 28"),
        ({"features": np.zeros((9, 27))}, "expected .frames, 28"),
    ],
)
def test_mistakes_get_one_line(database, options, message):
    with pytest.raises(CospeechError, match=message) as error:
        Matcher(database).search(**{"features": np.zeros((9, 28))} | options)
    assert "\n" not in str(error.value)
