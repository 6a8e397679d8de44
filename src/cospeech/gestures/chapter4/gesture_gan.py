"""Chapter 4: one speech encoder, three decoders (face, body and head, hands), a discriminator on audio and pose.

Habibie et al. 2021 ("IVA 2021") section 4, thesis section 4.4. Two of the baselines of thesis section 4.5 are this
network with another `adversary`: none, or one that judges how fast the motion is.
"""

from dataclasses import asdict, dataclass

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.gestures.chapter4.pairs import MotionNetwork, Pairs
from cospeech.learning.settings import BETAS, COUNT, LEFT_OUT, POSITIVE, UNPUBLISHED, WEIGHT, Section, key, one_of
from cospeech.learning.training import autocast, descend, device
from cospeech.learning.unet1d import HALO, MULTIPLE, WINDOW, Critic, Decoder, Encoder, preset
from cospeech.learning.unet1d import PRESETS as WIDTHS

# What the discriminator judges, of body and hands; the face is never among it (section 4.4.1).
ADVERSARIES = {
    "none": (),
    "audio_pose": ("features", "body", "hands"),
    "pose": ("body", "hands"),
    "velocity": ("body", "hands"),
}


@dataclass(frozen=True)
class Settings(Section, section="gesture_gan"):
    """Of one training; the defaults are the published ones (thesis section 4.4.2).

    The weights balance un-normalised metres, with every term a mean over its elements: summed over time and channels
    the adversarial term would be a thousandth of the others, against the text's "equally weighted".
    """

    steps: int = key(300_000, "iterations", limits=COUNT)
    batch: int = key(25, "windows in each iteration", limits=COUNT)
    frames: int = key(64, "length of a window", "frames", WINDOW)
    learning_rate: float = key(5e-4, "of Adam", limits=POSITIVE)
    discriminator_learning_rate: float = key(5e-4, "of the discriminator's Adam", limits=POSITIVE)
    betas: tuple = key((0.9, 0.999), "of both Adams", limits=BETAS)
    preset: str = key("resync", "which reconstruction of the channels, which nobody printed", limits=one_of(*WIDTHS))
    width: float = key(1.0, "factor on the number of channels", limits=POSITIVE)
    adversary: str = key(
        "audio_pose",
        "what the discriminator judges: nothing (so regression), speech and pose (so gesture_gan), the pose alone, or "
        "its change from frame to frame (after Ginosar et al. 2019)",
        limits=one_of(*ADVERSARIES),
        published=LEFT_OUT,  # the model's name decides
    )
    generator_every: int = key(1, "update the generator in every n-th iteration", limits=COUNT)
    r1: float = key(
        0.0,
        "weight of the discriminator's squared gradient at real motion (Mescheder et al. 2018), which keeps it from "
        "running away where there is little data",
        limits=WEIGHT,
        published=UNPUBLISHED,
    )
    feature_noise: float = key(
        0.0,
        "deviation of noise on the z-scored speech features in training, against learning a short recording by heart",
        limits=WEIGHT,
        published=UNPUBLISHED,
    )
    weights: dict = key(
        {"face": 0.37, "body": 600.0, "hands": 840.0, "adversarial": 5.0},
        "of the loss terms",
        limits=WEIGHT,
        parts={
            "face": "distance of expressions, in the face tracker's coefficients",
            "body": "L1 of body and head, in metres and radians",
            "hands": "L1 of the hands, in metres",
            "adversarial": "what the discriminator says",
        },
    )


class GestureNetwork(MotionNetwork):
    """Speech features (B, 28, T) -> [face (B, E, T),] body (B, 42, T), hands (B, 126, T) in metres and radians."""

    def __init__(self, pairs, widths):
        super().__init__(pairs)
        self.encoder = Encoder(pairs.channels["features"], widths.encoder)
        self.decoders = nn.ModuleDict(
            {part: Decoder(pairs.channels[part], widths.encoder, widths.decoder) for part in self.parts}
        )

    def forward(self, features):
        maps = self.encoder(self.standardized("features", features))
        return tuple(self.measured(part, self.decoders[part](maps)) for part in self.parts)


def reconstruction_losses(predicted, real):
    """The terms of eq. 4.1 (IVA 2021 eq. 1), unweighted: face, mean unsquared L2 norm per frame; body, hands, mean L1.

    predicted, real {part: (B, C, T)} -> {part: scalar}.
    """
    losses = {part: F.l1_loss(predicted[part], real[part]) for part in ("body", "hands")}
    if "face" in real:
        losses["face"] = torch.linalg.vector_norm(predicted["face"] - real["face"], dim=1).mean()
    return losses


class GestureTask:
    """Training of the chapter 4 network, for `cospeech.learning.training.train`."""

    def __init__(self, clips, settings, seed, model="gesture_gan"):
        torch.manual_seed(seed)
        self.settings = settings
        self.pairs = Pairs(clips, settings.frames)
        self.adversarial_inputs = ADVERSARIES[settings.adversary]
        changes = [torch.from_numpy(self.pairs.changes[name]) for name in ("body", "hands")]
        self.changes = torch.cat(changes)[:, None].to(device())
        widths = preset(settings.preset).scaled(settings.width)
        self.generator = GestureNetwork(self.pairs, widths).to(device())
        betas = settings.betas
        self.modules = {"generator": self.generator}
        self.optimizers = {
            "generator": torch.optim.Adam(self.generator.parameters(), settings.learning_rate, betas, fused=True)
        }
        if self.adversarial_inputs:
            channels = sum(self.pairs.channels[name] for name in self.adversarial_inputs)
            discriminator = Critic(channels, widths.critic, settings.frames).to(device())
            self.modules["discriminator"] = discriminator
            self.optimizers["discriminator"] = torch.optim.Adam(
                discriminator.parameters(), settings.discriminator_learning_rate, betas
            )
        self.description = {
            "model": model,
            "settings": asdict(settings),
            "channels": self.pairs.channels,
            "fps": self.pairs.fps,
            **self.pairs.build.lists(),
            "face_model": self.pairs.face_model,
            "multiple": MULTIPLE,
            "halo": HALO,
        }

    def iterate(self, step, rng):
        real = self.pairs.sample(rng, self.settings.batch)
        with autocast():
            predicted = dict(
                zip(self.generator.parts, self.generator(self._noisy_features(real["features"])), strict=True)
            )
        predicted = {part: x.float() for part, x in predicted.items()}
        losses = {}
        if self.adversarial_inputs:
            losses["discriminator"] = self._update_discriminator(real, predicted)
        if step % self.settings.generator_every == 0:
            losses |= self._update_generator(real, predicted)
        return losses

    def _noisy_features(self, features):
        """The features that the generator gets in training: with `feature_noise` deviations of noise."""
        noise = self.settings.feature_noise
        return features + noise * self.generator.features_deviation * torch.randn_like(features) if noise else features

    def _discriminator_inputs(self, features, motion):
        """What the discriminator judges, (B, C, T) z-scored; of velocities, the first frame's is 0."""
        given = {"features": features, **motion}
        if self.settings.adversary == "velocity":
            inputs = torch.cat([given[name].diff(dim=2) for name in self.adversarial_inputs], dim=1)
            return F.pad(inputs / self.changes, (1, 0))
        return torch.cat([self.generator.standardized(name, given[name]) for name in self.adversarial_inputs], dim=1)

    def _logits(self, inputs):
        with autocast():
            return self.modules["discriminator"](inputs).float()

    def _update_discriminator(self, real, predicted):
        """Maximise log D(real) + log(1 - D(fake)): eq. 4.2 (IVA 2021 eq. 2)."""
        true = self._discriminator_inputs(real["features"], real).requires_grad_(self.settings.r1 > 0)
        fake = self._discriminator_inputs(real["features"], {part: x.detach() for part, x in predicted.items()})
        logits = self._logits(true)
        loss = F.softplus(-logits).mean() + F.softplus(self._logits(fake)).mean()
        total = loss
        if self.settings.r1:
            (gradient,) = torch.autograd.grad(logits.sum(), true, create_graph=True)
            total = loss + self.settings.r1 / 2 * gradient.square().sum((1, 2)).mean()
        descend(self, "discriminator", total)
        return loss.detach()

    def _update_generator(self, real, predicted):
        """Eq. 4.3 (IVA 2021 eq. 3), whose min and max are swapped in print; log(1 - D) in its non-saturating form."""
        terms = reconstruction_losses(predicted, real)
        if self.adversarial_inputs:
            terms["adversarial"] = F.softplus(
                -self._logits(self._discriminator_inputs(real["features"], predicted))
            ).mean()
        weighted = {name: self.settings.weights[name] * term for name, term in terms.items()}
        descend(self, "generator", sum(weighted.values()))
        return {name: term.detach() for name, term in weighted.items()}

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (B, C, T)}, output names)."""
        example = {"features": torch.zeros(2, self.pairs.channels["features"], self.settings.frames)}
        return self.generator.cpu().eval(), example, self.generator.parts
