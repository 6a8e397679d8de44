"""How fast is judging: each hot path of `cospeech.evaluation` against the obvious alternative, as ratios in one run.

python benchmarks/bench_evaluation.py
"""

import numpy as np
from scipy.linalg import sqrtm
from timing import fastest

from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.skeleton import UPPER55


def frechet_by_matrix_root(a, b):
    s, t = np.cov(a.T), np.cov(b.T)
    return np.sum((a.mean(0) - b.mean(0)) ** 2) + np.trace(s + t - 2 * np.real(sqrtm(s @ t)))


def changes_by_loops(positions):
    angles = np.zeros((len(positions), len(metrics.BODY_ANGLES)))
    for t, pose in enumerate(positions):
        for k, (a, b) in enumerate(metrics.BONES[metrics.BODY_ANGLES]):
            u, v = (pose[bone[1]] - pose[bone[0]] for bone in (a, b))
            cosine = u @ v / max(np.linalg.norm(u) * np.linalg.norm(v), 1e-9)
            angles[t, k] = np.arccos(np.clip(cosine, -1, 1)) / np.pi
    return np.abs(np.diff(angles, axis=0))


def coverage_by_loops(beats, onsets):
    return np.mean([np.exp(-min((onset - beat) ** 2 for beat in beats) / 0.02) for onset in onsets])


def main():
    rng = np.random.default_rng(0)
    positions = np.cumsum(rng.normal(0, 0.01, (900, len(UPPER55), 3)), axis=0) + rng.normal(size=(len(UPPER55), 3))
    a, b = rng.normal(size=(2000, 128)), rng.normal(size=(170, 128)) @ rng.normal(size=(128, 128))
    beats, onsets = np.sort(rng.uniform(0, 600, 1200)), np.sort(rng.uniform(0, 600, 2400))
    cases = [
        ("Frechet distance, 128-d (matrix root)", metrics.frechet_distance, frechet_by_matrix_root, (a, b)),
        ("angle changes, 60 s (loops)", metrics.angle_changes, changes_by_loops, (positions,)),
        ("beat consistency, 10 min (loops)", metrics.onset_coverage, coverage_by_loops, (beats, onsets)),
    ]
    for name, ours, obvious, arguments in cases:
        mine, other = fastest(lambda f=ours, x=arguments: f(*x)), fastest(lambda f=obvious, x=arguments: f(*x), 2)
        print(f"{name:40s} {1e3 * mine:9.2f} ms   {other / mine:8.1f} times the speed of the obvious way")


if __name__ == "__main__":
    main()
