"""HA2G's data: windows cut from whole takes against windows made one by one, and wanted words against whole files.

    python benchmarks/bench_ha2g_data.py [--minutes 10] [--words 20000]

Processor seconds count, so that a busy machine changes the ratios little.
"""

import argparse
import tempfile
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from timing import PROCESSOR, fastest

from cospeech.clip import Clip, Words
from cospeech.gestures.ha2g.dataset.collect import Take, collect
from cospeech.gestures.ha2g.dataset.embeddings import read_embeddings
from cospeech.gestures.ha2g.dataset.filters import Filters
from cospeech.skeleton import UPPER55
from cospeech.speech.mel import log_mel, log_mel_s2g

ANYTHING = Filters(words=0, difference=0.0, spine_most=360.0, spine_mean=360.0, wrist=0.0)
BATCH = 32
seconds = partial(fastest, clock=PROCESSOR)


def take_of(minutes, rng):
    frames = round(minutes * 60 * 15)
    positions = rng.normal(size=(frames, len(UPPER55), 3)).astype(np.float32)
    samples = rng.normal(0, 0.1, round(minutes * 60 * 16000)).astype(np.float32)
    clip = Clip("one", "take", 15.0, positions, np.zeros((frames, 28), np.float32), words=Words.none())
    return Take(clip, samples)


def batches(minutes, rng):
    """A training batch of every kind of sound: cut from the corpus, and made from each window's wave."""
    with warnings.catch_warnings(action="ignore"):
        corpus = collect({"one": [take_of(minutes, rng)]}, filters=ANYTHING)
    corpus.sample(rng, BATCH)  # once, so that nothing is loaded below
    cut = seconds(lambda: corpus.sample(rng, BATCH, ("mel", "s2g_mel")))

    def one_by_one():
        for wave in corpus.sample(rng, BATCH, ("wave",))["wave"]:
            log_mel(wave)
            log_mel_s2g(wave)

    made = seconds(one_by_one, times=2)
    print(
        f"spectrograms of {BATCH} windows: cut {1000 * cut:.1f} ms, made {1000 * made:.0f} ms, {made / cut:.0f} times"
    )


def word_vectors(count, rng):
    """500 wanted words of a text file: only their lines parsed, and all lines parsed."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "vectors.vec"
        lines = [f"word{i} " + " ".join(f"{x:.4f}" for x in rng.normal(size=300)) for i in range(count)]
        file.write_text("\n".join([f"{count} 300", *lines]))
        wanted, every = {f"word{i}" for i in range(0, count, count // 500)}, {f"word{i}" for i in range(count)}
        some, all_of_it = (
            seconds(lambda words=words: read_embeddings(file, words), times=2) for words in (wanted, every)
        )
    print(f"500 of {count} word vectors: {some:.2f} s, all parsed {all_of_it:.2f} s, x {all_of_it / some:.0f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--words", type=int, default=20_000)
    options, rng = parser.parse_args(), np.random.default_rng(0)
    batches(options.minutes, rng)
    word_vectors(options.words, rng)


if __name__ == "__main__":
    main()
