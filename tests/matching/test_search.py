"""The search against the literal Algorithm 1: same clip, frame and ranks, whatever the way it is called."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from reference import algorithm1
from scipy.spatial import distance

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.learning.multiply import multiplier
from cospeech.matching import Database, Matcher

VARIANTS = ["pose", "audio", "pose_only"]
# Placement: (frames of a clip at which a window may start, how many frames before it the compared pose lies)
PLACEMENTS = {
    "published": (range(57), 0),
    "continued": (range(1, 57), 1),
    "any_frame": (range(64), 0),
    "any_frame_continued": (range(1, 64), 1),
}


def steps(match):
    """A match, or a stream's, as the reference gives it."""
    match = getattr(match, "match", match)
    columns = match.clip, match.frame, match.pose_rank, match.audio_rank
    return list(zip(*(column.tolist() for column in columns), strict=True))


def startable(database, placement):
    """(M, 64) bool, told from the takes alone: the frames at which a window may start."""
    allowed, (frames, _) = np.zeros_like(database.real), PLACEMENTS[placement]
    for clip, frame in np.argwhere(database.real):
        goes_on = clip + 1 < len(database) and database.take[clip + 1] == database.take[clip]
        allowed[clip, frame] = frame in frames and (frame < 57 or goes_on)
    return allowed


def expected(database, matcher, features, initial="mean", placement="published", **options):
    start = np.zeros(96) if isinstance(initial, str) else initial
    queries, eligible = matcher.query_features(features), startable(database, placement)
    options["offset"] = PLACEMENTS[placement][1]
    return algorithm1(database.pose, database.audio, eligible, queries, start, **options)


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


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("kind", ["random", "tied"])
def test_placements(database, tied, kind, placement):
    """Each with every variant, masks and exclusions: single, in a batch and streaming, in numpy and compiled."""
    database = tied if kind == "tied" else database
    rng = np.random.default_rng(6)
    first = np.rint(database.start * 15).astype(int)[:, None] + np.arange(64)
    for n, (variant, compiled) in enumerate((v, c) for v in VARIANTS for c in (False, True)):
        matcher = Matcher(database, compiled, placement)
        mask = rng.random(database.eligible.shape) < 0.6 if n % 2 else None
        speeches = [rng.normal(size=(n, 28)).astype(np.float32) for n in rng.integers(1, 60, size=5)]
        initial = database.pose[rng.integers(len(database), size=5), rng.integers(64, size=5)]
        options = {"k": n + 1, "mask": mask, "variant": variant, "exclude_take": ("one", 3.0, 7.5)}
        out = (np.array(database.takes)[database.take] == "one")[:, None] & (first < 112.5) & (first + 8 > 45)
        batch = Matcher(database, compiled).search_batch(speeches, **options, initial=initial, placement=placement)
        for speech, start, match in zip(speeches, initial, batch, strict=True):
            masks = None if mask is None else [mask] * -(-len(speech) // 8)
            truth = expected(
                database, matcher, speech, start, placement, k=n + 1, mask=masks, variant=variant, excluded=out
            )
            stream = matcher.stream(**options, initial=start)
            stream.feed(speech)
            stream.finish()
            assert steps(match) == steps(matcher.search(speech, **options, initial=start)) == steps(stream) == truth
            whole = database.positions.reshape(-1, 55, 3)
            frames = [whole[64 * c + f : 64 * c + f + 8] for c, f, *_ in truth]
            assert np.array_equal(match.positions, np.concatenate(frames)[: len(speech)])


def test_a_window_may_run_on_into_the_next_clip_only_where_the_take_goes_on(database):
    starts = {name: Matcher(database, placement=name).database.eligible for name in PLACEMENTS}
    assert [starts["any_frame"][m].sum() for m in range(9)] == [64, 64, 64, 57, 50, 64, 64, 64, 57]
    for name, allowed in starts.items():
        assert np.array_equal(allowed, startable(database, name))
    features = np.random.default_rng(0).normal(size=(30, 28))
    onward = Matcher(database, placement="any_frame_continued")
    assert steps(onward.search(features, placement="published")) == steps(Matcher(database).search(features))
    with pytest.raises(CospeechError, match="'anywhere' is not known; known: published, continued, any_frame"):
        Matcher(database).search(np.zeros((8, 28)), placement="anywhere")


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("compiled", [False, True])
def test_a_database_of_one_clip(single, variant, compiled):
    rng = np.random.default_rng(7)
    matcher = Matcher(single, compiled)
    speeches = [rng.normal(size=(n, 28)).astype(np.float32) for n in (1, 7, 8, 9, 30)]
    for masked, k in ((False, 1), (True, 15)):
        mask = rng.random((1, 64)) < 0.4 if masked else None
        for speech, match in zip(speeches, matcher.search_batch(speeches, k, mask, variant=variant), strict=True):
            masks = None if mask is None else [mask] * len(match.clip)
            assert steps(match) == expected(single, matcher, speech, k=k, mask=masks, variant=variant)
            assert steps(matcher.search(speech, k, mask, variant=variant)) == steps(match)


@pytest.mark.parametrize("spread", [1e-7, 1e-3, 1.0])
def test_near_ties_are_decided_as_in_float64(random_takes, spread):
    """Frames so alike that float32 and the byte copy cannot tell them apart, far from the query and near it."""
    rng = np.random.default_rng(9)
    database = Database.from_arrays(*random_takes(rng, (320, 320)), ["one", "two"])
    centre = rng.normal(size=96)
    database.pose = (centre + spread * rng.normal(size=database.pose.shape)).astype(np.float32)
    compiled, speech = Matcher(database, compiled=True), rng.normal(size=(100, 28)).astype(np.float32)
    for initial in (centre, centre + 5, database.pose[3, 3]):
        truth = expected(database, compiled, speech, initial)
        assert steps(compiled.search(speech, initial=initial)) == truth  # long enough for the byte copy to be made
        assert all(steps(m) == truth for m in compiled.search_batch([speech] * 5, initial=initial))


@pytest.mark.parametrize(("lanes", "vectors"), [(16, 4), (8, 2), (4, 1)])
def test_products_are_right_for_any_register_width(lanes, vectors):
    rng = np.random.default_rng(0)
    for width in (1, 32, 96, 112):
        rows = rng.normal(size=(12, width)).astype(np.float32)
        queries = rng.normal(size=(width, lanes * vectors)).astype(np.float32)
        products = np.zeros((12, lanes * vectors), np.float32)
        tile = multiplier(lanes, vectors)
        njit(lambda rows, queries, products: tile(rows, 6, queries, products))(rows, queries, products)  # noqa: B023
        assert not products[:6].any() and np.allclose(products[6:], rows[6:] @ queries, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("variant", VARIANTS)
def test_distances_are_those_of_the_chosen_features(database, variant):
    features = np.random.default_rng(8).normal(size=(37, 28))
    matcher = Matcher(database)
    match = matcher.search(features, variant=variant, initial=database.pose[3, 9], k=2)
    at = np.stack([match.clip, match.frame], axis=1)
    before = [database.pose[3, 9], *(database.pose[c, f + 7] for c, f in at[:-1])]
    poses = [distance.euclidean(database.pose[c, f], p) for (c, f), p in zip(at, before, strict=True)]
    queries = matcher.query_features(features)
    sounds = [distance.cosine(database.audio[c, f], q) for (c, f), q in zip(at, queries, strict=True)]
    assert np.allclose(match.pose_distance, poses, rtol=1e-5) and match.pose_distance.dtype == np.float32
    assert np.allclose(match.audio_distance, sounds, atol=1e-5) and match.audio_distance.dtype == np.float32


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_masks_in_time_lengths_and_streams(database, tied, data):
    """Any length, placement and cut of a stream into pieces, a mask per window that may leave nothing."""
    database = data.draw(st.sampled_from([database, tied]))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    frames = data.draw(st.integers(1, 60))
    mask = rng.random((-(-frames // 8), *database.eligible.shape)) < data.draw(st.sampled_from([0, 0.02, 0.1, 0.6, 1]))
    options = {
        "k": data.draw(st.integers(1, 15)),
        "variant": data.draw(st.sampled_from(VARIANTS)),
        "mask": data.draw(st.sampled_from([mask, None])),
        "placement": data.draw(st.sampled_from(list(PLACEMENTS))),
    }
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


def test_a_stream_under_a_mask_that_is_asked_for_as_it_goes(database):
    """A function of the window's number gives what the array of all windows' masks gives."""
    rng = np.random.default_rng(2)
    features, masks = rng.normal(size=(50, 28)), rng.random((7, *database.eligible.shape)) < 0.3
    matcher, asked = Matcher(database), []

    def mask(window):
        asked.append(window)
        return None if window == 3 else masks[window]

    masks[3] = True
    options = {"k": 2, "initial": database.pose[1, 1], "exclude_take": "three", "variant": "audio"}
    stream = matcher.stream(mask=mask, **options)
    for part in np.split(features, [3, 20, 31]):
        stream.feed(part)
    stream.finish()
    assert steps(stream) == steps(matcher.search(features, mask=masks, **options)) and asked == list(range(7))
    with pytest.raises(CospeechError, match=r"int64 of shape \(3,\), expected bool of shape \(9, 64\) for window 0"):
        matcher.stream(mask=lambda window: np.zeros(3, int)).feed(features)


def test_stream_latency_is_fifteen_frames(database):
    stream = Matcher(database).stream()
    assert stream.latency == 15 and stream.latency_seconds == 1.0
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
