"""Gaps: short ones are filled by cubic interpolation and marked, long ones are bridged and marked as excluded."""

import numpy as np
from scipy.interpolate import CubicSpline

EXCLUDED, INTERPOLATED, OBSERVED = 0, 1, 2  # what is known of a joint in a frame


def fill_gaps(values, believed, apart):
    """Fill what is not believed of one series.

    values (F, ...); believed (F,) bool. Between two believed frames at most `apart` frames apart (at most `apart` - 1
    missing) a cubic spline through the believed frames is read (IVA 2021, section 3.1: 8 frames at 15 Hz).
    Longer gaps are bridged by a straight line, and before the first and after the last believed frame its value
    stands still: finite numbers to compute with, never to learn from.

    Returns (values (F, ...), state (F,) uint8: EXCLUDED, INTERPOLATED or OBSERVED). Without any believed frame the
    values come back as they were, all EXCLUDED.
    """
    state = np.where(believed, OBSERVED, EXCLUDED).astype(np.uint8)
    known = np.flatnonzero(believed)
    if len(known) in (0, len(values)):
        return np.array(values), state
    gaps = np.flatnonzero(~believed)
    filled = np.array(values, float)
    after = np.searchsorted(known, gaps)
    left, right = known[np.clip(after - 1, 0, None)], known[np.clip(after, None, len(known) - 1)]
    share = np.clip((gaps - left) / np.maximum(right - left, 1), 0, 1).reshape(-1, *[1] * (filled.ndim - 1))
    filled[gaps] = filled[left] * (1 - share) + filled[right] * share
    short = (right - left <= apart) & (left < gaps) & (gaps < right)
    if short.any():
        state[gaps[short]] = INTERPOLATED
        filled[gaps[short]] = CubicSpline(known, filled[known])(gaps[short])
    return filled, state


def fill_joints(positions, believed, apart):
    """`fill_gaps` for every joint: (F, J, C), (F, J) -> values, state (F, J). Joints with equal gaps share a spline."""
    filled, state = np.array(positions, float), np.empty(believed.shape, np.uint8)
    patterns, member = np.unique(believed.T, axis=0, return_inverse=True)
    for index, pattern in enumerate(patterns):
        joints = np.flatnonzero(member.ravel() == index)
        filled[:, joints], own = fill_gaps(positions[:, joints], pattern, apart)
        state[:, joints] = own[:, None]
    return filled, state
