"""Shared fixtures: the real recordings, and small synthetic clips."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from cospeech.clip import Clip
from cospeech.skeleton import UPPER55, from_parent_relative


@pytest.fixture(scope="session")
def recordings():
    """Folder of real recordings, named by COSPEECH_RECORDINGS; tests that need it skip without."""
    folder = os.environ.get("COSPEECH_RECORDINGS")
    if not folder:
        pytest.skip("COSPEECH_RECORDINGS is not set: no real recordings to test with")
    return Path(folder)


def make_clip(seed=0, frames=256, subject="toy", clip=None, face=4):
    """A clip whose bones turn with its speech features: learnable, smooth, with constant bone lengths."""
    rng = np.random.default_rng(seed)
    features = gaussian_filter1d(rng.normal(size=(frames, 28)), 2, axis=0).astype(np.float32) * 3
    shape = np.random.default_rng(1)  # the same speaker whatever the seed
    offsets = shape.normal(size=(len(UPPER55), 3)) * 0.1
    offsets[UPPER55.joints("right_hand_root", "left_hand_root", "pelvis")] = 0
    mixing = shape.normal(size=(28, len(UPPER55), 3)) * 0.1
    turned = offsets + np.einsum("tc,cjx->tjx", features, mixing) * np.linalg.norm(offsets, axis=1)[:, None]
    lengths = np.linalg.norm(offsets, axis=1)[:, None]
    turned *= np.divide(lengths, np.linalg.norm(turned, axis=2, keepdims=True), where=lengths > 0, out=0 * turned)
    return Clip(
        subject,
        clip or f"take{seed:02d}",
        15.0,
        from_parent_relative(turned).astype(np.float32),
        features,
        rotation=(features[:, :3] * 0.1),
        expression=np.tanh(features[:, :face]),
        face_model="toy",
    )


@pytest.fixture(scope="session")
def toy_clips():
    """Three short synthetic clips of one speaker."""
    return [make_clip(seed) for seed in range(3)]
