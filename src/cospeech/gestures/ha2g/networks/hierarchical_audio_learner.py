"""Encoders of speech: 34 frames of features from a log-mel spectrogram (HA2G) or from the wave (Trimodal)."""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional as F

LEVELS = ("low", "mid", "high")
FILTERS = (32, 64, 128, 256)  # channels of ResNetSE34's four stages
MULTIPLES = (1, 1, 4, 16)  # of them, so that the taps can unfold the last two by 2 x 2 and 4 x 4
REDUCTION = 8  # of its squeeze-and-excitation
FEATURES = 32  # per frame, of every encoder of speech or words


def scaled(channels, width, multiple=1):
    """A number of channels times `width`, to the nearest multiple, never none."""
    return multiple * max(1, round(channels * width / multiple))


class SqueezeExcitation(nn.Module):
    """Scales every channel by what all of the map says: (N, C, H, W) -> the same."""

    def __init__(self, channels, reduction=REDUCTION):
        super().__init__()
        hidden = max(1, channels // reduction)
        self.gate = nn.Sequential(nn.Linear(channels, hidden), nn.ReLU(), nn.Linear(hidden, channels), nn.Sigmoid())

    def forward(self, x):
        return x * self.gate(x.mean((2, 3)))[:, :, None, None]


class Block(nn.Module):
    """Residual block of ResNetSE34: conv, ReLU, batch norm, conv, batch norm, squeeze-and-excitation, + input, ReLU."""

    def __init__(self, channels_in, channels, stride=1):
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(channels_in, channels, 3, stride, 1, bias=False),
            nn.ReLU(),
            nn.BatchNorm2d(channels),
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False),
            nn.BatchNorm2d(channels),
            SqueezeExcitation(channels),
        )
        self.skip = nn.Identity()
        if stride > 1 or channels_in != channels:
            self.skip = nn.Sequential(nn.Conv2d(channels_in, channels, 1, stride, bias=False), nn.BatchNorm2d(channels))

    def forward(self, x):
        return F.relu(self.body(x) + self.skip(x))


class Tap(nn.Module):
    """One stage's map -> features of every frame: pixel shuffle, convolution, ReLU, batch norm, linear (Tables 6, 7).

    shuffle : factor by which the map is unfolded; kernel : of the unpadded convolution that leaves 34 columns;
    rows : frequencies that it leaves.
    """

    def __init__(self, channels, shuffle, kernel, rows):
        super().__init__()
        channels //= shuffle**2
        self.body = nn.Sequential(
            nn.PixelShuffle(shuffle), nn.Conv2d(channels, channels, kernel), nn.ReLU(), nn.BatchNorm2d(channels)
        )
        self.linear = nn.Linear(channels * rows, FEATURES)

    def forward(self, x):
        return self.linear(self.body(x).flatten(1, 2).transpose(1, 2))


class SpectrogramEncoder(nn.Module):
    """HA2G's hierarchical audio learner, a ResNetSE34 with three taps.

    Log-mel (N, 128, 70) in dB -> low, mid and high features, (N, 3, 34, 32).

    blocks : residual blocks per stage, (3, 4, 6, 3) as published. width : factor on the number of channels.
    """

    def __init__(self, blocks=(3, 4, 6, 3), width=1.0):
        super().__init__()
        filters = [scaled(channels, width, m) for channels, m in zip(FILTERS, MULTIPLES, strict=True)]
        self.stem = nn.Sequential(nn.Conv2d(1, filters[0], 3, padding=1), nn.ReLU(), nn.BatchNorm2d(filters[0]))
        self.stages = nn.ModuleList()
        for stage, count in enumerate(blocks):
            before = filters[max(stage - 1, 0)]
            first = Block(before, filters[stage], 2 if stage else 1)
            self.stages.append(nn.Sequential(first, *(Block(filters[stage], filters[stage]) for _ in range(count - 1))))
        self.taps = nn.ModuleList([Tap(filters[1], 1, 2, 63), Tap(filters[2], 2, 3, 62), Tap(filters[3], 4, 3, 62)])

    def forward(self, mel):
        x = self.stages[0](self.stem(mel[:, None] / 40 + 1))  # the 80 dB of a spectrogram, from -1 to 1
        features = []
        for stage, tap in zip(self.stages[1:], self.taps, strict=True):
            x = stage(x)
            features.append(tap(x))
        return torch.stack(features, 1)


class WaveEncoder(nn.Module):
    """Trimodal's four strided convolutions: wave (N, 36267) at 16 kHz -> (N, 34, 32)."""

    def __init__(self, width=1.0):
        super().__init__()
        channels = (1, *(scaled(c, width) for c in (16, 32, 64)), FEATURES)
        layers = []
        for layer, (a, b) in enumerate(pairwise(channels)):
            first = layer == 0
            layers += [nn.Conv1d(a, b, 15, 5 if first else 6, 1600 if first else 0)]
            layers += [nn.BatchNorm1d(b), nn.LeakyReLU(0.3)]
        self.body = nn.Sequential(*layers[:-2])  # the last convolution stands alone

    def forward(self, wave):
        return self.body(wave[:, None]).transpose(1, 2)
