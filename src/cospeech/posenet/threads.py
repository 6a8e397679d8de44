"""Work on many pictures at once, in threads: OpenCV lets go of Python's lock while it decodes and warps."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache

LEAST = 4  # pictures a thread takes at a time; fewer are not worth handing over


WORKERS = min(16, os.cpu_count() or 1)


@cache
def _pool():
    return ThreadPoolExecutor(WORKERS, "pictures")


def in_threads(function, count):
    """Call function(range) for ranges that together are 0 to `count`, and return when all are done."""
    size = max(LEAST, -(-count // WORKERS))
    ranges = [range(start, min(start + size, count)) for start in range(0, count, size)]
    if len(ranges) < 2:
        for part in ranges:
            function(part)
    else:
        list(_pool().map(function, ranges))
