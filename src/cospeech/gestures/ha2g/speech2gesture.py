"""Speech2Gesture (Ginosar et al. 2019): log-mel through a 2-D encoder and a 1-D U-Net, judged in patches.

Published for one speaker without seed poses; as in HA2G's comparison all methods get the same, the four seed poses join
the speech in front of the U-Net, as 16 features.
"""

from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.gestures.ha2g.dataset.corpus import FRAMES, SEED_FRAMES
from cospeech.gestures.ha2g.losses import least_squares_discriminator_loss, least_squares_generator_loss
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import scaled
from cospeech.gestures.ha2g.task import AdversarialTask
from cospeech.learning.settings import BETAS, COUNT, NATURAL, POSITIVE, SHARE, UNPUBLISHED, WEIGHT, Section, key

SLOPE = 0.2
SEED_FEATURES = 16
HALVINGS = 5


@dataclass(frozen=True)
class Settings(Section, section="speech2gesture"):
    """Of one training; 300 x 300 iterations, sizes and rates as published.

    The weights are those of the port to bone vectors that Trimodal and HA2G compare with; published are 1 and 1, for
    poses in units of their deviation.
    """

    epochs: float = key(300.0, "passes over the windows, unless steps are given", limits=POSITIVE)
    steps: int = key(90_000, "iterations, if not 0: 300 epochs of 300", limits=NATURAL)
    batch: int = key(32, "windows of 34 frames in each iteration", limits=COUNT)
    learning_rate: float = key(1e-4, "of Adam", limits=POSITIVE)
    discriminator_rate: float = key(1.0, "the discriminator's learning rate over the generator's", limits=POSITIVE)
    betas: tuple = key((0.9, 0.999), "of both Adams", limits=BETAS)
    warm_up: float = key(0.0, "share of the training before the discriminator joins", limits=SHARE)
    r1: float = key(
        0.0, "weight of the discriminator's squared gradient at real poses", limits=WEIGHT, published=UNPUBLISHED
    )
    mixed: bool = key(
        False, "give the discriminator real and generated poses in one batch, not apart", published=UNPUBLISHED
    )
    width: float = key(1.0, "factor on all channels", limits=POSITIVE)
    weights: dict = key(
        {"distance": 100.0, "adversarial": 10.0},
        "of the loss terms; published 1 and 1, for poses in units of their deviation",
        limits=WEIGHT,
        parts={"distance": "L1 distance", "adversarial": "what the discriminator says"},
    )


def convolution(dimensions, channels_in, channels, kernel=3, stride=1, padding=1):
    """Convolution, batch norm, LeakyReLU in 1 or 2 dimensions."""
    conv, norm = ((nn.Conv1d, nn.BatchNorm1d), (nn.Conv2d, nn.BatchNorm2d))[dimensions - 1]
    return nn.Sequential(conv(channels_in, channels, kernel, stride, padding), norm(channels), nn.LeakyReLU(SLOPE))


class SpectrogramEncoder(nn.Module):
    """Log-mel (N, 418, 64) -> (N, C, 34): three halvings, the frequencies joined at last, stretched to the frames."""

    def __init__(self, width):
        super().__init__()
        layers, before = [], 1
        for channels in (64, 128, 256):
            channels = scaled(channels, width)
            layers += [convolution(2, before, channels), convolution(2, channels, channels, 4, 2)]
            before = channels
        layers += [convolution(2, before, before), convolution(2, before, before, (3, 8), padding=0)]
        self.body = nn.Sequential(*layers)

    def forward(self, mel):
        return F.interpolate(self.body(mel[:, None]).squeeze(3), size=FRAMES, mode="linear")


class UNet(nn.Module):
    """Two convolutions, five halvings and five doublings with additive skips: (N, C, T) -> (N, channels, T)."""

    def __init__(self, channels_in, channels):
        super().__init__()
        self.first = nn.Sequential(convolution(1, channels_in, channels), convolution(1, channels, channels))
        self.down = nn.ModuleList(convolution(1, channels, channels, 4, 2) for _ in range(HALVINGS))
        self.up = nn.ModuleList(convolution(1, channels, channels) for _ in range(HALVINGS))

    def forward(self, x):
        maps = [self.first(x)]
        for layer in self.down:
            maps.append(layer(maps[-1]))
        x = maps.pop()
        for layer in self.up:
            skip = maps.pop()
            x = layer(F.interpolate(x, size=skip.shape[2], mode="nearest") + skip)
        return x


class Speech2Gesture(nn.Module):
    """Log-mel and four seed poses -> poses (N, 34, 3V)."""

    inputs = ("s2g_mel", "seed")

    def __init__(self, corpus, settings):
        super().__init__()
        channels, hidden = 3 * corpus.levels.vectors, scaled(256, settings.width)
        self.audio = SpectrogramEncoder(settings.width)
        self.start = nn.Sequential(
            nn.Flatten(),
            nn.Linear(SEED_FRAMES * channels, 32),
            nn.BatchNorm1d(32),
            nn.ReLU(),
            nn.Linear(32, SEED_FEATURES),
        )
        self.body = nn.Sequential(
            UNet(hidden + SEED_FEATURES, hidden),
            *(convolution(1, hidden, hidden) for _ in range(4)),
            nn.Conv1d(hidden, channels, 1),
        )

    def forward(self, s2g_mel, seed):
        """s2g_mel (N, 418, 64), seed (N, 4, 3V)."""
        start = self.start(seed)[:, :, None].expand(-1, -1, FRAMES)
        return self.body(torch.cat([self.audio(s2g_mel), start], dim=1)).transpose(1, 2)


class PatchDiscriminator(nn.Module):
    """Poses (N, T, C) -> scores (N, patches) of how they change from frame to frame."""

    def __init__(self, channels, width):
        super().__init__()
        a, b, c = (scaled(n, width) for n in (64, 128, 256))
        self.body = nn.Sequential(
            nn.Conv1d(channels, a, 4, 2, 1),
            nn.LeakyReLU(SLOPE),
            convolution(1, a, b, 4, 2),
            convolution(1, b, c, 4),
            nn.Conv1d(c, 1, 4, padding=1),
        )

    def forward(self, poses):
        return self.body(poses.diff(dim=1).transpose(1, 2)).squeeze(1)


class Speech2GestureTask(AdversarialTask):
    """Training of Speech2Gesture, for `cospeech.learning.training.train`."""

    model, defaults = "speech2gesture", Settings()
    conditions = ("s2g_mel",)
    discriminator_loss, generator_loss = (
        staticmethod(least_squares_discriminator_loss),
        staticmethod(least_squares_generator_loss),
    )

    def __init__(self, corpus, settings, seed):
        super().__init__(corpus, settings, seed)
        s = self.settings
        self.generator = self.add("generator", Speech2Gesture(corpus, s), s.learning_rate, s.betas)
        if s.weights["adversarial"]:
            discriminator = PatchDiscriminator(self.channels, s.width)
            self.add("discriminator", discriminator, s.discriminator_rate * s.learning_rate, s.betas)

    def reconstruct(self, batch):
        poses = self.generator(batch["s2g_mel"], batch["seed"])
        return poses, {"distance": F.l1_loss(poses, batch["poses"])}
