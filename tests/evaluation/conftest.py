"""A puppet whose forearms swing as told: motions whose beats, speeds and angles are known from their construction."""

import numpy as np
import pytest

from cospeech.clip import Clip
from cospeech.skeleton import UPPER55


def rest_pose():
    """(55, 3): upright, upper arms down, forearms forward, every bone but the hand roots' with a length."""
    pose = np.zeros((55, 3))
    body = {
        "spine": (0, 0.25, 0),
        "neck": (0, 0.5, 0),
        "head": (0, 0.62, 0.02),
        "head_top": (0, 0.75, 0),
        "left_hip": (0.1, -0.05, 0),
        "right_hip": (-0.1, -0.05, 0),
    }
    for side, sign in (("left", 1), ("right", -1)):
        body |= {f"{side}_shoulder": (0.2 * sign, 0.45, 0), f"{side}_elbow": (0.2 * sign, 0.15, 0)}
        body |= {f"{side}_{name}": (0.2 * sign, 0.15, 0.25) for name in ("wrist", "hand_root")}
        for i, finger in enumerate(("thumb", "index", "middle", "ring", "little")):
            for k in range(4):
                body[f"{side}_{finger}_{k}"] = (0.2 * sign + 0.02 * (2 - i), 0.15, 0.28 + 0.03 * k)
    for name, position in body.items():
        pose[UPPER55.index[name]] = position
    return pose


def swing(left, right=None):
    """Forearms turned down about the elbows by angles (T,) in radians, pi/2 for a straight arm: (T, 55, 3)."""
    left = np.asarray(left, float)
    positions = np.repeat(rest_pose()[None], len(left), axis=0)
    for side, angle in (("left", left), ("right", np.zeros_like(left) if right is None else np.asarray(right))):
        elbow = UPPER55.index[f"{side}_elbow"]
        moved = [UPPER55.index[f"{side}_wrist"]]
        moved += [j for j, name in enumerate(UPPER55.names) if name.startswith(side) and j >= 13]
        offset = positions[:, moved] - positions[:, [elbow]]
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        turned = np.stack(
            [offset[..., 0], c * offset[..., 1] - s * offset[..., 2], s * offset[..., 1] + c * offset[..., 2]], -1
        )
        positions[:, moved] = positions[:, [elbow]] + turned
    return positions


def speaker(seed, seconds=20, fps=15.0):
    """A random take: bursts of speech at known onsets, and strokes of the forearms that start with them.

    Returns (Clip, samples, rate). The features are the loudness of the bursts and noise.
    """
    rng, rate = np.random.default_rng(seed), 16000
    frames, onsets = round(seconds * fps), np.cumsum(rng.uniform(0.5, 1.6, size=round(2 * seconds)))
    onsets = onsets[onsets < seconds - 0.5]
    at = np.arange(frames) / fps
    size = rng.uniform(0.3, 1.0, size=(2, len(onsets)))
    stroke = lambda s: (s[:, None] * np.exp(-(((at - onsets[:, None]) / 0.2) ** 2))).sum(0)
    drift = 0.1 * np.sin(at[None] * rng.uniform(0.5, 1.0, (2, 1)) + rng.uniform(0, 6, (2, 1)))
    positions = swing(-stroke(size[0]) - drift[0], -stroke(size[1]) - drift[1])
    features = 0.1 * rng.normal(size=(frames, 28))
    features[:, 13] += stroke(np.ones(len(onsets)))
    clock = np.arange(round(seconds * rate)) / rate
    loud = sum(np.exp(-(clock - t) / 0.08) * (clock >= t) for t in onsets)
    samples = (0.3 * loud * np.sin(2 * np.pi * 300 * clock)).astype(np.float32)
    name = f"take{seed}"
    return Clip("puppet", name, fps, positions.astype(np.float32), features.astype(np.float32)), samples, rate


@pytest.fixture(scope="session", name="swing")
def swing_fixture():
    return swing


@pytest.fixture(scope="session", name="rest_pose")
def rest_pose_fixture():
    return rest_pose()


@pytest.fixture(scope="session", name="speaker")
def speaker_fixture():
    return speaker


@pytest.fixture(scope="session")
def training_part():
    """Eight takes of the puppet."""
    return [speaker(seed)[0] for seed in range(8)]


@pytest.fixture(scope="session")
def feature_net(training_part):
    """A feature network after a short training."""
    from cospeech.evaluation.metrics.fgd import Settings, train_feature_net

    return train_feature_net(training_part, Settings(steps=80, batch=32, latent=8))[0]
