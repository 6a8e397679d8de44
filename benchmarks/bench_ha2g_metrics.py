"""How fast are HA2G's metrics: each hot path against the obvious alternative, as ratios in one run.

python benchmarks/bench_ha2g_metrics.py
"""

import numpy as np
import torch
from sklearn.cross_decomposition import CCA
from timing import fastest

from cospeech.evaluation.metrics import beats, genea
from cospeech.evaluation.metrics.fgd import PRESETS, AutoEncoder, FeatureNet
from cospeech.evaluation.metrics.gesture_metrics import onset_coverage
from cospeech.gestures.ha2g.dataset.levels import included_angles, level_table

TABLE = level_table("expressive43")


def angles_by_loops(vectors):
    pairs = [(a, b) for a, b in TABLE.angle_pairs]
    angles = np.zeros((len(vectors), TABLE.angles))
    for t, pose in enumerate(vectors):
        others = [(pose[a], np.cross(pose[b], pose[c])) for a, b, c in TABLE.palm_pairs]
        for k, (u, v) in enumerate([(pose[a], pose[b]) for a, b in pairs] + others):
            angles[t, k] = np.arccos(np.clip(u @ v / (np.linalg.norm(u) * np.linalg.norm(v)), -1, 1)) / np.pi
    return angles


def latents_one_by_one(net, flat):
    starts = range(0, len(flat) - 33, 10)
    with torch.inference_mode():
        return np.concatenate([net.network.encode(torch.as_tensor(flat[None, s : s + 34])).numpy() for s in starts])


def coverage_by_loops(found, onsets):
    return np.mean([np.exp(-min((onset - beat) ** 2 for beat in found) / 0.02) for onset in onsets])


def main():
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    frames = 900  # a minute
    vectors = np.cumsum(rng.normal(0, 0.05, (frames, TABLE.vectors, 3)), axis=0) + rng.normal(size=(TABLE.vectors, 3))
    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
    single = vectors.astype(np.float32).reshape(frames, -1)
    preset = PRESETS["expressive"]
    network = AutoEncoder(preset.latent, preset.channels, preset.slope).eval()
    net = FeatureNet(network, {"preset": "expressive", "latent": preset.latent})
    found, onsets = np.sort(rng.uniform(0, 60, 120)), np.sort(rng.uniform(0, 60, 350))
    a, b = rng.normal(size=(frames, 39)), rng.normal(size=(frames, 39))
    b[:, :3] += a[:, :3]
    cases = {
        "included angles of a minute": (lambda: included_angles(vectors, TABLE), lambda: angles_by_loops(vectors)),
        "latents of a minute": (lambda: net.latents_of_vectors(single), lambda: latents_one_by_one(net, single)),
        "onsets that meet beats": (lambda: onset_coverage(found, onsets), lambda: coverage_by_loops(found, onsets)),
        "first canonical correlation": (
            lambda: genea.canonical_correlation(a, b),
            lambda: CCA(n_components=1, max_iter=1500).fit_transform(a, b),
        ),
    }
    assert np.allclose(included_angles(vectors, TABLE), angles_by_loops(vectors))
    assert np.allclose(net.latents_of_vectors(single), latents_one_by_one(net, single), atol=1e-4)
    assert np.isclose(onset_coverage(found, onsets), coverage_by_loops(found, onsets))
    for name, (ours, obvious) in cases.items():
        own = fastest(ours, 3)
        print(f"{name:32} {own * 1000:8.2f} ms   the obvious way takes {fastest(obvious, 2) / own:6.1f} x")
    changes = [beats.angle_changes(vectors, TABLE)] * 6
    whole = fastest(lambda: beats.beat_consistency(changes, [onsets] * 6, changes[0].mean(axis=0), threshold=0.06), 3)
    print(f"{'BC of six minutes, with chance':32} {whole * 1000:8.2f} ms")


if __name__ == "__main__":
    main()
