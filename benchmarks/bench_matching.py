"""Algorithm 1 at the published size (9624 clips), against the literal triple loop and plain vectorised versions.

    python benchmarks/bench_matching.py [--clips 9624] [--quick]

Random but clustered data. Every line is measured in this one run; the ratios are what to look at, on a quiet machine.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from timing import fastest

from cospeech.clip import Words
from cospeech.matching import Database, Matcher
from cospeech.matching.database.descriptors import Moments, Normalization

LITERAL_CLIPS = 60  # the literal loop runs on these and is scaled up
CORPUS = 123_000 * 8  # queries of the published training part, 64 frames each (thesis 5.3.3)
SIZES = 1000, 3000, 10_000, 30_000
BATCHES = 512, 2048, 8192
STARTUP = """
import sys, time; begin = time.perf_counter()
import numpy as np
from cospeech.matching import Database, Matcher
database = Database.load(sys.argv[1])
Matcher(database, compiled=True).search(np.ones((8, 28), np.float32))
print(time.perf_counter() - begin)
"""
MEMORY = """
import sys
import numpy as np
from cospeech.matching import Database, fake_pairs
database = Database.load(sys.argv[1])
features = np.random.default_rng(0).normal(size=(4096, 64, 28)).astype(np.float32)
fakes = fake_pairs(database, features, [database.takes[i % len(database.takes)] for i in range(4096)])
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
kilobytes = lambda name: int(status[name].split()[0])
print((kilobytes("VmHWM") - kilobytes("RssFile")) / 1e6)
"""


def clustered(rng, clips, width):
    """(clips, 64, width) float32: smooth walks around 200 centres."""
    centres = rng.normal(size=(200, width)).astype(np.float32)
    walks = rng.standard_normal((clips, 64, width), dtype=np.float32)
    walks *= 0.12
    np.cumsum(walks, axis=1, out=walks)
    walks += centres[rng.integers(200, size=clips)][:, None] * np.float32(0.8)
    return walks


def random_database(clips):
    rng = np.random.default_rng(0)
    eligible = np.ones((clips, 64), bool)
    eligible[:, 57:] = False
    identity = [Normalization(np.zeros(n), np.ones(n)) for n in (96, 112)]
    speech, after = np.zeros((clips, 64, 14), np.float32), np.zeros((1, 14, 24), np.float32)
    return Database(
        clustered(rng, clips, 96),
        clustered(rng, clips, 112),
        np.zeros((clips, 64, 55, 3), np.float32),
        None,
        eligible,
        (np.arange(clips) // 92).astype(np.int32),
        [f"take{i}" for i in range(-(-clips // 92))],
        np.arange(clips) % 92 * 64 / 15,
        15.0,
        *identity,
        Words.none(),
        np.zeros(0, np.int32),
        np.ones_like(eligible),
        speech=speech,
        joints_after=after,
        speech_after=after[..., :14],
        clips=np.array([clips], np.int32),
        moments=(Moments.none(96), Moments.none(112)),
    )


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


def read_pass(rows):
    """A function that reads all of an array once, with all threads: the sum."""
    from numba import njit, prange

    @njit(parallel=True, fastmath=True)
    def total(rows):
        sums = np.zeros(len(rows), np.float32)
        for m in prange(len(rows)):
            for s in range(rows.shape[1]):
                for i in range(rows.shape[2]):
                    sums[m] += rows[m, s, i]
        return sums

    return lambda: total(rows)


class Table:
    """Lines of what, time, ratio to ours and what is asked, printed as they come."""

    def section(self, title):
        print(f"\n{title}")

    def line(self, what, seconds, ratio="", asked=""):
        print(f"  {what:<52}{1e3 * seconds:10.3f} ms  {ratio:<18}{asked}".rstrip(), flush=True)

    def note(self, what, value, asked=""):
        print(f"  {what:<52}{value:>13}  {'':<18}{asked}".rstrip(), flush=True)


def times(seconds, ours):
    return f"{seconds / ours:.2f} x ours"


def live(table, database, matcher, queries):
    """One query after the other, as speech arrives."""
    speeches, poses, sounds, squares = queries
    steps = 20
    long = np.tile(speeches[0], (steps, 1))
    ours = fastest(lambda: matcher.search(long), 7, warm=True) / steps
    read = fastest(read_pass(database.pose), 7, warm=True)
    literal = fastest(lambda: literal_step(database, poses[0], sounds[0], LITERAL_CLIPS), 1, warm=True) / LITERAL_CLIPS
    table.section(f"one live query, {len(database)} clips of 64 frames (per 8-frame step)")
    table.line("Matcher.search", ours, asked="at most 10 ms")
    table.line(
        "one float32 pass over the pose features, all threads", read, times(read, ours), "ours at most 1.3 of it"
    )
    seconds = fastest(database.pose.sum, 5, warm=True)
    table.line("the same by numpy's sum, one thread", seconds, times(seconds, ours))
    seconds = literal * len(database)
    table.line("literal loop, scaled", seconds, times(seconds, ours), "at least 100 x")
    seconds = fastest(lambda: numpy_step(database, squares, poses[0], sounds[0]), 5, warm=True)
    table.line("plain numpy", seconds, times(seconds, ours))


def batch(table, database, matcher, queries, sizes):
    """Many at once."""
    speeches, poses, sounds, squares = queries
    run = lambda n: matcher.search_batch(list(speeches[:n]), initial=poses[:n].astype(float))
    table.section(f"many queries at once, {len(database)} clips (per query)")
    seconds = [fastest(lambda n=n: run(n), 3 if n < 4096 else 1, warm=True) / n for n in sizes]
    for n, each in zip(sizes, seconds, strict=True):
        table.line(f"Matcher.search_batch of {n}", each, asked="at most 1.1 ms")
    plain = lambda: torch_batch(database, squares, poses[: sizes[0]], sounds[: sizes[0]])
    theirs = fastest(plain, 2, warm=True) / sizes[0]
    table.line(f"plain torch, {sizes[0]}", theirs, times(theirs, seconds[0]), "at least 2 x")
    same = np.mean(np.array([int(m.clip[0]) for m in run(sizes[0])]) == plain().numpy())
    table.note("same clip as float32 torch (decides no near-ties)", f"{same:.1%}")
    table.note(
        "whole job of 123k sequences x 8 steps, from the last", f"{seconds[-1] * CORPUS / 60:.1f} min", "under 20 min"
    )


def scaling(table, sizes):
    table.section("cost per query and 1000 clips")
    for clips in sizes:
        database = random_database(clips)
        matcher, queries = Matcher(database, compiled=True), random_queries(database, 512)
        long = np.tile(queries[0][0], (20, 1))
        one = fastest(lambda m=matcher, x=long: m.search(x), 5, warm=True) / 20
        run = lambda m=matcher, q=queries: m.search_batch(list(q[0]), initial=q[1].astype(float))
        many = fastest(run, 2, warm=True) / 512
        table.line(f"{clips} clips, live", one / clips * 1000)
        table.line(f"{clips} clips, in a batch of 512", many / clips * 1000)


def random_queries(database, count):
    """(speeches (n, 8, 28), poses (n, 96), their audio features (n, 112), squares of the database's poses)."""
    rng = np.random.default_rng(1)
    speeches = rng.normal(size=(count, 8, 28)).astype(np.float32)
    matcher = Matcher(database)
    sounds = np.concatenate([matcher.query_features(speech) for speech in speeches])
    poses = database.pose[rng.integers(len(database), size=count), rng.integers(57, size=count)]
    return speeches, poses, sounds, np.einsum("mfd,mfd->mf", database.pose, database.pose)


def fresh_process(table, database):
    """Start-up and memory of processes that open the database from its file."""
    run = lambda code, path: float(subprocess.check_output([sys.executable, "-c", code, path]))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "database.h5"
        database.save(path)
        seconds = min(run(STARTUP, path) for _ in range(3))
        table.section("a fresh process, kernels cached")
        table.note("from `import` to the first window", f"{seconds:.2f} s", "under 2 s")
        if Path("/proc/self/status").is_file():
            table.note(
                "peak memory beside the mapped file, 4096 sequences", f"{run(MEMORY, path):.2f} GB", "under 2 GB"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clips", type=int, default=9624)
    parser.add_argument("--quick", action="store_true", help="the published size alone, batches of 512")
    options = parser.parse_args()
    table = Table()
    table.note("processors, load average", f"{os.cpu_count()}, {os.getloadavg()[0]:.1f}", "load near 0")
    database = random_database(options.clips)
    matcher, batches = Matcher(database, compiled=True), BATCHES[:1] if options.quick else BATCHES
    queries = random_queries(database, batches[-1])
    live(table, database, matcher, queries)
    batch(table, database, matcher, queries, batches)
    fresh_process(table, database)
    if not options.quick:
        del database, matcher, queries
        scaling(table, SIZES)


if __name__ == "__main__":
    main()
