"""Algorithm 1 at the published size (9624 clips), against the literal triple loop and plain vectorised versions.

    python benchmarks/bench_matching.py [--clips 9624] [--queries 512]

Random but clustered data. Every line is measured in this one run; the ratios are what to look at.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from cospeech.clip import Words
from cospeech.matching import Database, Matcher
from cospeech.matching.features import Normalization

LITERAL_CLIPS = 60  # the literal loop runs on these and is scaled up
STARTUP = """
import sys, time; begin = time.perf_counter()
import numpy as np
from cospeech.matching import Database, Matcher
database = Database.load(sys.argv[1])
Matcher(database, compiled=True).search(np.ones((8, 28), np.float32))
print(time.perf_counter() - begin)
"""


def clustered(rng, clips, width):
    """(clips, 64, width) float32: smooth walks around 200 centres."""
    centres = rng.normal(size=(200, width)).astype(np.float32)
    steps = 0.12 * rng.standard_normal((clips, 64, width), dtype=np.float32)
    return centres[rng.integers(200, size=clips)][:, None] * 0.8 + np.cumsum(steps, axis=1, dtype=np.float32)


def random_database(clips):
    rng = np.random.default_rng(0)
    eligible = np.ones((clips, 64), bool)
    eligible[:, 57:] = False
    identity = [Normalization(np.zeros(n), np.ones(n)) for n in (96, 112)]
    return Database(
        clustered(rng, clips, 96), clustered(rng, clips, 112), np.zeros((clips, 64, 55, 3), np.float32), None, eligible,
        (np.arange(clips) // 92).astype(np.int32), [f"take{i}" for i in range(clips // 92 + 1)],
        np.arange(clips) % 92 * 64 / 15, 15.0, *identity, Words.none(), np.zeros(0, np.int32),
    )  # fmt: skip


def literal_step(database, p, f, clips):
    """The pseudo-code's loops over clips and frames, one numpy distance at a time; the ranks do not matter here."""
    for m in range(clips):
        smallest, r = np.inf, 0
        for s in range(57):
            distance = np.linalg.norm(database.pose[m, s] - p)
            if distance < smallest:
                smallest, r = distance, s
        row = database.audio[m, r]
        1 - row @ f / (np.linalg.norm(row) * np.linalg.norm(f))


def add_ranks(pose_distance, audio_distance):
    total = np.empty(len(pose_distance), np.int64)
    total[np.argsort(pose_distance, kind="stable")] = np.arange(len(total))
    total[np.argsort(audio_distance, kind="stable")] += np.arange(len(total))
    return total.argmin()


def numpy_step(database, squares, p, f):
    """Plain vectorised: one matrix-vector product, argmin per clip, two sorts."""
    keys = (squares - 2 * (database.pose.reshape(-1, 96) @ p).reshape(squares.shape))[:, :57]
    r = keys.argmin(axis=1)
    every = np.arange(len(r))
    audio = database.audio[every, r]
    return add_ranks(keys[every, r], -(audio @ f) / np.linalg.norm(audio, axis=1))


def torch_batch(database, squares, poses, sounds, chunk=64):
    """Plain torch: addmm and min over 64 clips at a time, gather, argsort."""
    import torch

    pose, audio = torch.from_numpy(database.pose), torch.from_numpy(database.audio)
    squares, queries, f = torch.from_numpy(squares), torch.from_numpy(poses), torch.from_numpy(sounds)
    keys, similarity = [torch.empty(len(queries), len(pose)) for _ in range(2)]
    for m in range(0, len(pose), chunk):
        rows = pose[m : m + chunk, :57].reshape(-1, 96)
        product = torch.addmm(squares[m : m + chunk, :57].reshape(1, -1), queries, rows.T, alpha=-2)
        keys[:, m : m + chunk], r = product.view(len(queries), -1, 57).min(dim=2)
        found = audio[torch.arange(m, m + r.shape[1]), r]
        similarity[:, m : m + chunk] = -torch.einsum("qcd,qd->qc", found, f) / found.norm(dim=2)
    total = keys.argsort(dim=1, stable=True).argsort(dim=1) + similarity.argsort(dim=1, stable=True).argsort(dim=1)
    return total.argmin(dim=1)


def best_of(count, function):
    """Smallest wall time in seconds after one call to warm up."""
    times = []
    function()
    for _ in range(count):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return min(times)


def report(name, seconds, ours):
    print(f"  {name:<44}{1e3 * seconds:10.3f} ms   {seconds / ours:8.2f} x ours")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clips", type=int, default=9624)
    parser.add_argument("--queries", type=int, default=512)
    options = parser.parse_args()
    database = random_database(options.clips)
    rng = np.random.default_rng(1)
    squares = np.einsum("mfd,mfd->mf", database.pose, database.pose)
    speeches = rng.normal(size=(options.queries, 8, 28)).astype(np.float32)
    sounds = np.concatenate([Matcher(database).query_features(speech) for speech in speeches])
    poses = database.pose[rng.integers(options.clips, size=options.queries), rng.integers(57, size=options.queries)]
    matcher, p, f = Matcher(database, compiled=True), poses[0], sounds[0]

    print(f"one live query, {options.clips} clips of 64 frames (per 8-frame step)")
    steps = 20
    long = np.tile(speeches[0], (steps, 1))
    ours = best_of(5, lambda: matcher.search(long)) / steps
    report("Matcher.search", ours, ours)
    report("literal loop (scaled)", best_of(1, lambda: literal_step(database, p, f, LITERAL_CLIPS)) / LITERAL_CLIPS
           * options.clips, ours)  # fmt: skip
    report("plain numpy", best_of(5, lambda: numpy_step(database, squares, p, f)), ours)
    report("reading the pose features once (float32 sum)", best_of(5, database.pose.sum), ours)

    print(f"{options.queries} queries at once (per query)")
    ours = best_of(3, lambda: matcher.search_batch(list(speeches), initial=poses.astype(float))) / options.queries
    report("Matcher.search_batch", ours, ours)
    report("plain torch", best_of(2, lambda: torch_batch(database, squares, poses, sounds)) / options.queries, ours)
    found = [int(m.clip[0]) for m in matcher.search_batch(list(speeches), initial=poses.astype(float))]
    same = np.mean(np.array(found) == torch_batch(database, squares, poses, sounds).numpy())
    print(f"  same clip as float32 torch, which does not decide near-ties: {same:.1%}")

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "database.h5"
        database.save(path)
        seconds = [float(subprocess.check_output([sys.executable, "-c", STARTUP, path])) for _ in range(3)]
    print(f"start-up, from `import` to the first window, kernels cached: {min(seconds):.2f} s")


if __name__ == "__main__":
    main()
