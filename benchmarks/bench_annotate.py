"""From track to clip, each hot path against the obvious way in one run: `python benchmarks/bench_annotate.py`."""

import sys
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from timing import PROCESSOR, fastest

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "capture"))
from person import make_track

from cospeech.capture.annotate import annotate
from cospeech.capture.cleanup.assemble import assemble
from cospeech.capture.cleanup.clean import Cleanup, clean
from cospeech.capture.cleanup.fill import fill_joints
from cospeech.capture.fit_face import FitSettings, _basis, _landmarks, fit_track
from cospeech.face.model import embedded
from cospeech.face.solver import State, predict, smoothed_step, start

SECONDS, RATE = 60.0, 30.0
best = partial(fastest, times=2, clock=PROCESSOR)


def report(name, own, **others):
    line = f"{name:44} {own * 1000:8.1f} ms"
    print(line + "".join(f"   {other}: {seconds / own:6.1f} x" for other, seconds in others.items()))


def joint_by_joint(positions, believed):
    for j in range(positions.shape[1]):
        known = np.flatnonzero(believed[:, j])
        CubicSpline(known, positions[known, j])(np.arange(len(positions)))


def frame_by_frame(track, frames):
    """The obvious fit: every frame on its own by scipy's least squares, with the same landmarks and priors."""
    points, model = track.face_landmarks, embedded()
    basis, _ = _basis(model, model.landmarks)
    marks, _ = _landmarks(points.xyz.astype(float), points.score, RATE, None, True, (), basis, FitSettings())
    state, count = start(basis, marks), basis.expression.shape[-1]
    for i in range(frames):
        one, own = marks.section(slice(i, i + 1)), state.section(slice(i, i + 1))

        def residual(x, one=one, own=own):
            trial = State(x[None, :count], own.rotation, x[None, count : count + 3], own.log_scale, own.identity)
            miss = (one.targets - predict(basis, one, trial, own=False)[0]) * np.sqrt(one.weights)[..., None]
            return np.concatenate([miss.ravel(), x[:count] / 0.5])

        least_squares(residual, np.concatenate([own.expression[0], own.translation[0]]), max_nfev=3)


def dense(frames, n):
    """The same normal equations as one full matrix."""
    np.linalg.solve(np.eye(frames * n), np.zeros(frames * n))


def main():
    warnings.simplefilter("ignore")
    embedded()
    track = make_track(SECONDS, RATE, noise=0.004)
    whole = best(lambda: annotate(track, subject="s", clip="c"))
    print(f"clean-up and face fit together: {SECONDS / whole:.0f} times as fast as the film runs (CPU time)")
    sight, frames = assemble(track), round(SECONDS * 15)
    report("clean-up, 60 s at 30 fps", best(lambda: clean(sight, RATE, frames, settings=Cleanup())))
    believed = np.random.default_rng(0).random((1, 3)).repeat(len(sight), 0) < np.linspace(0.2, 2, len(sight))[:, None]
    believed = believed[:, np.arange(55) % 3]
    believed[[0, -1]] = True
    own = best(lambda: fill_joints(sight.positions, believed, 16))
    report("gaps of 55 joints", own, joint_by_joint=best(lambda: joint_by_joint(sight.positions, believed)))
    fitting, some = best(lambda: fit_track(track)), 8
    alone = best(lambda: frame_by_frame(track, some), times=1) * len(sight) / some
    report("face fit, 1800 frames", fitting, frame_by_frame=alone)
    rng, n, few = np.random.default_rng(0), 66, 32
    matrix = np.tile(np.eye(n) * 9, (few, 1, 1))
    band = best(
        lambda: smoothed_step(
            matrix, rng.normal(size=(few, n)), np.zeros((few - 1, n)), np.ones(n), np.ones(few - 1, bool)
        )
    )
    report("one Gauss-Newton step of 32 frames", band, full_matrix=best(lambda: dense(few, n)))


if __name__ == "__main__":
    main()
