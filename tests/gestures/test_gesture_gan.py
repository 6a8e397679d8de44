"""Chapter 4's network: shapes, exact losses, learning, any length, and the files that come out."""

import math

import numpy as np
import pytest
import torch

from cospeech import synthesis
from cospeech.clip import Motion
from cospeech.errors import CospeechError
from cospeech.gestures.chapter4.gesture_gan import GestureTask, Settings, reconstruction_losses
from cospeech.gestures.chapter4.inference import GestureGenerator
from cospeech.gestures.chapter4.vectors import motion_to_vectors, vectors_to_motion
from cospeech.gestures.generator import Recordings
from cospeech.learning.settings import settings_of
from cospeech.learning.training import train
from cospeech.learning.unet1d import HALO, PRESETS, Critic, Decoder, Encoder
from cospeech.learning.weights import load_weights
from cospeech.skeleton import UPPER55
from tests.conftest import make_clip

SMALL = {"steps": 120, "batch": 8, "width": 0.1, "learning_rate": 3e-3}


@pytest.fixture(scope="module")
def trained(tmp_path_factory, toy_clips):
    folder = tmp_path_factory.mktemp("gesture_gan")
    synthesis.train(
        "gesture_gan", Recordings(toy_clips), SMALL, seed=1, folder=folder, checkpoint=folder / "check.pt", threads=1
    )
    return folder


def test_published_shapes():
    widths = PRESETS["resync"]
    encoder, decoder = Encoder(28, widths.encoder), Decoder(126, widths.encoder, widths.decoder)
    maps = encoder(torch.zeros(2, 28, 64))
    assert [tuple(m.shape) for m in maps] == [(2, 128, 64), (2, 256, 32), (2, 256, 16), (2, 512, 8)]
    assert decoder(maps).shape == (2, 126, 64)
    convolutions = [m for m in encoder.modules() if isinstance(m, torch.nn.Conv1d)]
    assert len(convolutions) == 8 and {c.kernel_size for c in convolutions} == {(3,)}
    assert len([m for m in decoder.modules() if isinstance(m, torch.nn.Conv1d)]) == 7 + 1
    critic = Critic(196, widths.critic, 64)
    assert critic(torch.zeros(2, 196, 64)).shape == (2,)
    assert len([m for m in critic.modules() if isinstance(m, torch.nn.Conv1d)]) == 6


def test_losses_on_hand_computed_numbers():
    real = {"face": torch.zeros(1, 2, 2), "body": torch.zeros(1, 2, 2), "hands": torch.zeros(1, 1, 2)}
    predicted = {
        "face": torch.tensor([[[3.0, 0.0], [4.0, 1.0]]]),  # frames (3, 4) and (0, 1): norms 5 and 1
        "body": torch.tensor([[[1.0, -1.0], [2.0, 0.0]]]),
        "hands": torch.tensor([[[0.5, -1.5]]]),
    }
    losses = reconstruction_losses(predicted, real)
    assert {name: loss.item() for name, loss in losses.items()} == {"face": 3.0, "body": 1.0, "hands": 1.0}


def test_adversarial_terms_are_the_log_gan(toy_clips):
    task = GestureTask(toy_clips, settings_of(Settings(), SMALL, "gesture_gan"), seed=0)
    with torch.no_grad():
        for parameter in task.modules["discriminator"].score.parameters():
            parameter.zero_()  # so that D = 1/2 everywhere
    losses = task.iterate(0, np.random.default_rng(0))
    assert losses["discriminator"].item() == pytest.approx(2 * math.log(2), abs=1e-5)


def test_face_does_not_reach_the_discriminator(toy_clips):
    task = GestureTask(toy_clips, settings_of(Settings(), SMALL, "gesture_gan"), seed=0)
    channels = task.modules["discriminator"].body[0][0].in_channels
    assert channels == 28 + 42 + 126


def test_vectors_round_trip_and_hands_are_relative_to_their_wrists(toy_clips):
    motion = toy_clips[0].motion
    vectors = motion_to_vectors(motion)
    assert {name: v.shape[1] for name, v in vectors.items()} == {"body": 42, "hands": 126, "face": 4}
    np.testing.assert_allclose(vectors["hands"][:, :3], 0, atol=1e-6)  # the hand root is the wrist
    moved = Motion(motion.positions + np.float32([0.5, 0, 0]), motion.rotation, motion.expression)
    np.testing.assert_allclose(motion_to_vectors(moved)["hands"], vectors["hands"], atol=1e-6)
    back = vectors_to_motion(vectors, "toy")
    np.testing.assert_allclose(back.positions, motion.positions, atol=1e-6)
    np.testing.assert_array_equal(back.rotation, motion.rotation)
    vectors["body"][:, 30:33] += 0.2  # the pelvis of an undertrained network
    again = vectors_to_motion(vectors, "toy").positions
    np.testing.assert_array_equal(again[:, UPPER55.root], 0)
    np.testing.assert_array_equal(again, back.positions)


def trained_regression(clip, steps):
    settings = settings_of(Settings(adversary="none"), SMALL | {"steps": steps}, "regression")
    task = GestureTask([clip], settings, seed=0)
    return task, train(task, steps, seed=0)


def test_overfits_a_handful_of_windows():
    _, history = trained_regression(make_clip(0, 72), 200)
    for term in ("face", "body", "hands"):
        assert history.losses[term][-1] < 0.25 * history.losses[term][0], term


def test_regression_beats_the_mean_pose_on_an_unseen_take():
    clip, unseen = make_clip(0, 1024), make_clip(9)  # with half of it, one seed in two fails
    task, _ = trained_regression(clip, 250)
    network, _, parts = task.export()
    with torch.inference_mode():
        outputs = network(torch.from_numpy(unseen.features.T[None].copy()))
    body = outputs[parts.index("body")][0].T.numpy()
    truth, mean = motion_to_vectors(unseen.motion)["body"], motion_to_vectors(clip.motion)["body"].mean(0)
    assert np.abs(body - truth).mean() < 0.8 * np.abs(mean - truth).mean()


@pytest.mark.parametrize("frames", [1, 7, 64, 65, 1003])
def test_any_length(trained, frames):
    motion = GestureGenerator(trained / "model.onnx").generate(make_clip(5, frames).features)
    assert motion.positions.shape == (frames, 55, 3) and motion.expression.shape == (frames, 4)
    assert np.isfinite(motion.positions).all()


def test_chunks_leave_no_seam(trained):
    network = GestureGenerator(trained / "model.onnx").network
    features = make_clip(5, 1003).features
    whole = network.run_long(features=features)
    for chunk in (64, 256):
        pieces = network.run_long(chunk=chunk, features=features)
        for name in whole:
            np.testing.assert_allclose(pieces[name], whole[name], atol=2e-5)


def test_ten_minutes_have_no_seam(trained):
    """A run that starts 40 frames later has its chunks elsewhere, and the same motion away from the ends."""
    generator, features = GestureGenerator(trained / "model.onnx"), make_clip(5, 9000).features
    whole, later = (generator.generate(f) for f in (features, features[40:]))
    assert whole.positions.shape == (9000, 55, 3)
    for name in ("positions", "rotation", "expression"):
        a, b = getattr(whole, name)[40 + HALO :], getattr(later, name)[HALO:]
        np.testing.assert_allclose(a, b, atol=2e-5)


def test_halo_covers_what_the_network_can_see(trained):
    network = GestureGenerator(trained / "model.onnx").network
    features = make_clip(5, 512).features
    changed = features.copy()
    changed[256] += 5
    before, after = (network.run_long(features=f)["body"] for f in (features, changed))
    seen = np.flatnonzero(np.abs(after - before).max(axis=1) > 1e-6)
    assert seen.min() >= 256 - HALO and seen.max() <= 256 + HALO and len(seen) > 16


def test_weights_describe_themselves(trained):
    arrays, description = load_weights(trained / "weights.safetensors")
    assert description["model"] == "gesture_gan" and description["fps"] == 15.0 and description["face_model"] == "toy"
    assert arrays["features_mean"].shape == (28, 1)
    assert description == GestureGenerator(trained / "model.onnx").description
    assert not (trained / "check.pt").exists()


def test_onnx_names_no_path_of_this_machine(trained):
    assert b"site-packages" not in (trained / "model.onnx").read_bytes()


def test_same_seed_same_bytes(trained, tmp_path, toy_clips):
    synthesis.train("gesture_gan", Recordings(toy_clips), SMALL, seed=1, folder=tmp_path, threads=1)
    for name in ("weights.safetensors", "model.onnx", "history.h5"):
        assert (tmp_path / name).read_bytes() == (trained / name).read_bytes(), name


def test_unknown_and_mistyped_budget_keys_are_named():
    with pytest.raises(CospeechError, match=r"unknown key 'gesture_gan.step'"):
        settings_of(Settings(), {"step": 3}, "gesture_gan")
    with pytest.raises(CospeechError, match=r"gesture_gan.steps is 'many'"):
        settings_of(Settings(), {"steps": "many"}, "gesture_gan")
    assert settings_of(Settings(), {"weights": {"face": 2.0}}, "gesture_gan").weights["body"] == 600
