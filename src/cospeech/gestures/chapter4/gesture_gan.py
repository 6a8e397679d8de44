"""Chapter 4: one speech encoder, three decoders (face, body and head, hands), a discriminator on audio and pose.

Habibie et al. 2021 ("IVA 2021") section 4, thesis section 4.4. Two of the baselines of thesis section 4.5 are this
network with another `adversary`: none, or one that judges how fast the motion is.
"""

from dataclasses import asdict, dataclass, field

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.errors import CospeechError
from cospeech.gestures.chapter4.pairs import MotionNetwork, Pairs
from cospeech.learning.training import autocast, descend, device
from cospeech.learning.unet1d import HALO, MULTIPLE, Critic, Decoder, Encoder, preset

# What the discriminator judges, of body and hands; the face is never among it (section 4.4.1).
ADVERSARIES = {"none": (), "audio_pose": ("features", "body", "hands"), "pose": ("body", "hands"),
               "velocity": ("body", "hands")}  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """Of one training; the defaults are the published ones (thesis section 4.4.2).

    weights: of the loss terms. They balance un-normalised metres, with every term a mean over its elements: summed over
    time and channels the adversarial term would be a thousandth of the others, against the text's "equally weighted".
    adversary: what the discriminator judges, one of `ADVERSARIES`: speech and pose (published), the pose alone, the
    pose's change from frame to frame (after Ginosar et al. 2019), or nothing.
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
    adversary: str = "audio_pose"
    generator_every: int = 1
    r1: float = 0.0
    feature_noise: float = 0.0
    weights: dict = field(default_factory=lambda: {"face": 0.37, "body": 600.0, "hands": 840.0, "adversarial": 5.0})


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
        if settings.adversary not in ADVERSARIES:
            raise CospeechError(f"budget: {model}.adversary is {settings.adversary!r}; known: {', '.join(ADVERSARIES)}")
        torch.manual_seed(seed)
        self.settings = settings
        self.pairs = Pairs(clips, settings.frames)
        self.judged = ADVERSARIES[settings.adversary]
        changes = [torch.from_numpy(self.pairs.changes[name]) for name in ("body", "hands")]
        self.changes = torch.cat(changes)[:, None].to(device())
        widths = preset(settings.preset).scaled(settings.width)
        self.generator = GestureNetwork(self.pairs, widths).to(device())
        betas = settings.betas
        self.modules = {"generator": self.generator}
        self.optimizers = {
            "generator": torch.optim.Adam(self.generator.parameters(), settings.learning_rate, betas, fused=True)
        }
        if self.judged:
            channels = sum(self.pairs.channels[name] for name in self.judged)
            discriminator = Critic(channels, widths.critic, settings.frames).to(device())
            self.modules["discriminator"] = discriminator
            self.optimizers["discriminator"] = torch.optim.Adam(
                discriminator.parameters(), settings.discriminator_learning_rate, betas
            )
        self.description = {
            "model": model, "settings": asdict(settings), "channels": self.pairs.channels, "fps": self.pairs.fps,
            "bone_lengths": self.pairs.bone_lengths.tolist(),
            "face_model": self.pairs.face_model, "multiple": MULTIPLE, "halo": HALO,
        }  # fmt: skip

    def iterate(self, step, rng):
        real = self.pairs.sample(rng, self.settings.batch)
        with autocast():
            predicted = dict(zip(self.generator.parts, self.generator(self._heard(real["features"])), strict=True))
        predicted = {part: x.float() for part, x in predicted.items()}
        losses = {}
        if self.judged:
            losses["discriminator"] = self._update_discriminator(real, predicted)
        if step % self.settings.generator_every == 0:
            losses |= self._update_generator(real, predicted)
        return losses

    def _heard(self, features):
        """The features that the generator gets in training: with `feature_noise` deviations of noise."""
        noise = self.settings.feature_noise
        return features + noise * self.generator.features_deviation * torch.randn_like(features) if noise else features

    def _seen(self, features, motion):
        """What the discriminator judges, (B, C, T) z-scored; of velocities, the first frame's is 0."""
        given = {"features": features, **motion}
        if self.settings.adversary == "velocity":
            seen = torch.cat([given[name].diff(dim=2) for name in self.judged], dim=1)
            return F.pad(seen / self.changes, (1, 0))
        return torch.cat([self.generator.standardized(name, given[name]) for name in self.judged], dim=1)

    def _logits(self, seen):
        with autocast():
            return self.modules["discriminator"](seen).float()

    def _update_discriminator(self, real, predicted):
        """Maximise log D(real) + log(1 - D(fake)): eq. 4.2 (IVA 2021 eq. 2)."""
        true = self._seen(real["features"], real).requires_grad_(self.settings.r1 > 0)
        fake = self._seen(real["features"], {part: x.detach() for part, x in predicted.items()})
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
        if self.judged:
            terms["adversarial"] = F.softplus(-self._logits(self._seen(real["features"], predicted))).mean()
        weighted = {name: self.settings.weights[name] * term for name, term in terms.items()}
        descend(self, "generator", sum(weighted.values()))
        return {name: term.detach() for name, term in weighted.items()}

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (B, C, T)}, output names)."""
        example = {"features": torch.zeros(2, self.pairs.channels["features"], self.settings.frames)}
        return self.generator.cpu().eval(), example, self.generator.parts
