"""Exported networks without training: one with random weights, and two that answer the same pose for any image."""

import dataclasses

import numpy as np
import pytest
import torch

from cospeech.learning.weights import save_weights
from cospeech.posenet.network import DESIGNS, PoseNet
from cospeech.posenet.onnx_export import export_posenet

SIZE = 32
POSE = np.zeros((21, 3))  # of the constant networks, in their unit
POSE[0] = [0, 0, 1]
POSE[1] = [0.5, 0.25, 0]


def export(folder, part="body", constant=False):
    """Save a small network and export it; constant ones answer POSE and the camera (1, 1, 0, 0)."""
    torch.manual_seed(0)
    sizes = {"input": SIZE, "blocks": (1, 1, 1), "width": 16, "latent": 16, "camera": 8}
    network = PoseNet(dataclasses.replace(DESIGNS[part], **sizes))
    with torch.no_grad():
        for layer, values in ((network.lift.out, POSE.ravel()), (network.camera[2], [1, 1, 0, 0])):
            if constant:
                layer.weight.zero_()
                layer.bias.copy_(torch.as_tensor(values, dtype=torch.float32))
    description = {"model": "posenet", "part": part, "design": dataclasses.asdict(network.design)}
    description |= {"mean_pose": np.zeros((21, 3)).tolist(), "licence_note": "for tests alone"}
    save_weights(folder / "weights.safetensors", network.state_dict(), description)
    export_posenet(folder / "weights.safetensors", folder / "model.onnx", folder / "manifest.yaml")
    return folder / "model.onnx"


@pytest.fixture(scope="session")
def random_model(tmp_path_factory):
    return export(tmp_path_factory.mktemp("random"))


@pytest.fixture(scope="session")
def constant_model(tmp_path_factory):
    return export(tmp_path_factory.mktemp("constant"), constant=True)


@pytest.fixture(scope="session")
def constant_hand(tmp_path_factory):
    return export(tmp_path_factory.mktemp("hand"), "hand", constant=True)
