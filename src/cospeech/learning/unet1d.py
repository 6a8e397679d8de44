"""Blocks of the 1-D convolutional networks of thesis chapters 4 and 5: encoder, decoder with skips, and critics.

Sequences are (B, C, T). A U-Net halves time three times, so T must be a multiple of `MULTIPLE`.
"""

from dataclasses import dataclass

import torch
from torch import nn

from cospeech.errors import CospeechError

MULTIPLE = 8  # three poolings by two
WINDOW = {"minimum": MULTIPLE, "multipleOf": MULTIPLE}  # limits of a budget's length of windows
HALO = (
    64  # frames on either side beyond which an output cannot see (receptive field 45, rounded up to the pooling grid)
)


@dataclass(frozen=True)
class Widths:
    """Channels per level of an encoder (two convolutions each), its decoder and the discriminator."""

    encoder: tuple
    decoder: tuple
    critic: tuple

    def scaled(self, factor):
        """The same shape, thinner or wider (never under 8 channels)."""
        return Widths(
            *(tuple(max(8, round(w * factor)) for w in part) for part in (self.encoder, self.decoder, self.critic))
        )


# The publications do not print their widths (IVA 2021 has them in figure S3 alone): `resync` are those of the authors'
# later refiner, `ls3dcg` a re-implementation's, `unet` those of the network that the text cites as its base.
PRESETS = {
    "resync": Widths((128, 256, 256, 512), (256, 256, 256), (512, 256, 128)),
    "ls3dcg": Widths((128, 256, 512, 1024), (512, 256, 128), (256, 512, 1024)),
    "unet": Widths((64, 128, 256, 512), (256, 128, 64), (512, 256, 128)),
}


def preset(name):
    """The `Widths` of a preset by name."""
    if name not in PRESETS:
        raise CospeechError(f"budget: unknown preset {name!r}; known: {', '.join(PRESETS)}")
    return PRESETS[name]


class ZScored(nn.Module):
    """Base of networks that work on z-scores of named channels and answer in their units.

    statistics : {name: (mean (C,), deviation (C,))} as `cospeech.learning.windows.moments` has them: a deviation of 0
    marks a channel that does not move, whose z-score is about 0 and whose answer is the mean, exactly.
    """

    def __init__(self, statistics):
        super().__init__()
        for name, (mean, deviation) in statistics.items():
            self.register_buffer(f"{name}_mean", torch.as_tensor(mean)[:, None])
            self.register_buffer(f"{name}_deviation", torch.as_tensor(deviation)[:, None])

    def standardized(self, name, x):
        """(x - mean) / deviation; x (B, C, T)."""
        deviation = getattr(self, f"{name}_deviation")
        return (x - getattr(self, f"{name}_mean")) / torch.where(deviation > 0, deviation, 1.0)

    def measured(self, name, x):
        """Inverse of `standardized`."""
        return x * getattr(self, f"{name}_deviation") + getattr(self, f"{name}_mean")


ACTIVATIONS = {"relu": nn.ReLU, "leaky": lambda: nn.LeakyReLU(0.2)}
NORMS = {"batch": nn.BatchNorm1d, "instance": lambda width: nn.InstanceNorm1d(width, affine=True)}
POOLS = {"max": nn.MaxPool1d, "average": nn.AvgPool1d}


def convolutions(width_in, width_out, count, norm, activation):
    """`count` x [Conv1d k3, norm, activation], (B, width_in, T) -> (B, width_out, T)."""
    layers = []
    for i in range(count):
        layers += [nn.Conv1d(width_in if i == 0 else width_out, width_out, 3, padding=1)]
        layers += [NORMS[norm](width_out), ACTIVATIONS[activation]()]
    return nn.Sequential(*layers)


class Encoder(nn.Module):
    """Eight convolutions in four levels, pooled between levels: (B, C, T) -> four maps, T, T/2, T/4, T/8 long."""

    def __init__(self, channels, widths, activation="relu", pool="max"):
        super().__init__()
        levels = zip((channels, *widths[:-1]), widths, strict=True)
        self.levels = nn.ModuleList(convolutions(a, b, 2, "batch", activation) for a, b in levels)
        self.pool = POOLS[pool](2)

    def forward(self, x):
        maps = [self.levels[0](x)]
        for level in self.levels[1:]:
            maps.append(level(self.pool(maps[-1])))
        return maps


class Decoder(nn.Module):
    """Upsample (nearest), join the encoder's map, two convolutions, three times; then a bare convolution.

    `convolutions_last` is 2 in the released refiner (6 convolutions and a head) and 3 in the thesis (7 and a head).
    """

    def __init__(self, channels, encoder, decoder, activation="relu", convolutions_last=3):
        super().__init__()
        below, skips = (encoder[-1], *decoder[:-1]), encoder[-2::-1]
        counts = (2, 2, convolutions_last)
        self.levels = nn.ModuleList(
            convolutions(a + s, b, n, "batch", activation)
            for a, s, b, n in zip(below, skips, decoder, counts, strict=True)
        )
        self.up = nn.Upsample(scale_factor=2, mode="nearest")
        self.head = nn.Conv1d(decoder[-1], channels, 1)

    def forward(self, maps):
        x = maps[-1]
        for level, skip in zip(self.levels, maps[-2::-1], strict=True):
            x = level(torch.cat([self.up(x), skip], dim=1))
        return self.head(x)


class Critic(nn.Module):
    """Six convolutions, pooled after every second, then one linear layer: (B, C, T) -> (B,) scores without a sigmoid.

    With batch norm, ReLU and max pooling it is chapter 4's discriminator (its sigmoid is in the loss); with instance
    norm, leaky ReLU and average pooling chapter 5's critic. The linear layer fixes the window length T.
    """

    def __init__(self, channels, widths, frames, norm="batch", activation="relu", pool="max", bias=True):
        super().__init__()
        layers = []
        for a, b in zip((channels, *widths[:-1]), widths, strict=True):
            layers += [convolutions(a, b, 2, norm, activation), POOLS[pool](2)]
        self.body = nn.Sequential(*layers)
        self.score = nn.Linear(widths[-1] * (frames // MULTIPLE), 1, bias=bias)

    def forward(self, x):
        return self.score(self.body(x).flatten(1)).squeeze(1)
