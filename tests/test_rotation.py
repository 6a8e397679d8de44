"""Rotations over time, against scipy and against motions whose angle is known at every moment."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from cospeech.rotation import (
    between,
    continuous,
    from_euler,
    heading,
    multiply,
    resample,
    resample_rotations,
    swing_twist,
)

relaxed = settings(deadline=None)
unit = st.floats(-1, 1, width=32)
vectors = arrays(float, 3, elements=unit).filter(lambda v: np.linalg.norm(v) > 0.1)
quaternions = (
    arrays(float, (6, 4), elements=unit)
    .filter(lambda q: (np.linalg.norm(q, axis=-1) > 0.1).all())
    .map(lambda q: q / np.linalg.norm(q, axis=-1, keepdims=True))
)
rates = st.sampled_from([15.0, 24.0, 25.0, 29.97, 30.0, 50.0, 60.0, 100.0, 120.0, 240.0])


def turning(angles, axis):
    return Rotation.from_rotvec(np.outer(angles, axis / np.linalg.norm(axis))).as_quat()


def degrees_apart(a, b):
    return np.degrees((Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude())


@relaxed
@given(quaternions, st.lists(st.sampled_from([-1.0, 1.0]), min_size=6, max_size=6))
def test_continuous_keeps_rotations_and_removes_sign_flips(q, signs):
    flipped = q * np.array(signs)[:, None]
    smooth = continuous(flipped)
    assert (np.sum(smooth[1:] * smooth[:-1], axis=-1) >= 0).all()
    np.testing.assert_array_equal(np.abs(smooth), np.abs(q))
    assert (np.abs(np.sum(smooth * q, axis=-1)) > 0.999).all()


@relaxed
@given(quaternions, quaternions, st.permutations("XYZ"))
def test_products_and_euler_angles_are_scipys(a, b, order):
    product = (Rotation.from_quat(a) * Rotation.from_quat(b)).as_quat()
    assert np.abs(np.sum(multiply(a, b) * product, axis=-1)) == pytest.approx(1)
    angles, order = a[:, :3] * 180, "".join(order)
    expected = Rotation.from_euler(order, angles, degrees=True).as_quat()
    assert np.abs(np.sum(from_euler(order, angles) * expected, axis=-1)) == pytest.approx(1)


@settings(max_examples=40, deadline=None)
@given(rates, rates, vectors, st.floats(-0.8, 0.8), st.floats(0, 2))
def test_a_steady_spin_is_exact_at_any_rate_and_through_every_half_turn(rate, new_rate, axis, share, start):
    speed = share * 2 * np.pi * min(rate, new_rate) / 2  # rad/s, up to most of half a turn a frame
    spin = turning(speed * np.arange(round(8 * rate)) / rate, axis)
    frames = round(5 * new_rate)
    expected = turning(speed * (start + np.arange(frames) / new_rate), axis)
    assert degrees_apart(resample_rotations(spin, rate, new_rate, frames, start), expected).max() < 0.5


def test_equal_rates_change_nothing():
    q = turning(np.random.default_rng(0).normal(size=50).cumsum(), np.array([1.0, 2.0, 3.0]))
    assert degrees_apart(resample_rotations(q, 30, 30, 50), q).max() < 1e-5
    values = np.random.default_rng(1).normal(size=(40, 3))
    np.testing.assert_allclose(resample(values, 25, 25, 40), values, atol=1e-12)


def test_what_the_new_rate_cannot_carry_vanishes_and_does_not_fold():
    times = np.arange(1200) / 120
    wobble = turning(np.radians(10) * np.sin(2 * np.pi * 14 * times), np.array([0.0, 0.0, 1.0]))
    still = np.array([0.0, 0.0, 0.0, 1.0])
    assert degrees_apart(wobble[::8], still).max() > 9  # picking every eighth frame folds 14 Hz to 1 Hz
    left = degrees_apart(resample_rotations(wobble, 120, 15, 150), still)
    assert left[8:-8].max() < 0.01
    assert left.max() < 2  # at an end nobody knows what comes next
    assert np.abs(resample(np.sin(2 * np.pi * 14 * times), 120, 15, 150)[10:-10]).max() < 1e-3


def test_what_the_new_rate_can_carry_stays():
    wave = lambda t: np.radians(30) * np.sin(2 * np.pi * 4 * t)
    kept = resample_rotations(turning(wave(np.arange(1200) / 120), np.array([0.0, 1.0, 0.0])), 120, 15, 150)
    expected = turning(wave(np.arange(150) / 15), np.array([0.0, 1.0, 0.0]))
    assert degrees_apart(kept, expected)[8:-8].max() < 0.4


def test_an_hour_does_not_drift():
    slow = np.sin(2 * np.pi * 0.5 * np.arange(round(3600 * 29.97)) / 29.97)
    found = resample(slow, 29.97, 15, 3600 * 15)
    assert np.abs(found - np.sin(2 * np.pi * 0.5 * np.arange(3600 * 15) / 15))[10:-10].max() < 1e-3


def test_ends_keep_a_line_straight_and_one_frame_is_enough():
    line = np.arange(300.0) / 120
    np.testing.assert_allclose(resample(line, 120, 15, 37), np.arange(37) / 15, atol=1e-9)
    np.testing.assert_allclose(resample(np.array([[2.0, 3.0]]), 30, 15, 2), [[2, 3], [2, 3]])
    identity = np.array([[0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(resample_rotations(identity, 30, 15, 2), np.repeat(identity, 2, axis=0))


@relaxed
@given(quaternions, vectors)
def test_swing_and_twist_make_up_the_rotation(q, axis):
    axis = axis / np.linalg.norm(axis)
    swing, twist = swing_twist(q, axis)
    together = Rotation.from_quat(swing) * Rotation.from_quat(twist)
    assert degrees_apart(together.as_quat(), q).max() < 1e-4
    np.testing.assert_allclose(Rotation.from_quat(twist).apply(axis), np.tile(axis, (6, 1)), atol=1e-6)
    np.testing.assert_allclose(swing[:, :3] @ axis, 0, atol=1e-6)


def test_twist_of_a_known_forearm():
    twist, swing = Rotation.from_rotvec([0.7, 0, 0]), Rotation.from_rotvec([0, 0.3, -0.4])
    found_swing, found_twist = swing_twist((swing * twist).as_quat(), [1, 0, 0])
    assert degrees_apart(found_swing, swing.as_quat()) < 1e-6
    assert degrees_apart(found_twist, twist.as_quat()) < 1e-6
    half_turn = Rotation.from_rotvec([0, np.pi, 0]).as_quat()
    assert swing_twist(half_turn, [1, 0, 0])[1].tolist() == [0, 0, 0, 1]


@relaxed
@given(vectors, vectors)
def test_between_turns_one_direction_to_the_other_by_the_smallest_angle(a, b):
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    turn = Rotation.from_quat(between(a, b))
    np.testing.assert_allclose(turn.apply(a), b, atol=1e-4)
    assert turn.magnitude() == pytest.approx(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b), abs=1e-4)
    np.testing.assert_allclose(Rotation.from_quat(between(a, -a)).apply(a), -a, atol=1e-6)


def test_heading_follows_the_body_and_not_its_wobble():
    times = np.arange(600) / 15
    facing = np.linspace(0, 4 * np.pi, 600)  # two whole turns to the left
    left = Rotation.from_rotvec(np.outer(facing, [0, 1, 0])).apply([0.2, 0.0, 0.0])
    np.testing.assert_allclose(heading(left[:, None], 15, smoothing=0), facing, atol=1e-9)
    np.testing.assert_allclose(heading(left[:, None], 15)[30:-30], facing[30:-30], atol=1e-3)
    wobble = np.radians(10) * np.sin(2 * np.pi * 2 * times)
    left = Rotation.from_rotvec(np.outer(wobble, [0, 1, 0])).apply([0.2, 0.1, 0.0])
    found = np.degrees(np.abs(heading(left[:, None], 15)))
    assert found[30:-30].max() < 0.01
    assert found.max() < 1.5  # at an end nobody knows how the wobble goes on
