"""Tables of results: numbers worked out by hand."""

import warnings

import numpy as np
import pytest

from cospeech.formats.result_table import fixed, headings, mean_and_deviation, number, plus_minus, write_table


def test_deviation_is_that_of_the_sample():
    mean, deviation = mean_and_deviation([1.0, 2.0, 6.0])
    assert mean == 3 and deviation == pytest.approx(7**0.5)  # 4 + 1 + 9 over 3 - 1
    columns = mean_and_deviation(np.array([[1.0, 5.0], [3.0, 5.0]]))
    np.testing.assert_allclose(columns, [[2, 5], [2**0.5, 0]])
    np.testing.assert_allclose(mean_and_deviation(np.array([[1.0, 5.0], [3.0, 5.0]]), axis=1)[1], [8**0.5, 2**0.5])


def test_one_value_has_no_deviation():
    with warnings.catch_warnings(action="error"):
        mean, deviation = mean_and_deviation([4.0])
        assert mean == 4 and np.isnan(deviation)
        mean, deviation = mean_and_deviation([[4.0, 2.0]])
        assert mean.tolist() == [4, 2] and np.isnan(deviation).all()


def test_what_is_masked_does_not_count():
    values = np.ma.masked_invalid([[1.0, np.nan, np.nan], [3.0, 8.0, np.nan], [5.0, np.nan, np.nan]])
    mean, deviation = mean_and_deviation(values)
    np.testing.assert_array_equal(mean, [3, 8, np.nan])
    np.testing.assert_array_equal(deviation, [2, np.nan, np.nan])


def test_cells_for_people():
    assert plus_minus(3, 1) == "3.00 ± 1.00" and plus_minus(0.01234) == "0.0123" and plus_minus(0) == "0.00"
    assert plus_minus(0.2834, 0.117, 2) == "0.28 ± 0.12" and plus_minus(4.0, np.nan, 2) == "4.00"
    assert plus_minus(np.nan, 1) == "n/a" == number(np.inf) == fixed(np.nan, 1)


def test_a_table_says_what_does_not_apply(tmp_path):
    rows = [["ada, the first", 3, 0.1234567, np.float64(np.nan)], ["bo", 0, np.float32(2), 1e-7]]
    write_table(tmp_path / "t.csv", ["who", "runs", *headings("jerk", "m/s^3")], rows)
    assert (tmp_path / "t.csv").read_bytes() == (
        b'who,runs,jerk [m/s^3],jerk deviation [m/s^3]\n"ada, the first",3,0.123457,n/a\nbo,0,2,1e-07\n'
    )
