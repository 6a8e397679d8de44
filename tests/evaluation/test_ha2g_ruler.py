"""HA2G's autoencoders: their published layers, both activations, their losses on numbers done by hand."""

import numpy as np
import pytest
import torch

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics import expressive
from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.evaluation.metrics.expressive import FORMS, RULERS, Ruler, Settings, train_ruler
from cospeech.evaluation.metrics.fgd import AutoEncoder, FeatureNet

QUICK = Settings(steps=60, batch=32, decays=1)


@pytest.fixture(scope="module")
def ruler(training_part):
    return train_ruler("expressive", training_part, QUICK)[0]


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


@pytest.mark.parametrize("name", RULERS)
def test_every_ruler_has_its_skeleton_and_latent_size(training_part, name):
    found, history = train_ruler(name, training_part[:1], Settings(steps=2, batch=4))
    vectors = {"expressive43": 42, "ted10": 9}[found.table.name]
    latents = found.latents(expressive.clip_vectors(training_part[0], found.table))
    assert found.table.vectors == vectors and latents.shape[1] == FORMS[name.split("_")[0]].latent
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
    task = expressive.VectorReconstruction(None, AutoEncoder(128, 126), Settings(), FORMS["expressive"].cosine, 100)
    loss = {name: value.item() for name, value in task.loss(made.flatten(2), real.flatten(2)).items()}
    assert loss == pytest.approx({"position": 2 / 3, "difference": 0.0, "direction": 0.001 * 34 * 42})
    assert task.loss(real.flatten(2), real.flatten(2))["direction"].item() == pytest.approx(0, abs=1e-5)
    moved = made.clone()
    moved[:, 1::2] = real[:, 1::2]
    assert task.loss(moved.flatten(2), real.flatten(2))["difference"].item() == pytest.approx(2 / 3)


def test_the_rate_falls_to_a_tenth_as_often_as_told(training_part):
    rates = []

    class Watched(expressive.VectorReconstruction):
        def iterate(self, step, rng):
            losses = super().iterate(step, rng)
            rates.append(self.optimizers["network"].param_groups[0]["lr"])
            return losses

    clip = training_part[0]
    vectors = expressive.clip_vectors(clip, expressive.level_table("ted10")).reshape(clip.frames, -1)
    windows = expressive.Windows([{"pose": vectors}], [clip.valid], 34)
    task = Watched(windows, AutoEncoder(32, 27), Settings(batch=2, decays=2), 0.0, 6)
    for step in range(6):
        task.iterate(step, np.random.default_rng(step))
    assert rates == pytest.approx([5e-4, 5e-4, 5e-5, 5e-5, 5e-6, 5e-6])


def test_a_ruler_is_the_same_bytes_again_and_names_its_file(tmp_path, training_part, ruler):
    again, _ = train_ruler("expressive", training_part, QUICK)
    for name, one in (("a", ruler), ("b", again)):
        one.save(tmp_path / f"{name}.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()
    read = Ruler.load(tmp_path / "a.safetensors")
    vectors = expressive.clip_vectors(training_part[0], ruler.table)
    assert np.array_equal(read.latents(vectors), ruler.latents(vectors))
    assert len(read.sha256) == 64 and read.description["speakers"] == ["puppet"]


def test_frechet_distance_grows_with_damage(training_part, speaker, ruler):
    test = [speaker(seed)[0] for seed in (20, 21)]
    rng = np.random.default_rng(0)
    noise = lambda size: [clip.positions + rng.normal(0, size, clip.positions.shape) for clip in test]  # noqa: E731
    latents = lambda motions: np.concatenate(  # noqa: E731
        [ruler.latents(expressive.bone_vectors(positions, None, ruler.table)) for positions in motions]
    )
    truth = latents([clip.positions for clip in test])
    near, far = (metrics.frechet_distance(latents(noise(size)), truth) for size in (0.002, 0.02))
    train = metrics.frechet_distance(latents([clip.positions for clip in training_part]), truth)
    assert near < far and train < far


def test_size_of_a_person_does_not_matter(training_part, ruler):
    clip = training_part[0]
    tall = expressive.bone_vectors(1.3 * clip.positions, clip.rotation, ruler.table)
    body = np.s_[:, :37]  # the face's points have a size of their own
    assert tall[body] == pytest.approx(expressive.clip_vectors(clip, ruler.table)[body], abs=1e-6)


def test_a_motion_shorter_than_a_window_has_no_latent(training_part, ruler):
    assert ruler.latents(expressive.clip_vectors(training_part[0].section(0, 33), ruler.table)).shape == (0, 128)


def test_weights_of_something_else_are_refused(tmp_path, training_part, ruler):
    FeatureNet(AutoEncoder(8), {"network": "fgd", "latent": 8}).save(tmp_path / "other.safetensors")
    with pytest.raises(CospeechError, match="expected a ruler"):
        Ruler.load(tmp_path / "other.safetensors")
    with pytest.raises(CospeechError, match="known: expressive, expressive_compat, trimodal"):
        train_ruler("euclid", training_part)
