"""Training windows never straddle clips nor touch invalid frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cospeech.errors import CospeechError
from cospeech.learning.windows import Windows


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
    assert mean.tolist() == [3, 3] and deviation.tolist() == [1, 1]
