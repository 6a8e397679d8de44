"""Training windows never straddle clips nor touch invalid frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cospeech.errors import CospeechError
from cospeech.learning.windows import Windows, divisor, moments


@given(st.lists(st.lists(st.booleans(), min_size=1, max_size=40), min_size=1, max_size=4), st.integers(1, 6))
def test_windows_are_exactly_the_valid_stretches(masks, frames):
    masks = [np.array(mask) for mask in masks]
    labels = [np.arange(len(m))[:, None] + 1000 * i for i, m in enumerate(masks)]
    expected = [
        list(range(1000 * i + s, 1000 * i + s + frames))
        for i, m in enumerate(masks)
        for s in range(len(m) - frames + 1)
        if m[s : s + frames].all()
    ]
    if not expected:
        with pytest.raises(CospeechError, match=f"no {frames} valid frames"):
            Windows([{"x": x} for x in labels], masks, frames)
        return
    windows = Windows([{"x": x} for x in labels], masks, frames)
    assert windows.take(slice(None))["x"][..., 0].tolist() == expected


def test_constant_channels_do_not_divide_by_zero():
    windows = Windows([{"x": np.full((10, 2), 3.0)}], [np.ones(10, bool)], 4)
    mean, deviation = windows.statistics("x")
    assert mean.tolist() == [3, 3] and deviation.tolist() == [0, 0] and divisor(deviation).tolist() == [1, 1]


def test_statistics_are_those_of_valid_frames():
    """Half of the second take is two metres away and invalid."""
    rng = np.random.default_rng(0)
    arrays, valid = [rng.normal(size=(50, 3)), rng.normal(size=(40, 3))], [np.ones(50, bool), np.arange(40) < 20]
    arrays[1][20:] += 2.0
    mean, deviation = Windows([{"x": a} for a in arrays], valid, 4).statistics("x")
    right = np.concatenate([arrays[0], arrays[1][:20]])
    np.testing.assert_allclose(mean, right.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(deviation, right.std(axis=0), rtol=1e-6)


@given(st.lists(st.integers(1, 9), min_size=1, max_size=5), st.floats(-1000, 1000))
def test_moments_of_blocks_are_those_of_all_rows(lengths, offset):
    rows = np.random.default_rng(len(lengths)).normal(size=(sum(lengths), 2)) * [1.0, 1e-3] + offset
    mean, deviation = moments(np.split(rows, np.cumsum(lengths)[:-1]))
    np.testing.assert_allclose(mean, rows.mean(axis=0), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(deviation, np.where(rows.std(axis=0) > 1e-4, rows.std(axis=0), 0), rtol=1e-4)
