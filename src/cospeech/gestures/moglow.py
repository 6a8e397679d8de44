"""MoGlow on speech (Alexanderson et al. 2020), the probabilistic baseline of thesis chapters 4 and 5: body and hands.

The condition of a frame are the poses before it, which training drops at random so that the speech is listened to, and
the speech from a little before to `look_ahead` frames after it. As in the thesis there is no face.
"""

from dataclasses import asdict, dataclass

import numpy as np
import torch
from torch._higher_order_ops import scan
from torch.nn import functional as F

from cospeech.gestures.flow import LAYERS, Flow
from cospeech.gestures.pairs import MotionNetwork, Pairs
from cospeech.training import device

MOTION = ("body", "hands")


@dataclass(frozen=True)
class Settings:
    """Of one training; sizes are those the thesis found best (H = 800, K = 10), the rest StyleGestures' (reference 8).

    hidden, flows : H and K. history : poses before a frame. look_ahead : frames of speech after it. pose_dropout :
    share of frames that do not see their past. warm_up : iterations until the full learning rate, which then falls with
    their square root down to `least_rate` (Noam). clip, norm : largest gradient element and norm. noise : deviation of
    noise on the z-scored motion and speech in training, none as published.
    """

    steps: int = 80_000
    batch: int = 80
    frames: int = 64
    hidden: int = 800
    flows: int = 10
    history: int = 5
    look_ahead: int = 20
    pose_dropout: float = 0.4
    learning_rate: float = 1.5e-3
    least_rate: float = 1.5e-4
    warm_up: int = 3000
    clip: float = 5.0
    norm: float = 100.0
    noise: float = 0.0


class MoGlow(MotionNetwork):
    """Samples: features (B, 28, T), noise (B, 168, T) -> body (B, 42, T), hands (B, 126, T) in metres and radians."""

    def __init__(self, pairs, settings):
        super().__init__(pairs)
        self.parts = list(MOTION)
        self.sizes = [pairs.channels[part] for part in MOTION]
        self.settings, channels = settings, sum(self.sizes)
        heard = pairs.channels["features"] * (settings.history + 1 + settings.look_ahead)
        self.flow = Flow(channels, heard + settings.history * channels, settings.hidden, settings.flows)

    def ready(self):
        """Prepare for sampling: invert the linear mixes, once."""
        with torch.no_grad():
            self.register_buffer("inverses", self.flow.inverses(), persistent=False)
        return self

    def heard(self, features):
        """z-scored speech around every frame: (B, 28, T) -> (B, T, (history + 1 + look_ahead) * 28)."""
        standardized = self.standardized("features", features)
        around = F.pad(standardized, (self.settings.history, self.settings.look_ahead), mode="replicate")
        count, frames = self.settings.history + 1 + self.settings.look_ahead, features.shape[2]
        return torch.cat([around[:, :, i : i + frames] for i in range(count)], dim=1).transpose(1, 2)

    def motion(self, real):
        """z-scored body and hands {part: (B, C, T)} -> (B, T, 168)."""
        return torch.cat([self.standardized(part, real[part]) for part in MOTION], dim=1).transpose(1, 2)

    def condition(self, motion, heard, kept=None):
        """(B, T, C) of frames history..T of a sequence; kept (B, T - history) bool: frames that see their past."""
        history, frames = self.settings.history, motion.shape[1]
        past = torch.cat([motion[:, i : frames - history + i] for i in range(history)], dim=2)
        if kept is not None:
            past = past * kept[..., None]
        return torch.cat([past, heard[:, history:]], dim=2)

    def log_likelihood(self, real):
        """Mean log-likelihood in nats a frame of {name: (B, C, T)}, given the first `history` frames."""
        motion = self.motion(real)
        condition = self.condition(motion, self.heard(real["features"]))
        return self.flow.log_likelihood(motion[:, self.settings.history :], condition).mean(1)

    def forward(self, features, noise):
        heard = self.heard(features)
        start = noise[:, :, 0] * 0  # zeros of the right size: the mean pose, and empty memories
        states = start[:, :1].expand(-1, self.settings.hidden)[None, None].expand(
            self.settings.flows, 2 * LAYERS, -1, -1)  # fmt: skip
        past = start.repeat(1, self.settings.history)

        def frame(carry, given):
            past, states = carry
            heard, z = given
            x, states = self.flow.inverse_step(z, torch.cat([past, heard], dim=1), states, self.inverses)
            return (torch.cat([past[:, x.shape[1] :], x], dim=1), states), x.clone()

        _, x = scan(frame, (past, states.contiguous()), (heard.transpose(0, 1), noise.permute(2, 0, 1)))
        parts = x.permute(1, 2, 0).split(self.sizes, dim=1)
        return tuple(self.measured(part, values) for part, values in zip(MOTION, parts, strict=True))


class MoGlowTask:
    """Maximum likelihood, for `cospeech.training.train`."""

    def __init__(self, clips, settings, seed):
        torch.manual_seed(seed)
        self.settings = settings
        self.pairs = Pairs(clips, settings.frames)
        self.generator = MoGlow(self.pairs, settings).to(device())
        self._fit(np.random.default_rng(seed))
        self.modules = {"generator": self.generator}
        self.optimizers = {"generator": torch.optim.Adam(self.generator.parameters(), settings.learning_rate)}
        self.description = {
            "model": "moglow", "settings": asdict(settings), "channels": self.pairs.channels, "fps": self.pairs.fps,
            "face_model": "", "multiple": 1, "halo": None,
        }  # fmt: skip

    def _fit(self, rng):
        """Data-dependent first values of the activation normalisations."""
        motion, condition = self._batch(rng)
        with torch.no_grad():
            self.generator.flow(motion, condition, fit=True)

    def _batch(self, rng):
        network, settings = self.generator, self.settings
        real = self.pairs.sample(rng, settings.batch)
        motion, heard = network.motion(real), network.heard(real["features"])
        motion = motion + settings.noise * torch.randn_like(motion)
        heard = heard + settings.noise * torch.randn_like(heard)
        kept = torch.rand(motion.shape[0], motion.shape[1] - settings.history, device=motion.device)
        return motion[:, settings.history :], network.condition(motion, heard, kept >= settings.pose_dropout)

    def rate(self, step):
        """Noam: a linear rise over `warm_up` iterations, then a fall with the square root, not below `least_rate`."""
        along = (step + 1) / self.settings.warm_up
        return max(self.settings.learning_rate * min(along, along**-0.5), self.settings.least_rate * min(along, 1))

    def iterate(self, step, rng):
        motion, condition = self._batch(rng)
        loss = -self.generator.flow.log_likelihood(motion, condition).mean() / motion.shape[2]
        optimizer, parameters = self.optimizers["generator"], self.generator.parameters()
        for group in optimizer.param_groups:
            group["lr"] = self.rate(step)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        parameters = list(parameters)
        torch.nn.utils.clip_grad_value_(parameters, self.settings.clip)
        torch.nn.utils.clip_grad_norm_(parameters, self.settings.norm)
        optimizer.step()
        return {"negative_log_likelihood": loss.detach()}

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (B, C, T)}, output names)."""
        heard, channels = self.pairs.channels["features"], sum(self.generator.sizes)
        example = {"features": torch.randn(1, heard, 24), "noise": torch.randn(1, channels, 24)}
        return self.generator.cpu().eval().ready(), example, self.generator.parts
