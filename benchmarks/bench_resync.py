"""The resynchroniser's training set on demand against arrays of it, and the learned audio rank against the plain one.

    python benchmarks/bench_resync.py [--takes 6] [--seconds 60]

On takes of a demo speaker. Every line is measured in this one run; the ratios are what to look at.
"""

import argparse
import tempfile
import warnings
from pathlib import Path

import numpy as np
from timing import timed

from cospeech.demo import read_take, write_take
from cospeech.matching import Database, Matcher
from cospeech.matching.resync.gan import settings_from
from cospeech.matching.resync.window_pairs import training_pairs
from cospeech.matching.search.similarity import Settings, train_similarity


def takes(count, seconds):
    """Clips of the calm demo speaker."""
    with tempfile.TemporaryDirectory() as folder:
        for take in range(count):
            files = Path(folder, f"{take}.h5"), Path(folder, f"{take}.wav")
            write_take("calm", take, seconds=seconds, seed=0, truth=files[0], wav=files[1])
            yield read_take(*files, subject="calm", clip=f"take{take}")


def seconds_each(run, times=20):
    return timed(lambda: [run(i) for i in range(times)])[0] / times


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--takes", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=60.0)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    clips = list(takes(arguments.takes, arguments.seconds))
    database = Database.from_clips(clips)

    pairs = training_pairs(clips, database, settings_from({}), seed=0)
    whole = pairs.take(slice(None))
    kept = sum(array.nbytes for array in pairs.windows.arrays.values()) + pairs.fakes.clip.nbytes * 2
    size = sum(array.nbytes for array in whole.values())
    print(f"{len(pairs)} windows: {kept / 1e6:.1f} MB kept, {size / 1e6:.1f} MB as arrays, ratio {size / kept:.0f}")
    draw = lambda i: np.random.default_rng(i).integers(len(pairs), size=100)
    asked = seconds_each(lambda i: pairs.take(draw(i)))
    copied = seconds_each(lambda i: {name: array[draw(i)] for name, array in whole.items()})
    print(f"a batch of 100: {asked * 1e3:.1f} ms on demand, {copied * 1e3:.1f} ms from arrays")

    similarity, _ = train_similarity(database, Settings(steps=50))
    took, learned = timed(lambda: similarity.applied(database))
    print(f"embedding the database, once: {took * 1e3:.0f} ms for {len(database)} clips")
    speech = clips[0].features
    for name, searched in (("plain", Matcher(database)), ("learned", Matcher(learned))):
        found = seconds_each(lambda i, matcher=searched: matcher.search(speech, seed=i), 5)
        print(f"a speech of {arguments.seconds:g} s, {name} audio rank: {found:.2f} s")


if __name__ == "__main__":
    main()
