"""The recurrent baseline of thesis section 4.5: an LSTM each for face, body and hands on the same 28 speech features.

Adopted, as the thesis says, from Shlizerman et al. 2018 ("Audio to Body Dynamics"), whose sizes are the defaults here
because the thesis prints none: one layer of 200 units, dropout 0.1, a delay of 0.2 s, mean squared error, Adam 1e-3.
"""

from dataclasses import asdict, dataclass

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.gestures.chapter4.pairs import MotionNetwork, Pairs
from cospeech.learning.settings import COUNT, DROPOUT, NATURAL, POSITIVE, UNPUBLISHED, WEIGHT, Section, key
from cospeech.learning.training import autocast, descend, device
from cospeech.learning.unet1d import WINDOW


@dataclass(frozen=True)
class Settings(Section, section="lstm"):
    """Of one training."""

    steps: int = key(300_000, "iterations", limits=COUNT)
    batch: int = key(100, "windows in each iteration", limits=COUNT)
    frames: int = key(64, "length of a window", "frames", WINDOW)
    learning_rate: float = key(1e-3, "of Adam", limits=POSITIVE)
    hidden: int = key(200, "units of each LSTM", limits=COUNT)
    layers: int = key(1, "of each LSTM", limits=COUNT)
    dropout: float = key(0.1, "share of units that are dropped before the last layer", limits=DROPOUT)
    delay: int = key(3, "speech that is heard before a frame of motion is answered, 0.2 s", "frames", NATURAL)
    feature_noise: float = key(
        0.0, "deviation of noise on the z-scored speech features in training", limits=WEIGHT, published=UNPUBLISHED
    )


class RecurrentNetwork(MotionNetwork):
    """Speech features (B, 28, T) -> [face (B, E, T),] body (B, 42, T), hands (B, 126, T) in metres and radians."""

    def __init__(self, pairs, settings):
        super().__init__(pairs)
        features = pairs.channels["features"]
        self.delay = settings.delay
        self.memories = nn.ModuleDict(
            {part: nn.LSTM(features, settings.hidden, settings.layers, batch_first=True) for part in self.parts}
        )
        self.dropout = nn.Dropout(settings.dropout)
        self.heads = nn.ModuleDict({part: nn.Linear(settings.hidden, pairs.channels[part]) for part in self.parts})

    def forward(self, features):
        features = self.standardized("features", features).transpose(1, 2)
        features = torch.cat([features, features[:, -1:].expand(-1, self.delay, -1)], dim=1)
        return tuple(self.measured(part, self._answer(part, features)) for part in self.parts)

    def _answer(self, part, features):
        remembered, _ = self.memories[part](features)
        return self.heads[part](self.dropout(remembered[:, self.delay :])).transpose(1, 2)


class LSTMTask:
    """Training of the three LSTMs together, for `learning.training.train`; they share nothing but the batches."""

    def __init__(self, clips, settings, seed):
        torch.manual_seed(seed)
        self.settings = settings
        self.pairs = Pairs(clips, settings.frames)
        self.generator = RecurrentNetwork(self.pairs, settings).to(device())
        self.modules = {"generator": self.generator}
        self.optimizers = {"generator": torch.optim.Adam(self.generator.parameters(), settings.learning_rate)}
        self.description = {
            "model": "lstm",
            "settings": asdict(settings),
            "channels": self.pairs.channels,
            "fps": self.pairs.fps,
            **self.pairs.build.lists(),
            "face_model": self.pairs.face_model,
            "multiple": 1,
            "halo": None,
        }

    def iterate(self, step, rng):
        real = self.pairs.sample(rng, self.settings.batch)
        noise = self.settings.feature_noise * self.generator.features_deviation
        with autocast():
            predicted = self.generator(real["features"] + noise * torch.randn_like(real["features"]))
        standardized = self.generator.standardized
        losses = {
            part: F.mse_loss(standardized(part, found.float()), standardized(part, real[part]))
            for part, found in zip(self.generator.parts, predicted, strict=True)
        }
        descend(self, "generator", sum(losses.values()))
        return {part: loss.detach() for part, loss in losses.items()}

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (B, C, T)}, output names)."""
        example = {"features": torch.zeros(2, self.pairs.channels["features"], self.settings.frames)}
        return self.generator.cpu().eval(), example, self.generator.parts
