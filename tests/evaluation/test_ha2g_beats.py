"""HA2G's beat consistency against swings whose turning points are known, and released code's against a plain loop."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics import beats
from cospeech.gestures.ha2g.dataset.bones import bone_vectors
from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.skeleton import UPPER55

TABLE = level_table("expressive43")
HALF = 9  # frames from one turn of the swing to the next
seeds = st.integers(0, 10**6)


def turns_of(positions, table=TABLE):
    return beats.angle_changes(bone_vectors(positions, None, table), table)


@pytest.fixture(scope="module")
def pendulum(swing):
    """Angle changes of an elbow that swings, and the seconds of its turning points."""
    return turns_of(swing(0.8 * np.cos(np.pi * np.arange(10 * HALF) / HALF))), np.arange(1, 10) * HALF / 15


def score(changes, onsets, **options):
    return beats.beat_consistency(changes, onsets, beats.mean_angle_change(changes), **({"threshold": 0.03} | options))


def test_only_the_elbow_moves_and_by_what_it_turned(swing):
    turned = np.array([0.0, 0.1, 0.3, 0.2, 0.2])
    changes = turns_of(swing(turned))
    moving = changes.max(axis=0) > 1e-6
    assert changes.shape == (4, TABLE.angles) and moving.sum() == 1
    assert changes[:, moving][:, 0] == pytest.approx(np.abs(np.diff(turned)) / np.pi, abs=1e-6)


def test_onsets_on_the_turns_score_one_and_shifted_ones_a_gaussian(pendulum):
    changes, turns = pendulum
    assert score([changes], [turns]).with_still == pytest.approx(1.0, abs=1e-9)
    assert score([changes], [turns + 0.1 * np.sqrt(2)]).with_still == pytest.approx(np.exp(-1), abs=1e-9)
    assert score([changes], [turns - 0.1], sigma=0.2).with_still == pytest.approx(np.exp(-1 / 8), abs=1e-9)


@pytest.mark.parametrize("name", ["expressive43", "ted10"])
def test_both_skeletons_see_the_same_beats(swing, name):
    table = level_table(name)
    changes = turns_of(swing(0.8 * np.cos(np.pi * np.arange(60) / HALF)), table)
    assert score([changes], [np.arange(1, 6) * HALF / 15]).with_still == pytest.approx(1.0, abs=1e-9)


def test_fingers_make_beats(rest_pose):
    positions = np.repeat(rest_pose[None], 60, axis=0)
    tip = UPPER55.index["left_index_2"]
    positions[:, tip, 1] += 0.02 * np.sin(np.arange(60) / 2)
    assert score([turns_of(positions)], [np.arange(0.5, 3.5)]).beats > 3


def test_every_onset_counts_the_same_and_nothing_is_left_out_in_silence(pendulum):
    changes, turns = pendulum
    still, none = np.zeros_like(changes), np.zeros(0)
    found = score([changes, changes, still, changes], [turns[:4], turns[:2] + 0.1, turns[:3], none])
    expected = 4 * 1 + 2 * np.exp(-0.5)
    assert found.with_still == pytest.approx(expected / 9) and found.without_still == pytest.approx(expected / 6)
    assert (found.clips, found.silent, found.still, found.onsets) == (4, 1, 1, 9)
    assert found.beats == 3 * len(turns)


def test_a_score_of_nothing_does_not_apply(pendulum):
    changes, turns = pendulum
    silent = score([changes], [np.zeros(0)])
    assert np.isnan(silent.with_still) and np.isnan(silent.without_still) and silent.silent == 1
    still = beats.beat_consistency([0 * changes], [turns], changes.mean(axis=0), threshold=0.03)
    assert still.with_still == 0.0 and np.isnan(still.without_still) and still.still == 1


def test_excess_is_what_rotated_onsets_lack(pendulum):
    changes, turns = pendulum
    steady = score([changes], [turns])
    chance = np.exp(-((np.arange(-30, 30) / 100) ** 2) / 0.02).mean()  # of any time between two turns
    assert steady.excess == pytest.approx(1 - chance, abs=0.08)
    short = score([changes, changes[:30]], [turns, turns[turns < 2] + 0.1])
    assert short.excess == pytest.approx(steady.excess) and np.isnan(score([changes[:30]], [turns[:2]]).excess)


@settings(max_examples=25, deadline=None)
@given(seed=seeds, quantile=st.floats(0.0, 1.0))
def test_the_threshold_is_a_quantile_of_the_rises_beside_local_minima(seed, quantile):
    changes = np.random.default_rng(seed).uniform(0.01, 0.1, (60, 4))
    maac = changes.mean(axis=0)
    rate = np.round((changes / maac).mean(axis=1), 4)
    assume(np.diff(rate).all())  # of two equal neighbours the code takes the later one, this list neither
    inner = [t for t in range(1, 59) if rate[t] < rate[t - 1] and rate[t] < rate[t + 1]]
    rises = [max(rate[t - 1], rate[t + 1]) - rate[t] for t in inner]
    assert beats.beat_threshold([changes], maac, quantile) == pytest.approx(np.quantile(rises, quantile), abs=1e-9)


def test_motion_without_a_rest_has_no_threshold():
    with pytest.raises(CospeechError, match="never comes to rest"):
        beats.beat_threshold([np.zeros((40, 3))], np.zeros(3))


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_released_mode_is_the_released_loop_over_windows(seed):
    """HA2G's evaluation, written down again: frames 2 to 32, strict minima, windows without beats skipped."""
    rng = np.random.default_rng(seed)
    windows = [rng.uniform(0.01, 0.1, (33, 3)) for _ in range(5)] + [np.full((33, 3), 0.05)]
    onsets = [np.sort(rng.uniform(0, 34 / 15, n)) for n in (3, 1, 4, 2, 0, 5)]
    maac = np.mean(windows, axis=(0, 1))
    total = count = 0
    for changes, heard in zip(windows, onsets, strict=True):
        rate = np.concatenate([[0], np.round((changes / maac).mean(axis=1), 4)])
        found = [
            t / 15
            for t in range(2, 33)
            if rate[t] < rate[t - 1]
            and rate[t] < rate[t + 1]
            and (rate[t - 1] - rate[t] >= 0.03 or rate[t + 1] - rate[t] >= 0.03)
        ]
        if found:
            total += sum(np.exp(-min((onset - beat) ** 2 for beat in found) / 0.02) for onset in heard)
            count += len(heard)
    assert beats.released_beat_consistency(windows, onsets, maac) == pytest.approx(total / count, rel=1e-9)


def test_released_mode_is_half_a_frame_late_and_flatters_motion_that_mostly_stands_still(swing):
    changes = turns_of(swing(0.8 * np.cos(np.pi * (np.arange(34) + 0.5) / HALF)))
    turns = (np.arange(1, 4) * HALF - 0.5) / 15
    maac, heard = changes.mean(axis=0), [turns] * 4
    windows = [changes[:33], *[np.zeros((33, TABLE.angles))] * 3]
    released = beats.released_beat_consistency(windows, heard, maac)
    assert released == pytest.approx(np.exp(-((0.5 / 15) ** 2) / 0.02), rel=1e-6)
    ours = beats.beat_consistency(windows, heard, maac, threshold=0.03)
    assert ours.with_still == pytest.approx(0.25) and ours.without_still == pytest.approx(1.0) and ours.still == 3
    assert np.isnan(beats.released_beat_consistency(windows[1:], heard[1:], maac))
