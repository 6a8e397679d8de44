"""Tables of results: the mean of several values and how far apart they lie, numbers as text, and CSV files of both."""

import csv
import math

import numpy as np

from cospeech.files import writing

ABSENT = "n/a"  # in every table, for what does not apply


def mean_and_deviation(values, axis=0):
    """Mean and sample deviation, over n - 1, along an axis: what every table has beside each other.

    values : (..., N, ...); what is masked in a masked array does not count. Returns two arrays without that axis, or
    two floats. One value has no deviation and none has no mean: NaN.
    """
    values = np.ma.asarray(values)
    mean = values.mean(axis=axis)
    deviation = values.std(axis=axis, ddof=1) if values.shape[axis] > 1 else np.full(np.shape(mean), np.nan)
    return np.ma.filled(mean, np.nan)[()], np.ma.filled(deviation, np.nan)[()]


def number(value, digits=6):
    """`value` with so many significant digits, or "n/a"."""
    return f"{value:.{digits}g}" if math.isfinite(value) else ABSENT


def fixed(value, decimals):
    """`value` with so many decimals, or "n/a"."""
    return f"{value:.{decimals}f}" if math.isfinite(value) else ABSENT


def plus_minus(mean, deviation=math.nan, decimals=None):
    """A cell for people: `0.412 ± 0.051`, `0.412` where there is no deviation, `n/a` where the mean does not apply.

    Both have `decimals`; None: as many as the mean needs for three significant digits.
    """
    if not math.isfinite(mean):
        return ABSENT
    if decimals is None:
        decimals = min(6, max(0, 2 - math.floor(math.log10(abs(mean))))) if mean else 2
    return fixed(mean, decimals) + (f" ± {fixed(deviation, decimals)}" if math.isfinite(deviation) else "")


def headings(name, unit=""):
    """The headings of a mean and its deviation: `jerk [m/s^3]`, `jerk deviation [m/s^3]`."""
    unit = f" [{unit}]" if unit else ""
    return f"{name}{unit}", f"{name} deviation{unit}"


def write_table(path, head, rows):
    """Write a CSV file with a heading line; cells are text, whole numbers, or floats, which become `number`s."""
    with writing(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(head)
        table.writerows(
            [number(cell) if isinstance(cell, float | np.floating) else cell for cell in row] for row in rows
        )
