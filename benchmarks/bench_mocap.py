"""Motion capture in, each hot path against the obvious alternative in one run: `python benchmarks/bench_mocap.py`."""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pybvh
from scipy.spatial.transform import Rotation, Slerp
from timing import PROCESSOR, fastest

from cospeech.formats.animation import Animation
from cospeech.formats.bvh import read_bvh, write_bvh
from cospeech.rotation import from_euler, resample_rotations

FRAMES, JOINTS, RATE = 7200, 75, 120.0  # one minute at 120 fps
best = partial(fastest, times=3, clock=PROCESSOR)


def report(name, own, **others):
    line = f"{name:34} {own * 1000:8.0f} ms"
    print(line + "".join(f"   {other}: {seconds / own:5.1f} x" for other, seconds in others.items()))


def animation():
    rng = np.random.default_rng(0)
    parents = np.array([-1] + [max(0, i - 1 - rng.integers(0, 3)) for i in range(1, JOINTS)])
    turns = 0.05 * rng.normal(size=(FRAMES, JOINTS, 3)).cumsum(axis=0)
    rotations = Rotation.from_rotvec(turns.reshape(-1, 3)).as_quat().reshape(FRAMES, JOINTS, 4)
    names = tuple(f"joint{i}" for i in range(JOINTS))
    return Animation(names, parents, rng.normal(size=(JOINTS, 3)), rotations, rng.normal(size=(FRAMES, 3)), RATE)


def slerped(rotations, rate, new_rate, frames):
    """The obvious resampling: slerp, joint by joint, which neither filters nor batches."""
    times, new_times = np.arange(len(rotations)) / rate, np.arange(frames) / new_rate
    return [Slerp(times, Rotation.from_quat(rotations[:, j]))(new_times).as_quat() for j in range(rotations.shape[1])]


def main():
    moving = animation()
    degrees = np.random.default_rng(1).uniform(-180, 180, size=(FRAMES * JOINTS, 3))
    with tempfile.TemporaryDirectory() as folder:
        path, other = str(Path(folder) / "a.bvh"), str(Path(folder) / "b.bvh")
        report("write_bvh", best(lambda: write_bvh(path, moving)), savetxt=best(lambda: savetxt(other, moving)))
        report("read_bvh", best(lambda: read_bvh(path)), pybvh=best(lambda: pybvh.read_bvh_file(path).to_quat()))
    scipy = best(lambda: Rotation.from_euler("ZYX", degrees, degrees=True).as_quat(), times=1)
    report("from_euler", best(lambda: from_euler("ZYX", degrees)), scipy=scipy)
    frames = FRAMES // 8
    own = best(lambda: resample_rotations(moving.rotations, RATE, 15, frames))
    slerp = best(lambda: slerped(moving.rotations, RATE, 15, frames), times=1)
    report("resample_rotations 120 -> 15 fps", own, slerp=slerp)


def savetxt(path, moving):
    angles = Rotation.from_quat(moving.rotations.reshape(-1, 4)).as_euler("ZYX", degrees=True)
    np.savetxt(path, angles.reshape(len(moving), -1), fmt="%.6f")


if __name__ == "__main__":
    main()
