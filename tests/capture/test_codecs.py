"""Decoding: what was encoded is found again, and depth is what its authors mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cospeech.capture.trackers import codecs

SIZE = (288, 384)


def gaussian(at, bins, sigma=6.0):
    return np.exp(-((np.arange(bins) - np.asarray(at)[..., None]) ** 2) / (2 * sigma**2)).astype(np.float32)


@given(xy=arrays(np.float64, (2, 4, 2), elements=st.floats(2, 280)))
def test_simcc_finds_its_points_to_half_a_bin(xy):
    outputs = {"x": gaussian(xy[..., 0] * 2, 576), "y": gaussian(xy[..., 1] * 2, 768)}
    points, score = codecs.simcc2d(outputs, {"x": "x", "y": "y", "split": 2.0})
    np.testing.assert_allclose(points, xy, atol=0.2501)
    assert (score > 0.99).all()


def test_simcc_scores_are_mean_in_2d_and_minimum_in_3d():
    outputs = {"x": 0.9 * gaussian([[100]], 576), "y": 0.5 * gaussian([[200]], 768), "z": gaussian([[288]], 576)}
    codec = {"x": "x", "y": "y", "z": "z"}
    assert codecs.simcc2d(outputs, codec)[1] == pytest.approx(0.7)
    assert codecs.simcc3d(outputs, codec)[1] == pytest.approx(0.5)


@pytest.mark.parametrize(("bin_", "metres"), [(288, 0.0), (0, -2.1744869), (432, 1.08724345), (576 - 1, 2.16693)])
def test_depth_of_rtmw3d_is_that_of_mmpose(bin_, metres):
    """z = (bin / 2 / (288 / 2) - 1) * 2.1744869: the middle bin is the hips, not -0.544 m as in the known port."""
    outputs = {"x": gaussian([[100]], 576), "y": gaussian([[200]], 768), "z": gaussian([[bin_]], 576)}
    points, _ = codecs.simcc3d(outputs, {"x": "x", "y": "y", "z": "z"})
    assert points[0, 0, 2] == pytest.approx(metres, abs=1e-5)
    np.testing.assert_array_equal(points[0, 0, :2], [50, 100])


@given(xy=arrays(np.float64, (1, 3, 2), elements=st.floats(20, 230)))
def test_heatmaps_are_refined_below_their_cells(xy):
    """A Gaussian in a map four times coarser than the crop is found to a third of a crop pixel."""
    cells = (xy + 0.5) / 4 - 0.5
    maps = gaussian(cells[..., 1], 64, 2.0)[..., :, None] * gaussian(cells[..., 0], 64, 2.0)[..., None, :]
    points, score = codecs.heatmap({0: maps}, {"maps": 0, "size": (256, 256)})
    np.testing.assert_allclose(points, xy, atol=0.34)
    assert (score > 0.9).all()


def test_heatmap_maxima_at_the_border_stay_there():
    maps = np.zeros((1, 2, 8, 8), np.float32)
    maps[0, 0, 0, 0] = maps[0, 1, 7, 7] = 1
    points, _ = codecs.heatmap({0: maps}, {"maps": 0, "size": (8, 8)})
    np.testing.assert_array_equal(points[0], [[0, 0], [7, 7]])


def test_coordinates_in_each_unit():
    values = np.array([[0.5, 0.25, 0.1, 0.9]], np.float32)
    columns = ["x", "y", "z", "score"]
    for unit, wanted in {"unit": (100, 25), "symmetric": (150, 62.5), "crop": (0.5, 0.25)}.items():
        codec = {"points": 0, "columns": columns, "unit": unit, "size": (200, 100), "depth_scale": 2.0}
        points, score = codecs.direct({0: values}, codec)
        np.testing.assert_allclose(points[0, 0], [*wanted, 0.2], rtol=1e-6)
        assert score[0, 0] == pytest.approx(0.9)


def test_slices_of_a_coefficient_vector():
    vector = np.arange(257, dtype=np.float32)[None]
    codec = {"vector": 0, "expression": [80, 144], "angles": [224, 227]}
    expression, angles = codecs.coefficients({0: vector}, codec)
    np.testing.assert_array_equal(expression[0], np.arange(80, 144))
    np.testing.assert_array_equal(angles[0], [224, 225, 226])
