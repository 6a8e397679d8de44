"""Positions to rotations against the obvious loop, and how long 60 s of gesture take to write.

Run: python benchmarks/bench_export.py
"""

import tempfile
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from timing import fastest, timed

from cospeech.clip import Clip
from cospeech.formats.animation import Animation
from cospeech.formats.bvh import write_bvh
from cospeech.formats.glb import write_glb
from cospeech.formats.ik import INDEX, NAMES, PARENTS, REST_DIRECTIONS, SOURCES, animation_from_clip
from cospeech.formats.table import write_csv
from cospeech.skeleton import UPPER55

FRAMES, FPS = 900, 15.0
LOOP_FRAMES = 30  # the loop is slow; its time is scaled up to FRAMES


def random_clip(seed=0):
    """60 s of smooth random rotations of a plausible skeleton, as a clip."""
    rng = np.random.default_rng(seed)
    offsets = np.nan_to_num(REST_DIRECTIONS, nan=0.0) * 0.1
    for name in NAMES:
        if np.isnan(REST_DIRECTIONS[INDEX[name], 0]):
            offsets[INDEX[name]] = rng.normal(0.0, 0.05, 3)
    vectors = gaussian_filter1d(rng.normal(size=(FRAMES, len(NAMES), 3)), 6.0, axis=0)
    rotations = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(FRAMES, len(NAMES), 4)
    animation = Animation(NAMES, PARENTS, offsets, rotations, np.zeros((FRAMES, 3)), FPS)
    positions = np.zeros((FRAMES, len(UPPER55), 3))
    positions[:, SOURCES] = animation.forward_kinematics()[0]
    for side in ("left", "right"):
        hand, wrist = UPPER55.joints(f"{side}_hand_root", f"{side}_wrist")
        positions[:, hand] = positions[:, wrist]
    return Clip("random", "bench", FPS, positions, np.zeros((FRAMES, 28))), animation


def loop_over_frames_and_joints(targets, offsets):
    """The obvious way: align each joint's rest bones with its recorded ones, one frame and joint at a time."""
    children = {joint: np.flatnonzero(joint == PARENTS) for joint in range(len(NAMES))}
    for points in targets:
        world = {-1: Rotation.identity()}
        for joint, parent in enumerate(PARENTS):
            world[joint] = world[parent]
            below = [c for c in children[joint] if np.any(offsets[c])]
            if below:
                world[joint] = Rotation.align_vectors(points[below] - points[joint], offsets[below])[0]
            (world[parent].inv() * world[joint]).as_quat()


def main():
    clip, animation = random_clip()
    solved = fastest(lambda: animation_from_clip(clip))
    targets = clip.positions[:LOOP_FRAMES, SOURCES]
    looped = timed(lambda: loop_over_frames_and_joints(targets, animation.offsets))[0] * FRAMES / LOOP_FRAMES
    print(f"positions to rotations, {FRAMES} frames: {solved * 1e3:.0f} ms; loop {looped * 1e3:.0f} ms")
    print(f"  the loop takes {looped / solved:.0f} times as long")
    animation = animation_from_clip(clip)
    with tempfile.TemporaryDirectory() as folder:
        for name, write, what in (
            ("bvh", write_bvh, animation),
            ("glb", write_glb, animation),
            ("csv", write_csv, clip),
        ):
            path = Path(folder) / f"a.{name}"
            took = fastest(lambda to=path, write=write, what=what: write(to, what))
            print(f"{name}: {took * 1e3:.0f} ms, {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    import warnings

    warnings.simplefilter("ignore")  # align_vectors warns about single bones, whose twist it cannot know
    main()
