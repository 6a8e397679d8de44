"""HA2G's autoencoders: their published layers, both activations, their losses on numbers done by hand."""

import numpy as np
import pytest
import torch

from cospeech.errors import CospeechError
from cospeech.evaluation.columns import NETS
from cospeech.evaluation.metrics import gesture_metrics
from cospeech.evaluation.metrics.expressive import Settings
from cospeech.evaluation.metrics.fgd import OURS, PRESETS, AutoEncoder, FeatureNet, Reconstruction, train_feature_net
from cospeech.learning.windows import Windows

QUICK = Settings(steps=60, batch=32, decays=1)


@pytest.fixture(scope="module")
def expressive_net(training_part):
    return train_feature_net(training_part, QUICK, preset="expressive")[0]


def linear(inputs, outputs):
    return inputs * outputs + outputs


def test_expressive_has_the_layers_of_table_9():
    convolutions = 126 * 32 * 3 + 32 + 32 * 64 * 3 + 64 + 64 * 64 * 4 + 64 + 64 * 32 * 3 + 32
    norms = 2 * (32 + 64 + 64 + 256 + 128)
    expected = convolutions + norms + linear(384, 256) + linear(256, 128) + linear(128, 128)
    network = AutoEncoder(128, 126)
    assert sum(p.numel() for p in network.encoder.parameters()) == expected
    assert network.encode(torch.zeros(2, 34, 126)).shape == (2, 128)
    assert network(torch.zeros(2, 34, 126)).shape == (2, 34, 126)


@pytest.mark.parametrize("name", NETS)
def test_every_preset_has_its_skeleton_and_latent_size(training_part, name):
    found, history = train_feature_net(training_part[:1], Settings(steps=2, batch=4), preset=name)
    vectors, latent = {"expressive43": (42, 128), "ted10": (9, 32)}[found.preset.table]
    latents = found.latents(training_part[0].positions, training_part[0].rotation)
    assert found.preset.channels == 3 * vectors and latents.shape[1] == latent
    assert len(latents) == len(range(0, training_part[0].frames - 33, 10))
    assert ("direction" in history.losses) == name.startswith("expressive")


def dense_part(slope):
    """The encoder's dense layers, with statistics that are not those of a new network, as a function of 384 numbers."""
    torch.manual_seed(0)
    network = AutoEncoder(32, 27, slope).eval()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm1d):
            torch.nn.init.normal_(module.running_mean), torch.nn.init.uniform_(module.running_var, 0.5, 2.0)
    return network.encoder[5:].double()


def test_compatibility_makes_the_dense_part_affine_and_the_correction_does_not():
    x, y = torch.randn(2, 8, 384, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    released, corrected = dense_part(1.0), dense_part(0.2)
    for layers, affine in ((released, True), (corrected, False)):
        gap = layers((x + y) / 2) - (layers(x) + layers(y)) / 2
        assert (gap.abs().max().item() < 1e-9) == affine


def test_loss_terms_by_hand(training_part):
    """All bones turned by 90 degrees: |x| + |y| of unit bones differ by 2 in 3 numbers, cosines are 0."""
    real = torch.zeros(3, 34, 42, 3)
    real[..., 0] = 1
    made = real.roll(1, dims=-1)
    task = Reconstruction(None, AutoEncoder(128, 126), Settings(), PRESETS["expressive"].cosine)
    loss = {name: value.item() for name, value in task.loss(made.flatten(2), real.flatten(2)).items()}
    assert loss == pytest.approx({"position": 2 / 3, "difference": 0.0, "direction": 0.001 * 34 * 42})
    assert task.loss(real.flatten(2), real.flatten(2))["direction"].item() == pytest.approx(0, abs=1e-5)
    moved = made.clone()
    moved[:, 1::2] = real[:, 1::2]
    assert task.loss(moved.flatten(2), real.flatten(2))["difference"].item() == pytest.approx(2 / 3)


def test_the_rate_falls_to_a_tenth_as_often_as_told(training_part):
    rates = []

    class Watched(Reconstruction):
        def iterate(self, step, rng):
            losses = super().iterate(step, rng)
            rates.append(self.optimizers["network"].param_groups[0]["lr"])
            return losses

    clip = training_part[0]
    vectors = PRESETS["trimodal"].vectors(clip.positions, clip.rotation)
    windows = Windows([{"pose": vectors}], [clip.valid], 34)
    task = Watched(windows, AutoEncoder(32, 27), Settings(steps=6, batch=2, decays=2))
    for step in range(6):
        task.iterate(step, np.random.default_rng(step))
    assert rates == pytest.approx([5e-4, 5e-4, 5e-5, 5e-5, 5e-6, 5e-6])


def test_it_is_the_same_bytes_again_and_names_its_file(tmp_path, training_part, expressive_net):
    again, _ = train_feature_net(training_part, QUICK, preset="expressive")
    for name, one in (("a", expressive_net), ("b", again)):
        one.save(tmp_path / f"{name}.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()
    read, clip = FeatureNet.load(tmp_path / "a.safetensors", "expressive"), training_part[0]
    motion = clip.positions, clip.rotation
    assert np.array_equal(read.latents(*motion), expressive_net.latents(*motion))
    assert len(read.sha256) == 64 and read.description["speakers"] == ["puppet"]


def test_frechet_distance_grows_with_damage(training_part, speaker, expressive_net):
    test = [speaker(seed)[0] for seed in (20, 21)]
    rng = np.random.default_rng(0)
    noise = lambda size: [clip.positions + rng.normal(0, size, clip.positions.shape) for clip in test]
    latents = lambda motions: np.concatenate([expressive_net.latents(positions) for positions in motions])
    truth = latents([clip.positions for clip in test])
    near, far = (gesture_metrics.frechet_distance(latents(noise(size)), truth) for size in (0.002, 0.02))
    train = gesture_metrics.frechet_distance(latents([clip.positions for clip in training_part]), truth)
    assert near < far and train < far


def test_size_of_a_person_does_not_matter(training_part, expressive_net):
    clip, seen = training_part[0], expressive_net.preset.vectors
    body = np.s_[:, : 3 * 37]  # the face's points have a size of their own
    tall = seen(1.3 * clip.positions, clip.rotation)[body]
    assert tall == pytest.approx(seen(clip.positions, clip.rotation)[body], abs=1e-6)


def test_a_motion_shorter_than_a_window_has_no_latent(training_part, expressive_net):
    assert expressive_net.latents(training_part[0].section(0, 33).positions).shape == (0, 128)


def test_weights_of_something_else_are_refused(tmp_path, training_part, expressive_net):
    FeatureNet(AutoEncoder(8), {"network": "fgd", "latent": 8}).save(tmp_path / "other.safetensors")
    with pytest.raises(CospeechError, match="weights of 'directions', expected the FGD feature network 'expressive'"):
        FeatureNet.load(tmp_path / "other.safetensors", "expressive")
    with pytest.raises(CospeechError, match="known: expressive, expressive_compat, trimodal"):
        train_feature_net(training_part, preset="euclid")


def test_weights_of_an_earlier_version_are_read(tmp_path, training_part, expressive_net):
    """They said `ruler` for what is the preset now, and nothing of the network."""
    earlier = {key: value for key, value in expressive_net.description.items() if key not in ("network", "preset")}
    FeatureNet(expressive_net.network, earlier | {"ruler": "expressive"}).save(tmp_path / "earlier.safetensors")
    read, positions = FeatureNet.load(tmp_path / "earlier.safetensors", "expressive"), training_part[0].positions
    assert np.array_equal(read.latents(positions), expressive_net.latents(positions))


def test_every_preset_of_ha2g_has_names_for_its_metrics():
    assert [*NETS, OURS] == list(PRESETS)
