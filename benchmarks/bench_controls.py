"""Controls at the published size (9624 clips): against no control, and against a mask array for every window.

    python benchmarks/bench_controls.py [--clips 9624] [--seconds 60]
    python benchmarks/bench_controls.py --figures [CLIP.h5 ...]    # thesis Table 5.3 and seams instead: demo speakers,
                                                                   # or clips, whose last fifth is the test

Random but clustered data. Every line is measured in this one run; the ratios are what to look at.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from bench_matching import clustered, random_database
from timing import timed

from cospeech.clip import Clip
from cospeech.demo import read_take, write_take
from cospeech.matching import KNN, Database
from cospeech.matching.control.signals import SIGNALS, covered_frames
from cospeech.matching.search.seams import SEAMS, borders

CONTROLS = ["left_wrist_height=high@2-20", "left_wrist_speed=fast or symmetry=<0.1@15-40", "strict reach=low@45-"]
WRISTS = [7, 4]


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


def demo_speakers(takes=5):
    """(name, k-NN from some one-minute takes, speech features of one more)."""
    for speaker in ("calm", "lively"):
        clips = []
        with tempfile.TemporaryDirectory() as folder:
            for take in range(takes + 1):
                files = Path(folder, f"{take}.h5"), Path(folder, f"{take}.wav")
                write_take(speaker, take, seconds=60.0, seed=0, truth=files[0], wav=files[1])
                clips.append(read_take(*files, subject=speaker, clip=f"take{take}"))
        yield speaker, KNN(Database.from_clips(clips[:takes])), clips[takes].features


def recorded(paths):
    """The same of clip files."""
    for path in paths:
        clip = Clip.read(path)
        cut = round(len(clip) * 0.8)
        yield Path(path).stem, KNN(Database.from_clips([clip.section(0, cut)])), clip.features[cut:]


def figures(speaker, knn, features):
    """Threshold, mean and deviation per level, and what the frames of the database that keep it have themselves."""
    values_of = lambda name, **options: SIGNALS[name](knn.generate(features, **options).positions, 15.0)
    after_seam = np.arange(len(features)) % 8 == 0
    for name in ("left_wrist_height", "left_wrist_speed", "symmetry"):
        frames = knn.signals.values(name)[covered_frames(knn.matcher.database.eligible)]
        free = values_of(name)
        print(f"{speaker:7} {name:24} unconstrained {free.mean():.3f} ± {free.std():.3f}")
        for level, upper in reversed(SIGNALS[name].levels.items()):
            threshold = knn.signals.percentile(name, 85 if upper else 15)
            band = frames[frames >= threshold if upper else frames <= threshold]
            print(
                f"{speaker:7} {level:24} threshold {threshold:6.3f}  database's {band.mean():6.3f} ± {band.std():.3f}"
            )
            for kind, transition in (("", "off"), ("strict ", "off"), ("strict ", "inertialize")):
                found = values_of(name, controls=[f"{kind}{name}={level}"], seams=transition)
                share = found.std() / free.std()
                print(
                    f"{'':12}{kind or 'published':10}{transition:12}{found.mean():6.3f} ± {found.std():.3f} "
                    f"({share:4.0%})  off seams {found[~after_seam].mean():6.3f} ± {found[~after_seam].std():.3f}"
                )


def seams(speaker, knn, features):
    """How far the wrists move from a frame to the next, and how much that changes, at seams and elsewhere."""
    at = borders(knn.match(features)) * 8
    elsewhere = np.setdiff1d(np.arange(2, len(features)), (at[:, None] + np.arange(4)).ravel())
    for kind in SEAMS:
        made = knn.generate(features, seams=kind).positions[:, WRISTS] * 1000
        step = np.linalg.norm(np.diff(made, axis=0), axis=-1).mean(axis=1)
        change = np.linalg.norm(np.diff(made, 2, axis=0), axis=-1).mean(axis=1)
        print(
            f"{speaker:7} seams {kind:12} {len(at)}: {step[at - 1].mean():5.1f} mm, at most {step[at - 1].max():5.1f}; "
            f"change {change[at - 2].mean():5.1f} mm; elsewhere {step[elsewhere - 1].mean():5.1f}, "
            f"change {change[elsewhere - 2].mean():5.1f} mm"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clips", type=int, default=9624)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--figures", nargs="*", metavar="CLIP")
    arguments = parser.parse_args()
    if arguments.figures is not None:
        for subject in recorded(arguments.figures) if arguments.figures else demo_speakers():
            figures(*subject)
            seams(*subject)
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
