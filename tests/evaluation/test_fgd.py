"""The feature network: what it must tell apart, what it must not see, and that it is the same every time."""

import numpy as np
import pytest

from cospeech.clip import Clip
from cospeech.errors import CospeechError
from cospeech.evaluation.metrics.fgd import FRAMES, FeatureNet, Settings, train_feature_net
from cospeech.evaluation.metrics.gesture_metrics import frechet_distance
from cospeech.files import sha256
from cospeech.learning.weights import save_weights
from cospeech.skeleton import bone_lengths, with_bone_lengths


@pytest.fixture(scope="module")
def held_out(speaker):
    return [speaker(seed)[0].positions for seed in (100, 101, 102, 103)]


def test_fgd_orders_truth_damped_motion_and_mean_pose(feature_net, training_part, held_out):
    encode = lambda motions: np.concatenate([feature_net.latents(p, stride=3) for p in motions])
    real = encode(clip.positions for clip in training_part)
    mean = np.mean([clip.positions.mean(axis=0) for clip in training_part], axis=0)
    distances = [
        frechet_distance(encode(motions), real)
        for motions in (
            held_out,
            [mean + 0.5 * (p - mean) for p in held_out],
            [mean + 0.2 * (p - mean) for p in held_out],
            [np.broadcast_to(mean, p.shape) for p in held_out],
        )
    ]
    assert distances == sorted(distances)
    assert distances[1] > 1.5 * distances[0]


def test_fgd_grows_with_noise(feature_net, held_out):
    encode = lambda motions: np.concatenate([feature_net.latents(p, stride=3) for p in motions])
    noise = np.random.default_rng(0).normal(size=held_out[0].shape)
    real = encode(held_out)
    distances = [frechet_distance(encode([p + s * noise for p in held_out]), real) for s in (0, 0.003, 0.01, 0.03)]
    assert distances == sorted(distances)
    assert distances[0] == pytest.approx(0, abs=1e-9) and distances[-1] > 10 * distances[1]


def test_the_network_sees_directions_not_lengths(feature_net, held_out):
    motion = held_out[0].astype(np.float64)
    longer = with_bone_lengths(motion, bone_lengths(motion) * np.linspace(0.7, 1.6, 55))
    assert np.abs(longer - motion).max() > 0.05
    assert feature_net.latents(longer) == pytest.approx(feature_net.latents(motion), abs=1e-4)


def test_the_same_seed_trains_the_same_network(training_part, tmp_path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        net, history = train_feature_net(training_part[:2], Settings(steps=5, batch=8, latent=4), seed=seed)
        net.save(tmp_path / name)
        assert set(history.losses) == {"position", "difference"}
    assert sha256(tmp_path / "a") == sha256(tmp_path / "b") != sha256(tmp_path / "c")


def test_a_saved_network_gives_the_same_latents_and_knows_its_file(feature_net, held_out, tmp_path):
    path = tmp_path / "feature_net.safetensors"
    feature_net.save(path)
    read = FeatureNet.load(path)
    assert np.array_equal(read.latents(held_out[0]), feature_net.latents(held_out[0]))
    assert read.sha256 == sha256(path)
    assert read.description["latent"] == 8 and read.description["frames"] == FRAMES


def test_windows_start_every_stride_frames(feature_net, held_out):
    latents = feature_net.latents(held_out[0], stride=5)
    assert len(latents) == (len(held_out[0]) - FRAMES) // 5 + 1
    third = feature_net.encode(feature_net.preset.vectors(held_out[0])[None, 10 : 10 + FRAMES])
    assert latents[2] == pytest.approx(third[0], abs=1e-5)
    assert feature_net.latents(held_out[0][: FRAMES - 1]).shape == (0, 8)


def test_other_weights_and_takes_without_windows_are_refused(tmp_path, training_part):
    save_weights(tmp_path / "other.safetensors", {"x": np.zeros(3)}, {"model": "regression"})
    with pytest.raises(CospeechError, match="expected the FGD feature network"):
        FeatureNet.load(tmp_path / "other.safetensors")
    clip = training_part[0]
    short = Clip("puppet", "short", 15.0, clip.positions[:20], clip.features[:20])
    with pytest.raises(CospeechError, match="34 valid frames"):
        train_feature_net([short], Settings(steps=1))
