"""A study's folder against films of the same clips, and its bootstrap against one optimisation a resample.

python benchmarks/bench_study.py      (six methods on two tracks of 12 s, synthetic)
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile
from scipy import optimize
from timing import timed

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks.bench_player import synthetic
from cospeech.render.video import render_video
from cospeech.study.build import Design, build_study
from cospeech.study.statistics import bradley_terry, strengths
from cospeech.study.stimuli import Stimulus, cut

METHODS, SECONDS, RATE = 6, 12.0, 16000


def prepared(folder):
    """Stimuli of every method on two tracks of noise."""
    noise = np.random.default_rng(0).normal(0, 0.05, round(60 * RATE))
    soundfile.write(folder / "speech.wav", noise, RATE)
    stimuli = []
    for method in range(METHODS):
        replace(synthetic(method), audio="speech.wav").write(folder / f"{method}.h5")
        stimuli += [
            Stimulus(f"m{method}", f"t{start}", folder / f"{method}.h5", start, folder / "speech.wav", start, SECONDS)
            for start in (0.0, 20.0)
        ]
    return stimuli


def films(folder, stimuli):
    """The obvious way: one mp4 a clip."""
    folder.mkdir()
    for i, stimulus in enumerate(stimuli):
        clip, sound = cut(stimulus)
        render_video(folder / f"{i}.mp4", [("", clip)], audio=sound, subtitles=False)


def one_by_one(duels, resamples):
    """The obvious bootstrap: scipy minimises the negative log-likelihood of each resample."""
    rng = np.random.default_rng(0)
    for _ in range(resamples):
        wins = duels[rng.integers(len(duels), size=len(duels))].sum(0)
        optimize.minimize(lambda s, w=wins: (w * np.log1p(np.exp(s[None] - s[:, None]))).sum(), np.zeros(len(wins)))


def megabytes(folder):
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        stimuli = prepared(folder)
        build_study(folder / "warm", stimuli[:4], Design(tracks=2))  # compiles
        render_video(folder / "warm.mp4", [("", cut(stimuli[0])[0].section(0, 5))])
        study, _ = timed(lambda: build_study(folder / "study", stimuli, Design(tracks=2)))
        filmed, _ = timed(lambda: films(folder / "films", stimuli))
        sizes = [megabytes(folder / part) for part in ("study", "films")]
    print(
        f"{len(stimuli)} clips of {SECONDS:g} s: study {study:.1f} s, {sizes[0]:.1f} MB; films "
        f"{filmed:.1f} s, {sizes[1]:.1f} MB; {filmed / study:.1f} times faster, "
        f"{sizes[1] / sizes[0]:.1f} times smaller"
    )
    rng = np.random.default_rng(0)
    duels = rng.integers(0, 3, (40, 8, 8)) * (1 - np.eye(8))
    assert np.isfinite(bradley_terry(duels.sum(0))).all()
    together, _ = timed(lambda: strengths(duels, "q", list("abcdefgh"), resamples=1000))
    alone, _ = timed(lambda: one_by_one(duels, 50))
    print(
        f"bootstrap, 1000 resamples of 8 methods: {together:.2f} s; one by one {20 * alone:.1f} s; "
        f"{20 * alone / together:.0f} times faster"
    )


if __name__ == "__main__":
    main()
