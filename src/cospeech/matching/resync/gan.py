"""Chapter 5, stage 2: the conditional GAN that resynchronises a k-NN motion with its speech (thesis section 5.3.3).

A WGAN-GP: the generator turns (speech, k-NN motion) into a motion that the critic cannot tell from the speaker's own.
Two recipes by name, the thesis's text and the released code; `docs/resync.md` tells where they differ.
"""

from copy import deepcopy
from dataclasses import asdict, dataclass

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.clip import speaker_build
from cospeech.errors import CospeechError, notice
from cospeech.learning.settings import (
    BETAS,
    COUNT,
    POSITIVE,
    UNPUBLISHED,
    WEIGHT,
    Section,
    key,
    one_of,
    settings_of,
    some_of,
)
from cospeech.learning.training import autocast, descend, device
from cospeech.learning.unet1d import HALO, MULTIPLE, WINDOW, Critic, Decoder, Encoder, ZScored, preset
from cospeech.learning.unet1d import PRESETS as WIDTHS
from cospeech.learning.windows import divisor, moments
from cospeech.matching.database.motion_database import PLACEMENTS
from cospeech.matching.resync.conditions import CONDITIONS, Conditions
from cospeech.matching.resync.window_pairs import training_pairs

MOTION_CHANNELS = 165
LAYERS = {
    "published": {"activation": "relu", "pool": "max", "convolutions_last": 3, "xavier": False},
    "released": {"activation": "leaky", "pool": "average", "convolutions_last": 2, "xavier": True},
}
BALANCE_FROM, BALANCE_EVERY = 10_000, 1000  # iterations of the released code's choice of model


@dataclass(frozen=True)
class Settings(Section, section="resync"):
    """Of one training; the defaults are those of thesis section 5.3.3 or, where it is silent, of its public code."""

    steps: int = key(300_000, "iterations", limits=COUNT)
    batch: int = key(100, "windows in each iteration", limits=COUNT)
    frames: int = key(64, "length of a window", "frames", WINDOW)
    stride: int = key(5, "between the starts of two training windows", "frames", COUNT)
    learning_rate: float = key(1e-4, "of Adam, generator and critic", limits=POSITIVE)
    betas: tuple = key((0.0, 0.9), "of Adam", limits=BETAS)
    weight_decay: float = key(4e-5, "of Adam", limits=WEIGHT)
    preset: str = key(
        "published",
        "what the keys are that are left out: the thesis, or the public code",
        limits=one_of("published", "released"),
    )
    layers: str = key(
        "published",
        "published: ReLU, max pooling, 7 convolutions up and a head; released: leaky ReLU, average pooling, 6 and a "
        "head, Xavier-normal initial weights",
        limits=one_of(*LAYERS),
    )
    widths: str = key("resync", "which reconstruction of the channels, which nobody printed", limits=one_of(*WIDTHS))
    width: float = key(1.0, "factor on the number of channels", limits=POSITIVE)
    critic_iterations: int = key(5, "critic updates for each of the generator", limits=COUNT)
    gradient_penalty: float = key(100.0, "weight of the critic's gradient penalty", limits=WEIGHT)
    penalty_at: str = key(
        "generated",
        "where it is taken: for the motion at generated pairs (eq. 5.2 as printed), or for speech and motion at random "
        "interpolates of real and generated pairs (Gulrajani et al. 2017)",
        limits=one_of("generated", "interpolates"),
    )
    fidelity: float = key(0.1, "weight of the L1 distance to the k-NN motion", limits=WEIGHT)
    statistics: str = key(
        "real",
        "z-score k-NN motion by real motion's, or in training by its own (mixed)",
        limits=one_of("real", "mixed"),
    )
    keep: str = key(
        "last",
        "the last iteration, or of every 1000th after 10 000 that of the most balanced critic",
        limits=one_of("last", "balanced"),
    )
    placement: str = key(
        "published",
        "where the k-NN windows of the training pairs may start (docs/matching.md)",
        limits=one_of(*PLACEMENTS),
    )
    residual: bool = key(
        False, "add the output to the k-NN motion instead of replacing it, for short trainings", published=UNPUBLISHED
    )
    condition: tuple = key(
        (),
        "control signals that the generator is given and is to keep",
        limits=some_of(*CONDITIONS),
        published=UNPUBLISHED,
    )
    condition_weight: float = key(
        1.0, "weight of the L1 distance of their signals, in deviations", limits=WEIGHT, published=UNPUBLISHED
    )


PRESETS = {
    "published": Settings(),
    "released": Settings(
        preset="released", layers="released", penalty_at="interpolates", statistics="mixed", keep="balanced"
    ),
}


def settings_from(section):
    """A budget's section (a dict) -> Settings: its preset's values, then its own keys. CospeechError on a bad one."""
    name = section.get("preset", Settings.preset)
    settings = settings_of(PRESETS.get(name, Settings()), section, "resync")
    if settings.condition and settings.statistics == "mixed":
        raise CospeechError("budget: resync.condition needs the k-NN motion in true metres; set statistics: real")
    return settings


class ResyncNetwork(ZScored):
    """features (B, 28, T), matched (B, 165, T) parent-relative metres -> motion (B, 165, T) parent-relative metres.

    statistics : {"features", "motion" and, with conditions, "condition": (mean (C,), deviation (C,))} of real data.
    """

    def __init__(self, channels, settings, statistics, fps=15.0):
        super().__init__(statistics)
        widths, layers = preset(settings.widths).scaled(settings.width), LAYERS[settings.layers]
        self.residual = settings.residual
        self.conditions = Conditions(settings.condition, fps) if settings.condition else None
        inputs = channels + len(settings.condition) + MOTION_CHANNELS
        self.encoder = Encoder(inputs, widths.encoder, layers["activation"], layers["pool"])
        self.decoder = Decoder(
            MOTION_CHANNELS, widths.encoder, widths.decoder, layers["activation"], layers["convolutions_last"]
        )
        initialise(self, settings)
        if settings.residual:
            nn.init.zeros_(self.decoder.head.weight)
            nn.init.zeros_(self.decoder.head.bias)

    def joined(self, features, motion):
        """(B, 28 + 165, T): both z-scored by the statistics of the real training data."""
        return torch.cat([self.standardized("features", features), self.standardized("motion", motion)], dim=1)

    def signals(self, motion):
        """Standardised motion (B, 165, T) -> the conditions' z-scored signals (B, S, T)."""
        return self.standardized("condition", self.conditions(self.measured("motion", motion)))

    def refine(self, x):
        """The generator on standardised input (B, 193, T) -> standardised motion (B, 165, T)."""
        matched = x[:, -MOTION_CHANNELS:]
        if self.conditions is not None:
            x = torch.cat([x, self.signals(matched)], dim=1)
        moves = self.motion_deviation > 0  # what never does would give generated motion away to the critic
        out = self.decoder(self.encoder(x)) * moves
        return out + matched if self.residual else out

    def forward(self, features, matched):
        return self.measured("motion", self.refine(self.joined(features, matched)))


def initialise(network, settings):
    """The released code's first weights, Xavier-normal with the gain of ReLU, where `layers` asks for them."""
    if not LAYERS[settings.layers]["xavier"]:
        return
    for module in network.modules():
        if isinstance(module, (nn.Conv1d, nn.Linear)):
            nn.init.xavier_normal_(module.weight, nn.init.calculate_gain("relu"))
            if module.bias is not None:
                nn.init.zeros_(module.bias)


def gradient_penalty(critic, real, fake, at="interpolates"):
    """E (|grad D(x)| - 1)^2 of pairs (B, C, T).

    `generated`: at the generated pairs, of the gradient for the motion (eq. 5.2 as printed). `interpolates`: at random
    points between real and generated pairs, one alpha per sample, for all channels (Gulrajani et al. 2017).
    """
    if at == "interpolates":
        alpha = torch.rand(len(real), 1, 1, device=real.device)
        fake = alpha * real + (1 - alpha) * fake
    x = fake.detach().requires_grad_()
    (gradient,) = torch.autograd.grad(critic(x).sum(), x, create_graph=True)
    if at == "generated":
        gradient = gradient[:, -MOTION_CHANNELS:]
    return ((torch.linalg.vector_norm(gradient.flatten(1), dim=1) - 1) ** 2).mean()


class Kept(nn.Module):
    """The generator of the iteration whose critic told real from generated least, so far (the released choice)."""

    def __init__(self, generator):
        super().__init__()
        self.generator = deepcopy(generator).requires_grad_(False)
        self.register_buffer("imbalance", torch.tensor(float("inf")))

    def update(self, step, generator, wasserstein):
        """Keep the generator if it is the turn of this iteration, and the critic's difference the smallest."""
        if step >= BALANCE_FROM and step % BALANCE_EVERY == 0 and wasserstein.abs() < self.imbalance:
            self.imbalance.copy_(wasserstein.abs())
            self.generator.load_state_dict(generator.state_dict())


class ResyncTask:
    """Training of the resynchroniser, for `cospeech.learning.training.train`."""

    def __init__(self, clips, settings, seed, database, starts=None):
        torch.manual_seed(seed)
        self.settings = settings
        self.windows = training_pairs(clips, database, settings, seed, starts)
        channels, fps = clips[0].features.shape[1], clips[0].fps
        statistics = {name: self.windows.statistics(name) for name in ("features", "motion")}
        if settings.condition:
            statistics["condition"] = self._signal_statistics(Conditions(settings.condition, fps))
        self.generator = ResyncNetwork(channels, settings, statistics, fps).to(device())
        widths = preset(settings.widths).scaled(settings.width).critic
        self.critic = Critic(
            channels + MOTION_CHANNELS, widths, settings.frames, "instance", "leaky", "average", bias=False
        )
        initialise(self.critic, settings)
        self.critic.to(device())
        self.modules = {"generator": self.generator, "critic": self.critic}
        options = {
            "lr": settings.learning_rate,
            "betas": settings.betas,
            "weight_decay": settings.weight_decay,
            "fused": True,
        }
        self.optimizers = {name: torch.optim.Adam(m.parameters(), **options) for name, m in self.modules.items()}
        if settings.keep == "balanced":
            self.modules["kept"] = Kept(self.generator)
        self.own = self.windows.statistics("matched") if settings.statistics == "mixed" else statistics["motion"]
        self.description = {
            "model": "resync",
            "settings": asdict(settings),
            "fps": fps,
            "multiple": MULTIPLE,
            "halo": HALO,
            **speaker_build(clips).lists(),
        }

    def _signal_statistics(self, conditions):
        """Mean and deviation (S,), (S,) of the conditions over the real windows."""
        blocks = (conditions(torch.from_numpy(motion).mT) for motion in self.windows.real_motion())
        return moments(block.mT.reshape(-1, block.shape[1]).numpy() for block in blocks)

    def iterate(self, step, rng):
        batch = self.windows.sample(rng, self.settings.batch)
        mean, deviation = self.own
        batch["matched"] = (batch["matched"] - mean) / divisor(deviation)
        tensors = {name: torch.from_numpy(array).to(device()).transpose(1, 2) for name, array in batch.items()}
        real = self.generator.joined(tensors["features"], tensors["motion"])
        matched = torch.cat([real[:, :-MOTION_CHANNELS], tensors["matched"]], dim=1)
        losses = self._update_critic(matched, real)
        if "kept" in self.modules:
            self.modules["kept"].update(step, self.generator, losses["wasserstein"])
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
        penalty = gradient_penalty(self.critic, real, fake, self.settings.penalty_at)
        descend(self, "critic", wasserstein + self.settings.gradient_penalty * penalty)
        return {"wasserstein": wasserstein.detach(), "gradient_penalty": penalty.detach()}

    def _update_generator(self, matched):
        """Eq. 5.3, and for a conditioned generator the L1 distance of the control signals to the k-NN motion's."""
        motion, fake = self._fake(matched)
        losses = {"adversarial": -self.critic(fake).mean()}
        losses["fidelity"] = F.l1_loss(motion, matched[:, -MOTION_CHANNELS:])
        total = losses["adversarial"] + self.settings.fidelity * losses["fidelity"]
        if self.settings.condition:
            wanted = self.generator.signals(matched[:, -MOTION_CHANNELS:])
            losses["condition"] = F.l1_loss(self.generator.signals(motion), wanted)
            total = total + self.settings.condition_weight * losses["condition"]
        descend(self, "generator", total)
        return {name: loss.detach() for name, loss in losses.items()}

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (B, C, T)}, output names)."""
        kept = self.modules.get("kept")
        if kept and not torch.isfinite(kept.imbalance):
            notice(f"resync: keep: balanced looks from iteration {BALANCE_FROM} on; the last one is kept instead")
        generator = kept.generator if kept and torch.isfinite(kept.imbalance) else self.generator
        sizes = {"features": len(generator.features_mean), "matched": MOTION_CHANNELS}
        example = {name: torch.zeros(2, size, self.settings.frames) for name, size in sizes.items()}
        return generator.cpu().eval(), example, ["motion"]


def training_task(name, recordings, settings, seed):
    """The training of `resync` on `Recordings` with a database."""
    del name
    return ResyncTask(recordings.clips, settings_from(settings), seed, recordings.database, recordings.starts)
