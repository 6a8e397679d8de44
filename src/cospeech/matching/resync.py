"""Chapter 5, stage 2: the conditional GAN that resynchronises a k-NN motion with its speech (thesis section 5.3.3).

A WGAN-GP: the generator turns (speech, k-NN motion) into a motion that the critic cannot tell from the speaker's own.
"""

from dataclasses import asdict, dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from cospeech.matching.knn import fake_pairs
from cospeech.skeleton import bone_lengths, to_parent_relative
from cospeech.training import autocast, descend, device
from cospeech.unet1d import HALO, MULTIPLE, Critic, Decoder, Encoder, preset
from cospeech.windows import Windows

MOTION_CHANNELS = 165
LAYERS = {"paper": {"activation": "relu", "pool": "max"}, "released": {"activation": "leaky", "pool": "average"}}


@dataclass(frozen=True)
class Settings:
    """Of one training; the defaults are the published ones (reference section 5).

    variant: `paper` (ReLU, max pooling, 8 convolutions up) or `released` (leaky ReLU, average pooling, 6 and a head).
    residual: add the network's output to the k-NN motion instead of replacing it; ours, for short trainings.
    """

    steps: int = 300_000
    batch: int = 100
    frames: int = 64
    stride: int = 5
    learning_rate: float = 1e-4
    betas: tuple = (0.0, 0.9)
    weight_decay: float = 4e-5
    preset: str = "resync"
    variant: str = "paper"
    width: float = 1.0
    critic_iterations: int = 5
    gradient_penalty: float = 100.0
    fidelity: float = 0.1
    residual: bool = False


class ResyncNetwork(nn.Module):
    """features (B, 28, T), matched (B, 165, T) parent-relative metres -> motion (B, 165, T) parent-relative metres."""

    def __init__(self, channels, settings, statistics):
        super().__init__()
        widths, layers = preset(settings.preset).scaled(settings.width), LAYERS[settings.variant]
        last = 3 if settings.variant == "paper" else 2
        self.residual = settings.residual
        self.encoder = Encoder(channels + MOTION_CHANNELS, widths.encoder, **layers)
        self.decoder = Decoder(MOTION_CHANNELS, widths.encoder, widths.decoder, layers["activation"], last)
        for name, (mean, deviation) in statistics.items():
            self.register_buffer(f"{name}_mean", torch.as_tensor(mean)[:, None])
            self.register_buffer(f"{name}_deviation", torch.as_tensor(deviation)[:, None])
        if settings.residual:
            nn.init.zeros_(self.decoder.head.weight)
            nn.init.zeros_(self.decoder.head.bias)

    def standardized(self, features, motion):
        """(B, 28 + 165, T): both z-scored by the statistics of the real training data."""
        features = (features - self.features_mean) / self.features_deviation
        return torch.cat([features, (motion - self.motion_mean) / self.motion_deviation], dim=1)

    def refine(self, x):
        """The generator on standardised input (B, 193, T) -> standardised motion (B, 165, T)."""
        out = self.decoder(self.encoder(x))
        return out + x[:, -MOTION_CHANNELS:] if self.residual else out

    def forward(self, features, matched):
        return self.refine(self.standardized(features, matched)) * self.motion_deviation + self.motion_mean


def gradient_penalty(critic, real, fake):
    """Eq. 5.2 after Gulrajani et al. 2017: E (|grad D(x)| - 1)^2 at random interpolates, one alpha per sample."""
    alpha = torch.rand(len(real), 1, 1, device=real.device)
    x = (alpha * real + (1 - alpha) * fake).requires_grad_()
    (gradient,) = torch.autograd.grad(critic(x).sum(), x, create_graph=True)
    return ((torch.linalg.vector_norm(gradient.flatten(1), dim=1) - 1) ** 2).mean()


class ResyncTask:
    """Training of the resynchroniser, for `cospeech.training.train`."""

    def __init__(self, clips, settings, seed, database, starts=None):
        torch.manual_seed(seed)
        self.settings = settings
        self.windows = training_pairs(clips, database, settings, seed, starts)
        statistics = {name: self.windows.statistics(name) for name in ("features", "motion")}
        self.generator = ResyncNetwork(clips[0].features.shape[1], settings, statistics).to(device())
        channels = clips[0].features.shape[1] + MOTION_CHANNELS
        widths = preset(settings.preset).scaled(settings.width).critic
        self.critic = Critic(channels, widths, settings.frames, "instance", "leaky", "average", bias=False)
        self.critic.to(device())
        self.modules = {"generator": self.generator, "critic": self.critic}
        options = {
            "lr": settings.learning_rate,
            "betas": settings.betas,
            "weight_decay": settings.weight_decay,
            "fused": True,
        }
        self.optimizers = {name: torch.optim.Adam(m.parameters(), **options) for name, m in self.modules.items()}
        lengths = np.median([bone_lengths(clip.positions) for clip in clips], axis=0)
        self.description = {
            "model": "resync", "settings": asdict(settings), "fps": clips[0].fps, "multiple": MULTIPLE, "halo": HALO,
            "bone_lengths": [round(float(length), 6) for length in lengths],
        }  # fmt: skip

    def iterate(self, step, rng):
        batch = self.windows.sample(rng, self.settings.batch)
        tensors = {name: torch.from_numpy(array).to(device()).transpose(1, 2) for name, array in batch.items()}
        matched = self.generator.standardized(tensors["features"], tensors["matched"])
        real = self.generator.standardized(tensors["features"], tensors["motion"])
        losses = self._update_critic(matched, real)
        if step % self.settings.critic_iterations == 0:
            losses |= self._update_generator(matched)
        return losses

    def _fake(self, matched):
        with autocast():
            motion = self.generator.refine(matched).float()
        return motion, torch.cat([matched[:, :-MOTION_CHANNELS], motion], dim=1)

    def _update_critic(self, matched, real):
        """Wasserstein loss of eq. 5.1 with the penalty of eq. 5.2; `wasserstein` hovers near zero when in balance."""
        with torch.no_grad():
            _, fake = self._fake(matched)
        wasserstein = self.critic(fake).mean() - self.critic(real).mean()
        penalty = gradient_penalty(self.critic, real, fake)
        descend(self, "critic", wasserstein + self.settings.gradient_penalty * penalty)
        return {"wasserstein": wasserstein.detach(), "gradient_penalty": penalty.detach()}

    def _update_generator(self, matched):
        motion, fake = self._fake(matched)
        adversarial = -self.critic(fake).mean()
        fidelity = F.l1_loss(motion, matched[:, -MOTION_CHANNELS:])
        descend(self, "generator", adversarial + self.settings.fidelity * fidelity)
        return {"adversarial": adversarial.detach(), "fidelity": fidelity.detach()}

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (B, C, T)}, output names)."""
        sizes = {"features": len(self.generator.features_mean), "matched": MOTION_CHANNELS}
        example = {name: torch.zeros(2, size, self.settings.frames) for name, size in sizes.items()}
        return self.generator.cpu().eval(), example, ["motion"]


def training_pairs(clips, database, settings, seed, starts=None):
    """Windows of (features, real motion, k-NN motion), one every `stride` frames, motions parent-relative (T, 165).

    starts : seconds at which each clip begins in its take (None: at 0), so that with a single take in the database a
    window is not matched with itself.
    """
    sources = [{"features": c.features, "positions": c.positions.reshape(len(c), -1)} for c in clips]
    windows = Windows(sources, [c.valid for c in clips], settings.frames, settings.stride)
    takes = np.concatenate([np.full(len(c), c.clip) for c in clips])[windows.starts]
    clock = [np.arange(len(c)) / c.fps + start for c, start in zip(clips, starts or [0.0] * len(clips), strict=True)]
    every = windows.take(slice(None))
    matched = fake_pairs(database, every["features"], takes, np.concatenate(clock)[windows.starts], seed=seed)
    relative = lambda x: to_parent_relative(x.reshape(*x.shape[:2], -1, 3)).reshape(*x.shape[:2], -1)  # noqa: E731
    motion, matched = relative(every["positions"]), relative(matched)
    sequences = [
        {"features": f, "motion": real.astype(np.float32), "matched": fake.astype(np.float32)}
        for f, real, fake in zip(every["features"], motion, matched, strict=True)
    ]
    return Windows(sequences, [np.ones(settings.frames, bool)] * len(sequences), settings.frames)
