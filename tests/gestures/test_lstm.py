"""The recurrent baseline and the velocity adversary: what they hear, what they judge, and that they learn."""

import numpy as np
import pytest
import torch

from cospeech import synthesis
from cospeech.errors import CospeechError
from cospeech.gestures.chapter4.gesture_gan import GestureTask
from cospeech.gestures.chapter4.gesture_gan import Settings as GestureSettings
from cospeech.gestures.chapter4.inference import GestureGenerator
from cospeech.gestures.chapter4.lstm import LSTMTask, Settings
from cospeech.gestures.chapter4.models import gesture_task
from cospeech.gestures.chapter4.vectors import motion_to_vectors
from cospeech.gestures.generator import Recordings
from cospeech.learning.settings import settings_of
from cospeech.learning.training import train
from tests.conftest import make_clip

SMALL = {"batch": 8, "hidden": 48, "learning_rate": 1e-2}


@pytest.fixture(scope="module")
def trained(tmp_path_factory, toy_clips):
    folder = tmp_path_factory.mktemp("lstm")
    synthesis.train("lstm", Recordings(toy_clips), SMALL | {"steps": 40}, seed=1, folder=folder, threads=1)
    return folder


def test_three_separate_memories_that_hear_the_delay_ahead(toy_clips):
    task = LSTMTask(toy_clips, settings_of(Settings(), SMALL | {"delay": 3}, "lstm"), seed=0)
    network = task.generator.eval()
    assert set(network.memories) == {"face", "body", "hands"}
    features = torch.from_numpy(toy_clips[0].features.T[None, :, :64].copy())
    changed = features.clone()
    changed[..., 40] += 5
    with torch.inference_mode():
        before, after = network(features), network(changed)
    for a, b in zip(before, after, strict=True):
        heard = np.flatnonzero((a - b).abs().amax((0, 1)).numpy() > 1e-7)
        assert heard.min() == 40 - 3 and heard.max() == 63


def test_learns_and_beats_the_mean_pose_on_an_unseen_take():
    clip, unseen = make_clip(0, 512), make_clip(9)
    task = LSTMTask([clip], settings_of(Settings(), SMALL, "lstm"), seed=0)
    history = train(task, 250, seed=0)
    assert all(curve[-1] < 0.4 * curve[0] for curve in history.losses.values())
    network, _, parts = task.export()
    with torch.inference_mode():
        outputs = network(torch.from_numpy(unseen.features.T[None].copy()))
    body = outputs[parts.index("body")][0].T.numpy()
    truth, mean = motion_to_vectors(unseen.motion)["body"], motion_to_vectors(clip.motion)["body"].mean(0)
    assert np.abs(body - truth).mean() < 0.8 * np.abs(mean - truth).mean()


@pytest.mark.parametrize("frames", [1, 65, 5003])
def test_any_length_through_onnx(trained, frames):
    motion = GestureGenerator(trained / "model.onnx").generate(make_clip(5, frames).features)
    assert motion.positions.shape == (frames, 55, 3) and np.isfinite(motion.positions).all()


def test_ten_minutes_forget_where_they_began(trained):
    """A run that starts later remembers less, and after some seconds makes the same motion."""
    generator, features = GestureGenerator(trained / "model.onnx"), make_clip(5, 9000).features
    whole, later = (generator.generate(f).positions for f in (features, features[37:]))
    assert np.abs(whole[37] - later[0]).max() > 1e-3
    np.testing.assert_allclose(whole[37 + 300 :], later[300:], atol=1e-4)


def test_velocity_adversary_sees_changes_alone(toy_clips):
    settings = settings_of(GestureSettings(adversary="velocity"), {"batch": 4, "width": 0.1}, "velocity_gan")
    task = GestureTask(toy_clips, settings, seed=0, model="velocity_gan")
    batch = task.pairs.sample(np.random.default_rng(0), 4)
    shifted = batch | {"body": batch["body"] + 0.3, "hands": batch["hands"] - 0.1}
    seen, same = (task._discriminator_inputs(motion["features"], motion) for motion in (batch, shifted))
    assert seen.shape == (4, 42 + 126, 64)
    torch.testing.assert_close(seen, same, atol=1e-4, rtol=0)
    bodies = [motion_to_vectors(clip.motion)["body"] for clip in toy_clips]
    deviation = np.concatenate([np.diff(body, axis=0) for body in bodies]).std(axis=0)
    moving = deviation > 1e-6
    expected = np.diff(batch["body"].numpy(), axis=2)[:, moving] / deviation[moving, None]
    np.testing.assert_allclose(seen[:, :42, 1:].numpy()[:, moving], expected, atol=1e-3, rtol=1e-3)
    assert 0.7 < seen[:, :42, 1:].numpy()[:, moving].std() < 1.3 and (seen[:, :, 0] == 0).all()


@pytest.mark.parametrize(("adversary", "channels"), [("pose", 168), ("audio_pose", 196), ("none", None)])
def test_every_adversary_trains(toy_clips, adversary, channels):
    task = gesture_task("gesture_gan", toy_clips, {"batch": 4, "width": 0.1, "adversary": adversary}, seed=0)
    losses = task.iterate(0, np.random.default_rng(0))
    assert ("discriminator" in losses) == ("adversarial" in losses) == (channels is not None)
    if channels:
        assert task.modules["discriminator"].body[0][0].in_channels == channels


def test_unknown_adversary_is_named(toy_clips):
    with pytest.raises(CospeechError, match=r"gesture_gan.adversary is 'face'; known: none, audio_pose"):
        gesture_task("gesture_gan", toy_clips, {"adversary": "face"}, seed=0)
