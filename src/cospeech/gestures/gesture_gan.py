"""Chapter 4: one speech encoder, three decoders (face, body and head, hands), a discriminator on audio and pose.

Habibie et al. 2021 ("IVA 2021") section 4, thesis section 4.4. `regression` is the same network without the adversarial
loss (thesis section 4.5's direct regression).
"""

from dataclasses import asdict, dataclass, field

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.gestures.vectors import BODY_CHANNELS, HAND_CHANNELS, motion_to_vectors
from cospeech.training import autocast, descend, device
from cospeech.unet1d import HALO, MULTIPLE, Critic, Decoder, Encoder, preset
from cospeech.windows import Windows

PARTS = ("face", "body", "hands")


@dataclass(frozen=True)
class Settings:
    """Of one training; the defaults are the published ones (reference section 3.2).

    weights: of the loss terms. They balance un-normalised metres, with every term a mean over its elements: summed over
    time and channels the adversarial term would be a thousandth of the others, against the text's "equally weighted".
    r1: weight of the discriminator's squared gradient at real pairs (Mescheder et al. 2018). Not in the publication; it
    keeps a discriminator that has little data to learn from running away from the generator.
    feature_noise: deviation of Gaussian noise on the z-scored speech features in training. Not in the publication; it
    keeps the generator from learning a short recording by heart.
    """

    steps: int = 300_000
    batch: int = 25
    frames: int = 64
    learning_rate: float = 5e-4
    discriminator_learning_rate: float = 5e-4
    betas: tuple = (0.9, 0.999)
    preset: str = "resync"
    width: float = 1.0
    adversarial: bool = True
    generator_every: int = 1
    r1: float = 0.0
    feature_noise: float = 0.0
    weights: dict = field(default_factory=lambda: {"face": 0.37, "body": 600.0, "hands": 840.0, "adversarial": 5.0})


class GestureNetwork(nn.Module):
    """Speech features (B, 28, T) -> [face (B, E, T),] body (B, 42, T), hands (B, 126, T) in metres and radians.

    The encoder sees z-scored features; each decoder predicts deviations from the training mean in units of the training
    deviation, so that outputs and losses are in metres while the layers work on numbers around one.
    """

    def __init__(self, channels, widths, statistics):
        super().__init__()
        self.encoder = Encoder(channels["features"], widths.encoder)
        self.parts = [part for part in PARTS if part in channels]
        self.decoders = nn.ModuleDict({p: Decoder(channels[p], widths.encoder, widths.decoder) for p in self.parts})
        for name, (mean, deviation) in statistics.items():
            self.register_buffer(f"{name}_mean", torch.as_tensor(mean)[:, None])
            self.register_buffer(f"{name}_deviation", torch.as_tensor(deviation)[:, None])

    def standardized(self, name, x):
        """(x - mean) / deviation of the training part."""
        return (x - getattr(self, f"{name}_mean")) / getattr(self, f"{name}_deviation")

    def forward(self, features):
        maps = self.encoder(self.standardized("features", features))
        return tuple(
            self.decoders[p](maps) * getattr(self, f"{p}_deviation") + getattr(self, f"{p}_mean") for p in self.parts
        )


def reconstruction_losses(predicted, real):
    """Eq. 4.2's terms, unweighted: face, mean unsquared L2 norm per frame; body and hands, mean L1.

    predicted, real {part: (B, C, T)} -> {part: scalar}.
    """
    losses = {part: F.l1_loss(predicted[part], real[part]) for part in ("body", "hands")}
    if "face" in real:
        losses["face"] = torch.linalg.vector_norm(predicted["face"] - real["face"], dim=1).mean()
    return losses


class GestureTask:
    """Training of the chapter 4 network, for `cospeech.training.train`."""

    def __init__(self, clips, settings, seed):
        torch.manual_seed(seed)
        self.settings = settings
        sequences = [{"features": c.features, **motion_to_vectors(c.motion)} for c in clips]
        parts = set.intersection(*(set(s) for s in sequences))
        sequences = [{name: s[name] for name in sorted(parts)} for s in sequences]
        self.windows = Windows(sequences, [c.valid for c in clips], settings.frames)
        statistics = {name: self.windows.statistics(name) for name in sequences[0]}
        channels = {name: array.shape[1] for name, array in sequences[0].items()}
        widths = preset(settings.preset).scaled(settings.width)
        self.generator = GestureNetwork(channels, widths, statistics).to(device())
        betas = settings.betas
        self.modules = {"generator": self.generator}
        self.optimizers = {
            "generator": torch.optim.Adam(self.generator.parameters(), settings.learning_rate, betas, fused=True)
        }
        if settings.adversarial:
            judged = channels["features"] + BODY_CHANNELS + HAND_CHANNELS
            discriminator = Critic(judged, widths.critic, settings.frames).to(device())
            self.modules["discriminator"] = discriminator
            self.optimizers["discriminator"] = torch.optim.Adam(
                discriminator.parameters(), settings.discriminator_learning_rate, betas
            )
        self.description = {
            "model": "gesture_gan" if settings.adversarial else "regression", "settings": asdict(settings),
            "channels": channels, "fps": clips[0].fps, "face_model": clips[0].face_model if "face" in channels else "",
            "multiple": MULTIPLE, "halo": HALO,
        }  # fmt: skip

    def iterate(self, step, rng):
        batch = self.windows.sample(rng, self.settings.batch)
        real = {name: torch.from_numpy(array).to(device()).transpose(1, 2) for name, array in batch.items()}
        with autocast():
            predicted = dict(zip(self.generator.parts, self.generator(self._heard(real["features"])), strict=True))
        predicted = {part: x.float() for part, x in predicted.items()}
        losses = {}
        if self.settings.adversarial:
            losses["discriminator"] = self._update_discriminator(real, predicted)
        if step % self.settings.generator_every == 0:
            losses |= self._update_generator(real, predicted)
        return losses

    def _heard(self, features):
        """The features that the generator gets in training: with `feature_noise` deviations of noise."""
        noise = self.settings.feature_noise
        return features + noise * self.generator.features_deviation * torch.randn_like(features) if noise else features

    def _pair(self, features, motion):
        """What the discriminator judges, (B, 28 + 42 + 126, T) z-scored; the face is excluded (section 4.4.1)."""
        judged = {"features": features, "body": motion["body"], "hands": motion["hands"]}
        return torch.cat([self.generator.standardized(name, value) for name, value in judged.items()], dim=1)

    def _logits(self, pair):
        with autocast():
            return self.modules["discriminator"](pair).float()

    def _update_discriminator(self, real, predicted):
        """Maximise log D(real) + log(1 - D(fake)) (eq. 4.3; its printed min and max are swapped)."""
        true = self._pair(real["features"], real).requires_grad_(self.settings.r1 > 0)
        fake = self._pair(real["features"], {part: x.detach() for part, x in predicted.items()})
        logits = self._logits(true)
        loss = F.softplus(-logits).mean() + F.softplus(self._logits(fake)).mean()
        total = loss
        if self.settings.r1:
            (gradient,) = torch.autograd.grad(logits.sum(), true, create_graph=True)
            total = loss + self.settings.r1 / 2 * gradient.square().sum((1, 2)).mean()
        descend(self, "discriminator", total)
        return loss.detach()

    def _update_generator(self, real, predicted):
        terms = reconstruction_losses(predicted, real)
        if self.settings.adversarial:
            terms["adversarial"] = F.softplus(-self._logits(self._pair(real["features"], predicted))).mean()
        weighted = {name: self.settings.weights[name] * term for name, term in terms.items()}
        descend(self, "generator", sum(weighted.values()))
        return {name: term.detach() for name, term in weighted.items()}

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (B, C, T)}, output names)."""
        example = {"features": torch.zeros(2, self.description["channels"]["features"], self.settings.frames)}
        return self.generator.cpu().eval(), example, self.generator.parts
