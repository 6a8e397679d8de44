"""Tables of results: the mean of several values and how far apart they lie, numbers as text, and CSV files of both."""

import numpy as np


def mean_and_deviation(values, axis=0):
    """Mean and sample deviation, over n - 1, along an axis: what every table has beside each other.

    values : (..., N, ...); what is masked in a masked array does not count. Returns two arrays without that axis, or
    two floats. One value has no deviation and none has no mean: NaN.
    """
    values = np.ma.asarray(values)
    mean = values.mean(axis=axis)
    deviation = values.std(axis=axis, ddof=1) if values.shape[axis] > 1 else np.full(np.shape(mean), np.nan)
    return np.ma.filled(mean, np.nan)[()], np.ma.filled(deviation, np.nan)[()]
