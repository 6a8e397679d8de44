"""HA2G's networks: the published shapes, what each part sees, and who is mixed into a style."""

import numpy as np
import pytest
import torch

from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.gestures.ha2g.dataset.vocabulary import Vocabulary
from cospeech.gestures.ha2g.joint_embedding import PoseEncoder
from cospeech.gestures.ha2g.networks.discriminator import Discriminator
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import SpectrogramEncoder, WaveEncoder
from cospeech.gestures.ha2g.networks.hierarchical_pose_inferer import Cascade, inferred_levels
from cospeech.gestures.ha2g.networks.style import SpeakerStyle, StyleCoordinator, blend
from cospeech.gestures.ha2g.networks.text import TextEncoder, word_embedding

WORDS = Vocabulary.of(["a", "few", "words", "of", "a", "sentence"])


def test_audio_encoder_has_the_published_shapes():
    encoder, seen = SpectrogramEncoder().eval(), []
    for module in (*encoder.stages, *(tap.body for tap in encoder.taps)):
        module.register_forward_hook(lambda module, given, made: seen.append(tuple(made.shape[1:])))
    with torch.no_grad():
        features = encoder(torch.full((1, 128, 70), -80.0))
    assert features.shape == (1, 3, 34, 32)
    stages = [(32, 128, 70), (64, 64, 35), (128, 32, 18), (256, 16, 9)]
    taps = [(64, 63, 34), (32, 62, 34), (16, 62, 34)]
    assert sorted(seen) == sorted(stages + taps)
    assert [tap.linear.in_features for tap in encoder.taps] == [4032, 1984, 992]
    convolutions = [m for m in encoder.stages.modules() if isinstance(m, torch.nn.Conv2d) and m.kernel_size == (3, 3)]
    assert len(convolutions) + 1 == 33  # and a linear layer: 34


@pytest.mark.parametrize("width", [0.1, 0.25, 0.4])
def test_audio_encoder_of_any_width(width):
    encoder = SpectrogramEncoder((1, 1, 1, 1), width).eval()
    assert encoder(torch.zeros(1, 128, 70)).shape == (1, 3, 34, 32)


def test_wave_encoder_makes_a_feature_per_frame():
    assert WaveEncoder()(torch.zeros(2, 36267)).shape == (2, 34, 32)


@pytest.mark.parametrize(("centred", "first", "last"), [(True, 17 - 7, 17 + 8), (False, 17 - 30, 17)])
def test_text_encoder_sees_sixteen_words_around_or_thirty_one_up_to_a_frame(centred, first, last):
    encoder = TextEncoder(WORDS, 0.1, centred=centred).eval()
    for name, parameter in encoder.blocks.named_parameters():
        torch.nn.init.constant_(parameter, 0.0 if name.endswith("bias") else 0.01)  # nothing cancels or is cut off
    x = torch.ones(1, 300, 40, requires_grad=True)
    encoder.blocks(x)[0, :, 17].sum().backward()
    assert x.grad.abs().sum(1)[0].nonzero()[:, 0].tolist() == list(range(max(first, 0), last + 1))


def test_word_vectors_of_a_file_are_the_start_and_padding_stays_zero():
    vectors = np.random.default_rng(0).normal(size=(WORDS.size, 300)).astype(np.float32)
    vectors[0] = 0
    embedding = word_embedding(Vocabulary(WORDS.words, vectors))
    np.testing.assert_array_equal(embedding.weight.detach().numpy(), vectors)
    embedding(torch.tensor([0, 1])).sum().backward()
    assert (embedding.weight.grad[0] == 0).all() and (embedding.weight.grad[1] == 1).all()


def test_speakers_mix_by_weight_and_nobody_is_the_prior():
    torch.manual_seed(0)
    style = SpeakerStyle(3, 18)
    alone = style(torch.eye(3))[0]
    mixed = style(torch.tensor([[0.25, 0.0, 0.75], [0.0, 0.0, 0.0]]))[0]
    torch.testing.assert_close(mixed[0], 0.25 * alone[0] + 0.75 * alone[2])
    assert (mixed[1] == 0).all()


@pytest.mark.parametrize("form", ["linear", "mlp"])
def test_coordinator_shares_sum_to_one(form):
    torch.manual_seed(0)
    coordinator = StyleCoordinator(form, 2, 18, 6)
    shares = coordinator(torch.eye(2), torch.randn(2, 18))
    assert shares.shape == (2, 6, 3) and (shares > 0).all()
    torch.testing.assert_close(shares.sum(2), torch.ones(2, 6))
    assert shares[0].std(0).min() > 0  # levels differ


def test_ablations_of_the_coordinator():
    torch.manual_seed(0)
    given = torch.eye(2), torch.randn(2, 18)
    only = StyleCoordinator("linear", 2, 18, 6, audio_levels=("mid",))(*given)
    torch.testing.assert_close(only, torch.tensor([0.0, 1.0, 0.0]).expand(2, 6, 3))
    same = StyleCoordinator("linear", 2, 18, 6, same=True)(*given)
    torch.testing.assert_close(same, same[:, :1].expand(2, 6, 3))


def test_blend_is_a_weighted_sum():
    shares, features = torch.rand(2, 6, 3), torch.randn(2, 3, 5, 4)
    expected = sum(shares[1, 4, k] * features[1, k] for k in range(3))
    torch.testing.assert_close(blend(shares, features)[1, 4], expected)


@pytest.mark.parametrize(
    ("table", "hierarchy", "dims"),
    [
        ("expressive43", "full", [24, 30, 36, 66, 96, 126]),
        ("expressive43", "none", [126]),
        ("expressive43", "body", [24, 30, 36, 126]),
        ("expressive43", "hands", [36, 66, 96, 126]),
        ("ted10", "full", [15, 21, 27]),
        ("ted10", "body", [15, 21, 27]),
        ("ted10", "none", [27]),
    ],
)
def test_pose_hierarchies(table, hierarchy, dims):
    table = level_table(table)
    assert [table.dims(level) for level in inferred_levels(table, hierarchy)] == dims


def test_every_level_starts_from_the_one_before():
    """What each GRU is given: seed poses and flags, then the level before in its slots and zeros in the new ones."""
    torch.manual_seed(0)
    table = level_table("expressive43")
    levels = [table.channels(level) for level in range(6)]
    cascade, given = Cascade(levels, 5, 0.02, layers=1).eval(), []
    for level in cascade.levels:
        level.gru.register_forward_pre_hook(lambda module, arguments: given.append(arguments[0]))
    seed, conditions = torch.randn(2, 4, 126), [torch.randn(2, 34, 5) for _ in range(6)]
    poses = cascade(seed, conditions)
    for i, channels in enumerate(levels):
        whole = np.zeros((2, 34, 126), np.float32)
        if i:
            whole[:, :, levels[i - 1]] = poses[i - 1].detach().numpy()
        whole[:, :4] = seed.numpy()
        flag = np.zeros((2, 34, 1), np.float32)
        flag[:, :4] = 1
        expected = np.concatenate([whole[:, :, channels], flag, conditions[i].numpy()], axis=2)
        np.testing.assert_array_equal(given[i].detach().numpy(), expected)
        assert poses[i].shape == (2, 34, len(channels))


def test_published_generator_inputs():
    table = level_table("expressive43")
    cascade = Cascade([table.channels(level) for level in range(6)], 32 + 32 + 16)
    assert [level.gru.input_size - 81 for level in cascade.levels] == [24, 30, 36, 66, 96, 126]
    assert {(level.gru.hidden_size, level.gru.num_layers) for level in cascade.levels} == {(300, 4)}
    assert [layer.out_features for layer in cascade.levels[-1].head[::2]] == [150, 126]


def test_discriminator_and_pose_encoder_shapes():
    discriminator = Discriminator(126, 34)
    assert discriminator(torch.randn(3, 34, 126)).shape == (3,)
    assert (discriminator.frame.in_features, discriminator.window.in_features) == (64, 28)
    assert PoseEncoder(126)(torch.randn(3, 34, 126)).shape == (3, 32)
