"""The virtual speaker: a whole take against real time, and its two hot paths against the obvious loops, in one run.

Usage: python benchmarks/bench_demo.py [seconds]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from timing import all_processes, fastest, timed

from cospeech.demo import read_take, write_take
from cospeech.demo.body import pose_body
from cospeech.demo.motion import interpolate


def whole_take(seconds):
    with tempfile.TemporaryDirectory() as folder:
        wav, truth = Path(folder) / "take.wav", Path(folder) / "take.h5"
        write_take("lively", 0, seconds=6.0, seed=0, wav=wav, truth=truth)  # imports and compiled kernels
        write = timed(lambda: write_take("lively", 0, seconds=seconds, seed=0, wav=wav, truth=truth), all_processes)[0]
        read = timed(lambda: read_take(truth, wav, subject="lively", clip="take"), all_processes)[0]
    print(f"write_take {seconds:g} s: {write:.2f} s of processor time, {seconds / write:.0f} times real time")
    print(f"read_take  {seconds:g} s: {read:.2f} s of processor time, {seconds / read:.0f} times real time")


def key_interpolation(frames=3600, fps=60.0):
    rng = np.random.default_rng(0)
    times, values = np.arange(0, frames / fps + 1, 0.3), rng.normal(size=(int(frames / fps / 0.3) + 4, 15))
    values, via, at = values[: len(times)], np.zeros(len(times), bool), np.arange(frames) / fps
    fast = fastest(lambda: interpolate(times, values, via, at), 3)
    slow = fastest(lambda: [interpolate(times, values, via, t[None]) for t in at], 1)
    print(f"minimum-jerk course, 60 s: {1e3 * fast:.1f} ms at once, {slow / fast:.0f} times faster than frame by frame")


def body(frames=3600):
    rng = np.random.default_rng(0)
    arms = {side: rng.normal([0, -0.5, 0.6, *[0] * 12], 0.05, (frames, 15)) for side in ("right", "left")}
    torso, head, shrug = rng.normal(0, 3, (frames, 3)), rng.normal(0, 5, (frames, 3)), np.zeros((frames, 2))
    fast = fastest(lambda: pose_body(arms, torso, head, shrug, 1.0), 3)
    part = slice(0, 200)
    pick = lambda i: ({s: a[i : i + 1] for s, a in arms.items()}, torso[i : i + 1], head[i : i + 1], shrug[i : i + 1])
    slow = fastest(lambda: [pose_body(*pick(i), 1.0) for i in range(part.stop)], 1) * frames / part.stop
    print(f"body kinematics, 60 s: {1e3 * fast:.0f} ms at once, {slow / fast:.0f} times faster than frame by frame")


if __name__ == "__main__":
    whole_take(float(sys.argv[1]) if len(sys.argv) > 1 else 600.0)
    key_interpolation()
    body()
