"""A trained pose network as one ONNX file, and a manifest that says how to use it without this package.

Anything that can read the manifest can run the network: this package's own `PosePredictor`, the capture stage's ONNX
tracker, or another program.
"""

from pathlib import Path

import torch
import yaml
from torch import nn

from cospeech.files import sha256, writing
from cospeech.learning.weights import export_onnx, load_weights
from cospeech.posenet.camera import DEFAULT_MARGIN
from cospeech.posenet.network import Design, PoseNet

SCHEMA = "cospeech.posenet"
INPUT, OUTPUTS = "images", ("pose", "points", "heatmaps")


class Exported(nn.Module):
    """images (B, 3, S, S) -> pose (B, J, 3) in millimetres, points (B, J, 2), heatmaps (B, K, h, w)."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, images):
        output = self.network(images)
        return 1000.0 * self.network.design.unit * output.pose, output.points, output.heatmaps


def load_network(weights):
    """The PoseNet of a weights.safetensors, in eval mode, and its description."""
    arrays, description = load_weights(weights)
    design = Design(**{k: tuple(v) if isinstance(v, list) else v for k, v in description["design"].items()})
    network = PoseNet(design)
    network.load_state_dict({name: torch.from_numpy(array) for name, array in arrays.items()})
    return network.eval(), description


def export_posenet(weights, onnx, manifest):
    """Write the ONNX file of a weights.safetensors and its manifest; CospeechError when onnxruntime computes something
    else than torch."""
    network, description = load_network(weights)
    design = network.design
    example = torch.rand(2, 3, design.input, design.input, generator=torch.Generator().manual_seed(0))
    export_onnx(Exported(network), onnx, {INPUT: example}, OUTPUTS, description, sequences=False)
    with writing(manifest) as temporary:
        text = yaml.safe_dump(manifest_of(design, description, onnx), sort_keys=False, width=118)
        temporary.write_text(text, encoding="utf-8")


def manifest_of(design, description, onnx):
    """{key: value} of the manifest of an ONNX file."""
    return {
        "schema": SCHEMA,
        "schema_version": 1,
        "model": Path(onnx).name,
        "sha256": sha256(onnx),
        "licence_note": description["licence_note"],
        "part": description["part"],
        "input": {
            "name": INPUT,
            "layout": "NCHW",
            "size": [design.input, design.input],
            "channels": "RGB",
            "range": [0.0, 1.0],
            "normalization": "inside the network: none is needed before it",
            "crop": {"shape": "square around the box of the 2D joints", "margin": DEFAULT_MARGIN, "outside": "black"},
        },
        "codec": "direct",
        "outputs": {
            "pose": "(N, J, 3) millimetres from the root joint; x right, y down, z away, in the crop's virtual camera",
            "points": "(N, J, 2) x and y in the crop, -1 to 1 between the outer edges of its pixels",
            "heatmaps": "(N, K, h, w); the maximum of a joint's map is its confidence",
        },
        "skeleton": {
            "joints": list(design.joints),
            "parents": list(design.parents),
            "root": design.root,
            "heatmap_joints": list(design.heatmaps),
        },
    }
