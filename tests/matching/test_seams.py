"""Seams: Algorithm 1 untouched when off, bones that keep their lengths, and the closed forms of both transitions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cospeech.errors import CospeechError
from cospeech.matching import KNN, Database
from cospeech.matching.search.seams import (
    BLEND,
    HALF_LIFE,
    borders,
    cross_fade,
    cross_fade_rotation,
    inertialized,
    inertialized_rotation,
)
from cospeech.skeleton import UPPER55, to_parent_relative

FPS = 15.0
WRIST, ELBOW = UPPER55.joints("left_wrist", "left_elbow")


def lengths(positions):
    return np.linalg.norm(to_parent_relative(positions.astype(float)), axis=-1)


def elbow_turned(angles):
    """A motion in which only the left forearm turns, about x: (T,) radians -> (T, 55, 3)."""
    still = np.random.default_rng(0).normal(size=(55, 3))
    motion = np.repeat(still[None], len(angles), axis=0)
    hand = [j for j in range(55) if WRIST in ancestors(j)]
    forearm = 0.3 * np.stack([0 * angles, np.cos(angles), np.sin(angles)], axis=1)
    moved = motion[:, ELBOW] + forearm - motion[:, WRIST]
    motion[:, hand] += moved[:, None]
    return motion


def ancestors(joint):
    while joint >= 0:
        yield joint
        joint = int(UPPER55.tree[joint])


def angles_of(motion):
    forearm = motion[:, WRIST] - motion[:, ELBOW]
    return np.unwrap(np.arctan2(forearm[:, 2], forearm[:, 1]))


@pytest.fixture(scope="module")
def knn(toy_clips):
    """Toy motion has bones of constant length and turning heads."""
    return KNN(Database.from_clips(toy_clips))


@pytest.fixture(scope="module")
def speech():
    return np.random.default_rng(3).normal(size=(157, 28))


def test_off_is_algorithm_1_bit_for_bit(knn, speech):
    match = knn.match(speech)
    copied = np.concatenate(
        [knn.matcher.database.positions[c, f : f + 8] for c, f in zip(match.clip, match.frame, strict=True)]
    )
    for options in ({}, {"seams": "off"}):
        made = knn.generate(speech, **options)
        assert made.positions.dtype == np.float32 and np.array_equal(made.positions, copied[:157])


@pytest.mark.parametrize("seams", ["blend", "inertialize"])
def test_bones_keep_their_lengths_and_only_frames_after_seams_change(knn, speech, seams):
    off, made, match = knn.generate(speech), knn.generate(speech, seams=seams), knn.match(speech)
    assert np.abs(lengths(made.positions) - lengths(off.positions)[:1]).max() < 1e-6
    changed = np.abs(made.positions - off.positions).max(axis=(1, 2)) > 1e-6
    first = borders(match)[0] * 8
    assert not changed[:first].any() and changed[first] and len(borders(match)) > 5
    assert np.array_equal(made.rotation[:first], off.rotation[:first])
    assert not np.array_equal(made.rotation, off.rotation)
    steps = [np.linalg.norm(np.diff(m.positions[:, WRIST], n=2, axis=0), axis=1) for m in (off, made)]
    at = borders(match) * 8 - 2
    assert steps[1][at].mean() < 0.5 * steps[0][at].mean()


def test_a_window_that_truly_follows_is_no_seam(random_takes):
    """Of one take: a window is a jump unless it is from eight frames later than the one before."""
    database = Database.from_arrays(*random_takes(np.random.default_rng(0), (300,)), ["a"])
    match = KNN(database).match(np.random.default_rng(0).normal(size=(400, 28)))
    number = match.clip * 64 + match.frame
    assert borders(match).tolist() == (1 + np.flatnonzero(np.diff(number) != 8)).tolist()


@settings(max_examples=30, deadline=None)
@given(before=st.floats(-1, 1), after=st.floats(-1, 1), speed=st.floats(-0.1, 0.1))
def test_inertialization_is_a_critically_damped_spring_that_starts_with_the_old_speed(before, after, speed):
    """Old source: angle `before` at frame 9, turning by `speed`; new one: `after`, at rest."""
    t = np.arange(40)
    angles = np.where(t < 10, before + speed * (t - 9), after)
    made = angles_of(inertialized(elbow_turned(angles), [10], FPS)) - after
    made -= 2 * np.pi * np.round(made[9] / 2 / np.pi - (before - after) / 2 / np.pi)
    offset, y, n = before + speed - after, 2 * np.log(2) / (HALF_LIFE * FPS), np.arange(15)
    truth = np.exp(-y * n) * (offset + (speed + y * offset) * n)
    np.testing.assert_allclose(made[10:25], truth, atol=1e-6)
    np.testing.assert_allclose(made[25:], 0, atol=1e-6)
    head = np.stack([angles, 0 * angles, 0 * angles], axis=1)
    np.testing.assert_allclose(inertialized_rotation(head, [10], FPS)[10:25, 0] - after, truth, atol=1e-6)


def test_a_steady_turn_goes_on_through_a_seam_that_changes_nothing():
    motion = elbow_turned(0.2 * np.arange(30.0))
    np.testing.assert_allclose(inertialized(motion, [8, 16], FPS), motion, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(one=st.floats(-1.5, 1.5), other=st.floats(-1.5, 1.5))
def test_a_cross_fade_turns_by_shares_of_the_angle(one, other):
    share = np.linspace(0, 1, BLEND + 2)
    made = cross_fade(elbow_turned(np.full(6, one)), elbow_turned(np.full(6, other)), share)
    np.testing.assert_allclose(angles_of(made), one + share * (other - one), atol=1e-6)
    a, b = (np.tile([angle, 0.0, 0.0], (6, 1)) for angle in (one, other))
    np.testing.assert_allclose(cross_fade_rotation(a, b, share)[:, 0], one + share * (other - one), atol=1e-9)


def test_blending_fades_what_truly_followed_into_the_new_window(knn, speech):
    """The first seam, by hand: shares 4/5, 3/5, 2/5, 1/5 of the database's own next frames."""
    match, made = knn.match(speech), knn.generate(speech, seams="blend")
    database = knn.matcher.database
    window = next(w for w in borders(match) if match.frame[w - 1] <= 64 - 8 - BLEND)
    at, clip, frame = window * 8, match.clip[window - 1], match.frame[window - 1] + 8
    for j in range(BLEND):
        new, old = (elbow_to_wrist(p) for p in (match.positions[at + j], database.positions[clip, frame + j]))
        found = elbow_to_wrist(made.positions[at + j])
        whole, part = angle(new, old), angle(new, found)
        assert part == pytest.approx(whole * (BLEND - j) / (BLEND + 1), abs=1e-4)
    assert np.array_equal(made.positions[at + BLEND : at + 8], match.positions[at + BLEND : at + 8])


def elbow_to_wrist(pose):
    return (pose[WRIST] - pose[ELBOW]).astype(float)


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)


def test_an_unknown_transition_is_refused_with_the_known_ones(knn, speech):
    with pytest.raises(CospeechError, match="'smooth' is not known; known: off, blend, inertialize"):
        knn.generate(speech, seams="smooth")
