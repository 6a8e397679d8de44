"""HA2G's identity encoder: a ResNet-18 looks at reference frames and says how their speaker is expected to move.

As published (Liu et al. 2022, 3.3 and supplement): without global average pooling, without classifier, from scratch.
Where it is silent: one linear layer each makes the mean and the log variance of a style vector from a picture's map,
and a speaker's are the means over their pictures.
"""

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.errors import CospeechError, notice
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import scaled
from cospeech.learning.weights import load_torchvision

CHANNELS = (64, 128, 256, 512)  # of ResNet-18's four stages, of two blocks each (He et al. 2016, Table 1)
STRIDE = 32  # pixels of a picture per element of the last stage's map, along one side
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet's RGB, for which weights are trained


class Block(nn.Module):
    """ResNet's basic block, (N, C, h, w) -> (N, channels, h / stride, w / stride); torchvision's parameter names."""

    def __init__(self, channels_in, channels, stride):
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, channels, 3, stride, 1, bias=False)
        self.conv2 = nn.Conv2d(channels, channels, 3, 1, 1, bias=False)
        self.bn1, self.bn2 = nn.BatchNorm2d(channels), nn.BatchNorm2d(channels)
        self.downsample = None
        if stride > 1 or channels_in != channels:
            skip = nn.Conv2d(channels_in, channels, 1, stride, bias=False)
            self.downsample = nn.Sequential(skip, nn.BatchNorm2d(channels))

    def forward(self, x):
        skip = x if self.downsample is None else self.downsample(x)
        return F.relu(self.bn2(self.conv2(F.relu(self.bn1(self.conv1(x))))) + skip)


class ResNet18(nn.Module):
    """Pictures (N, 3, side, side), RGB from 0 to 255 -> maps (N, 512, side / 32, side / 32). width : of channels."""

    def __init__(self, width=1.0):
        super().__init__()
        channels = [scaled(c, width) for c in CHANNELS]
        self.conv1, self.bn1 = nn.Conv2d(3, channels[0], 7, 2, 3, bias=False), nn.BatchNorm2d(channels[0])
        for i, c in enumerate(channels):
            first = Block(channels[max(i - 1, 0)], c, 2 if i else 1)
            self.add_module(f"layer{i + 1}", nn.Sequential(first, Block(c, c, 1)))
        self.register_buffer("offset", 255 * torch.tensor(MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("range", 255 * torch.tensor(STD).view(3, 1, 1), persistent=False)

    def forward(self, pictures):
        x = F.relu(self.bn1(self.conv1((pictures - self.offset) / self.range)))
        x = F.max_pool2d(x, 3, 2, 1)
        for i in range(len(CHANNELS)):
            x = getattr(self, f"layer{i + 1}")(x)
        return x


class IdentityEncoder(nn.Module):
    """Pictures (N, 3, side, side), RGB from 0 to 255 -> mean and log variance of a style vector, (N, size) each."""

    def __init__(self, side, size, width=1.0):
        super().__init__()
        if side < 2 * STRIDE or side % STRIDE:
            raise CospeechError(f"reference frames of {side} pixels; their side must be 64, 96, 128...")
        self.side, self.backbone = side, ResNet18(width)
        numbers = scaled(CHANNELS[-1], width) * (side // STRIDE) ** 2
        self.mean, self.log_variance = nn.Linear(numbers, size), nn.Linear(numbers, size)

    def forward(self, pictures):
        x = self.backbone(pictures).flatten(1)
        x = x / x.shape[1] ** 0.5  # Adam moves every weight alike, so a large map would throw styles about
        return self.mean(x), self.log_variance(x)


def load_imagenet(encoder, path):
    """Put ImageNet weights of ResNet-18 in torchvision's layout (.safetensors, or .pth) into an `IdentityEncoder`.

    Nothing else than tensors is read from a .pth; `fc` is not used. Without a path a notice says that training starts
    from scratch. Raises CospeechError when the file is unreadable or of another network.
    """
    if not path:
        notice("identity encoder: no ImageNet weights were named, it is trained from scratch, as published")
        return
    load_torchvision(encoder.backbone, path, "resnet18", "resnet18 of ha2g.width 1 only")


def export_identity(weights, path):
    """Write the identity encoder of a trained HA2G as ONNX, for speakers that it has not learned from.

    weights : its weights.safetensors. The network takes `pictures` (N, 3, side, side), RGB from 0 to 255, and returns
    each picture's `mean` and `log_variance`, (N, size).
    """
    from cospeech.learning.weights import export_onnx, load_weights

    arrays, about = load_weights(weights)
    if "picture" not in about:
        raise CospeechError(f"{weights}: knows its speakers by name alone; train it with ensemble.identity: frames")
    encoder = IdentityEncoder(about["picture"], about["settings"]["style"], about["settings"]["width"])
    prefix = "style.encoder."
    state = encoder.state_dict()
    encoder.load_state_dict({k: torch.from_numpy(arrays[prefix + k]).reshape(v.shape) for k, v in state.items()})
    example = 255 * torch.rand(2, 3, encoder.side, encoder.side, generator=torch.Generator().manual_seed(0))
    description = {"model": "identity", "picture": encoder.side, "multiple": 1, "halo": None}
    export_onnx(encoder, path, {"pictures": example}, ["mean", "log_variance"], description, sequences=False)
