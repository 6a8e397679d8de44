"""How the benchmarks take time: by which clock, and the fastest of some calls or one call with its result."""

import os
import time

WALL, PROCESSOR = time.perf_counter, time.process_time  # all that passes; what this process alone used of the processor


def all_processes():
    """Seconds of processor time of this process and of those it waited for."""
    return sum(os.times()[:4])


def fastest(function, times=5, clock=WALL, warm=False):
    """Seconds of the fastest of some calls, as what else runs only adds; warm : one more before them does not count."""
    if warm:
        function()
    return min(timed(function, clock)[0] for _ in range(times))


def timed(function, clock=WALL):
    """(seconds of one call, what it returned)."""
    began = clock()
    result = function()
    return clock() - began, result
