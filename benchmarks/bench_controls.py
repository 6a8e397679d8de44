"""Controls at the published size (9624 clips): against no control, and against a mask array for every window.

    python benchmarks/bench_controls.py [--clips 9624] [--seconds 60]
    python benchmarks/bench_controls.py --figures      # thesis Table 5.3 for the demo speakers instead

Random but clustered data. Every line is measured in this one run; the ratios are what to look at.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from bench_matching import clustered, random_database

from cospeech.demo import read_take, write_take
from cospeech.matching import KNN, Database
from cospeech.matching.signals import SIGNALS

CONTROLS = ["left_wrist_height=high@2-20", "left_wrist_speed=fast or symmetry=<0.1@15-40", "strict reach=low@45-"]
WRISTS = [7, 4]


def timed(run):
    begin = time.perf_counter()
    result = run()
    return time.perf_counter() - begin, result


def window_masks(knn, windows):
    """The obvious alternative: one (W, M, F) array for the first two controls (a mask cannot say `strict`)."""
    height, speed, symmetry = map(knn.signals.values, ("left_wrist_height", "left_wrist_speed", "symmetry"))
    mask = np.ones((windows, *height.shape), bool)
    for w in range(windows):
        middle = (8 * w + 4) / 15
        if 2 <= middle < 20:
            mask[w] &= height >= knn.signals.percentile("left_wrist_height", 85)
        if 15 <= middle < 40:
            mask[w] &= (speed >= knn.signals.percentile("left_wrist_speed", 85)) | (symmetry < 0.1)
    return mask


def figures(speaker, takes=5):
    """Threshold, mean and deviation per level: k-NN from some one-minute takes for the speech of one more."""
    clips = []
    with tempfile.TemporaryDirectory() as folder:
        for take in range(takes + 1):
            files = Path(folder, f"{take}.h5"), Path(folder, f"{take}.wav")
            write_take(speaker, take, seconds=60.0, seed=0, truth=files[0], wav=files[1])
            clips.append(read_take(*files, subject=speaker, clip=f"take{take}"))
    knn, features = KNN(Database.from_clips(clips[:takes])), clips[takes].features
    free = knn.match(features).positions
    for name in ("left_wrist_height", "left_wrist_speed", "symmetry"):
        for level, upper in reversed(SIGNALS[name].levels.items()):
            threshold = knn.signals.percentile(name, 85 if upper else 15)
            without = SIGNALS[name](free, 15.0)
            values = SIGNALS[name](knn.match(features, controls=[f"{name}={level}"]).positions, 15.0)
            copied = values[np.arange(len(values)) % 8 > 0]  # without the frames after a seam
            print(
                f"{speaker:7} {name + '=' + level:24} threshold {threshold:6.3f}  "
                f"k-NN {values.mean():6.3f} ± {values.std():.3f}  off seams {copied.mean():6.3f}  "
                f"unconstrained {without.mean():.3f} ± {without.std():.3f}"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clips", type=int, default=9624)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--figures", action="store_true")
    arguments = parser.parse_args()
    if arguments.figures:
        for speaker in ("calm", "lively"):
            figures(speaker)
        return
    database = random_database(arguments.clips)
    database.positions[:, :, WRISTS] = clustered(np.random.default_rng(1), arguments.clips, 6).reshape(-1, 64, 2, 3) / 5
    knn, frames = KNN(database), round(arguments.seconds * 15)
    features = np.random.default_rng(2).normal(size=(frames, 28)).astype(np.float32)
    knn.match(features[:80])  # compiles the kernels
    signals = timed(lambda: [knn.signals.percentile(name, 85) for name in ("left_wrist_speed", "symmetry", "reach")])[0]
    print(f"three signals and their percentiles, once: {signals:.2f} s")
    free = timed(lambda: knn.match(features))[0]
    print(f"{arguments.seconds:g} s of speech without control: {free:.2f} s")
    controlled, match = timed(lambda: knn.match(features, controls=CONTROLS))
    distinct = len(set(match.controls)) * match.database.eligible.nbytes / 1e6
    print(f"under three controls: {controlled:.2f} s, ratio {controlled / free:.2f}; masks {distinct:.1f} MB")
    two, match = timed(lambda: knn.match(features, controls=CONTROLS[:2]))
    array, same = timed(lambda: knn.match(features, mask=window_masks(knn, len(match.clip))))
    assert np.array_equal(match.clip, same.clip) and np.array_equal(match.frame, same.frame)
    size = len(match.clip) * database.eligible.nbytes / 1e6
    print(f"two of them: {two:.2f} s; a mask array for all windows: {array:.2f} s, {size:.1f} MB, same gestures")


if __name__ == "__main__":
    main()
