"""MoGlow on speech (Alexanderson et al. 2020), the probabilistic baseline of thesis chapters 4 and 5: body and hands.

The condition of a frame are the poses before it, which training drops at random so that the speech is listened to, and
the speech from a little before to `look_ahead` frames after it. As in the thesis there is no face. A control variant
hears one more number in each frame: what a control signal is on average over four seconds. In training that is the
motion's own, in generation what is wanted of it.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from torch._higher_order_ops import scan
from torch.nn import functional as F

from cospeech.gestures.chapter4.flow import LAYERS, Flow
from cospeech.gestures.chapter4.pairs import MotionNetwork, Pairs
from cospeech.learning.settings import COUNT, NATURAL, POSITIVE, SHARE, UNPUBLISHED, WEIGHT, Section, key
from cospeech.learning.training import device

MOTION = ("body", "hands")
AVERAGED = 4.0  # seconds of a control signal (Alexanderson et al. 2020)
RIDGE, PREDICTED = 0.001, 10  # penalty of the prediction, in units of variance; frames it is fitted to, for each input
QUANTILES = (15, 50, 85)  # percentiles of it that are kept as targets


@dataclass(frozen=True)
class Settings(Section, section="moglow"):
    """Of one training; sizes are those the thesis found best (section 4.5.1), the rest StyleGestures'."""

    steps: int = key(80_000, "iterations", limits=COUNT)
    batch: int = key(80, "windows in each iteration", limits=COUNT)
    frames: int = key(64, "length of a window", "frames", COUNT)
    hidden: int = key(800, "H, units of the LSTMs", limits=COUNT)
    flows: int = key(10, "K, steps of the flow", limits=COUNT)
    history: int = key(5, "poses that are seen before a frame", "frames", COUNT)
    look_ahead: int = key(20, "speech that is heard after a frame", "frames", NATURAL)
    pose_dropout: float = key(0.4, "share of frames that do not see their past, so that speech is heard", limits=SHARE)
    learning_rate: float = key(1.5e-3, "of Adam, its highest", limits=POSITIVE)
    least_rate: float = key(1.5e-4, "what it falls to, with the root of the iterations (Noam)", limits=POSITIVE)
    warm_up: int = key(3000, "over which the rate rises before it falls", "iterations", COUNT)
    clip: float = key(5.0, "largest element of the gradient", limits=POSITIVE)
    norm: float = key(100.0, "largest norm of the gradient", limits=POSITIVE)
    noise: float = key(
        0.0, "deviation of noise on z-scored motion and speech in training", limits=WEIGHT, published=UNPUBLISHED
    )
    smoothing: float = key(
        0.0,
        "sigma of a Gaussian over the training motion; thesis section 5.4 has one without its size",
        "frames",
        WEIGHT,
    )
    linear: bool = key(
        False,
        "the flow is of what is left of a frame after its least-squares prediction from the condition, where a short "
        "training would not arrive",
        published=UNPUBLISHED,
    )


def averaged(signal, fps):
    """A control signal (T,) as the network gets it: mean over the `AVERAGED` seconds around each frame."""
    return uniform_filter1d(np.asarray(signal, np.float64), max(1, round(AVERAGED * fps)), mode="nearest")


def _smoothed(clip, sigma):
    """The clip after a Gaussian of `sigma` frames over body, hands and head rotation; the clip itself for 0."""
    if not sigma:
        return clip
    blur = lambda x: None if x is None else gaussian_filter1d(x, sigma, axis=0, mode="nearest")
    return replace(clip, positions=blur(clip.positions), rotation=blur(clip.rotation))


class MoGlow(MotionNetwork):
    """Samples: features (B, 28, T), noise (B, 168, T) -> body (B, 42, T), hands (B, 126, T) in metres and radians.

    Control variants take control (B, 1, T) too, in the signal's unit.
    """

    def __init__(self, pairs, settings):
        super().__init__(pairs)
        self.parts = list(MOTION)
        self.sizes = [pairs.channels[part] for part in MOTION]
        self.settings, channels = settings, sum(self.sizes)
        self.conditions = [name for name in ("features", "control") if name in pairs.channels]
        given = sum(pairs.channels[name] for name in self.conditions)
        context = given * (settings.history + 1 + settings.look_ahead)
        condition = context + settings.history * channels
        self.flow = Flow(channels, condition, settings.hidden, settings.flows)
        self.register_buffer("prediction", torch.zeros(condition, channels))

    def ready(self):
        """Prepare for sampling: invert the linear mixes, once."""
        with torch.no_grad():
            self.register_buffer("inverses", self.flow.inverses(), persistent=False)
        return self

    def speech_context(self, features, control=None):
        """z-scored speech, and control, around every frame: (B, 28, T) -> (B, T, (history + 1 + look_ahead) * 28)."""
        given = {"features": features, "control": control}
        standardized = torch.cat([self.standardized(name, given[name]) for name in self.conditions], dim=1)
        around = F.pad(standardized, (self.settings.history, self.settings.look_ahead), mode="replicate")
        count, frames = self.settings.history + 1 + self.settings.look_ahead, features.shape[2]
        return torch.cat([around[:, :, i : i + frames] for i in range(count)], dim=1).transpose(1, 2)

    def motion(self, real):
        """z-scored body and hands {part: (B, C, T)} -> (B, T, 168)."""
        return torch.cat([self.standardized(part, real[part]) for part in MOTION], dim=1).transpose(1, 2)

    def condition(self, motion, context, kept=None):
        """(B, T, C) of frames history..T of a sequence; kept (B, T - history) bool: frames that see their past."""
        history, frames = self.settings.history, motion.shape[1]
        past = torch.cat([motion[:, i : frames - history + i] for i in range(history)], dim=2)
        if kept is not None:
            past = past * kept[..., None]
        return torch.cat([past, context[:, history:]], dim=2)

    def log_likelihood(self, real):
        """Mean log-likelihood in nats a frame of {name: (B, C, T)}, given the first `history` frames."""
        motion = self.motion(real)
        condition = self.condition(motion, self.speech_context(*(real[name] for name in self.conditions)))
        return self.flow.log_likelihood(self.left(motion, condition), condition).mean(1)

    def left(self, motion, condition):
        """(B, T - history, 168): the frames after the first `history`, less what the condition predicts of them."""
        return motion[:, self.settings.history :] - condition @ self.prediction

    def forward(self, features, noise, control=None):
        context = self.speech_context(features, control)
        start = noise[:, :, 0] * 0  # zeros of the right size: the mean pose, and empty memories
        states = (
            start[:, :1].expand(-1, self.settings.hidden)[None, None].expand(self.settings.flows, 2 * LAYERS, -1, -1)
        )
        past = start.repeat(1, self.settings.history)

        def frame(carry, given):
            past, states = carry
            context, z = given
            condition = torch.cat([past, context], dim=1)
            x, states = self.flow.inverse_step(z, condition, states, self.inverses)
            x = x + condition @ self.prediction
            return (torch.cat([past[:, x.shape[1] :], x], dim=1), states), x.clone()

        _, x = scan(frame, (past, states.contiguous()), (context.transpose(0, 1), noise.permute(2, 0, 1)))
        parts = x.permute(1, 2, 0).split(self.sizes, dim=1)
        return tuple(self.measured(part, values) for part, values in zip(MOTION, parts, strict=True))


class MoGlowTask:
    """Maximum likelihood, for `learning.training.train`. control : a signal of every clip, list of (T,), or None."""

    def __init__(self, clips, settings, seed, model="moglow", control=None):
        torch.manual_seed(seed)
        self.settings = settings
        clips = [_smoothed(clip, settings.smoothing) for clip in clips]
        averages = [averaged(signal, clip.fps)[:, None] for signal, clip in zip(control or [], clips, strict=False)]
        self.pairs = Pairs(clips, settings.frames, {"control": averages} if control else None)
        self.generator = MoGlow(self.pairs, settings).to(device())
        self._fit(np.random.default_rng(seed))
        self.modules = {"generator": self.generator}
        self.optimizers = {"generator": torch.optim.Adam(self.generator.parameters(), settings.learning_rate)}
        self.description = {
            "model": model,
            "settings": asdict(settings),
            "channels": self.pairs.channels,
            "fps": self.pairs.fps,
            **self.pairs.build.lists(),
            "face_model": "",
            "multiple": 1,
            "halo": None,
        }
        if control:
            values = np.concatenate([signal[clip.valid] for signal, clip in zip(control, clips, strict=True)])
            self.description["targets"] = {str(q): float(np.percentile(values, q)) for q in QUANTILES}

    def _fit(self, rng):
        """Data-dependent first values: the prediction, if any, and the activation normalisations."""
        if self.settings.linear:
            size, frames = self.generator.prediction.shape[0], self.settings.batch * self.settings.frames
            batches = [self._batch(rng) for _ in range(-(-PREDICTED * size // frames))]
            rows = [torch.cat([batch[i].flatten(0, 1) for batch in batches]) for i in (0, 1)]
            ridge = RIDGE * len(rows[1]) * torch.eye(size, device=device())
            self.generator.prediction.copy_(torch.linalg.solve(rows[1].T @ rows[1] + ridge, rows[1].T @ rows[0]))
        left, condition = self._batch(rng)
        with torch.no_grad():
            self.generator.flow(left, condition, fit=True)

    def _batch(self, rng):
        network, settings = self.generator, self.settings
        real = self.pairs.sample(rng, settings.batch)
        motion, context = network.motion(real), network.speech_context(*(real[name] for name in network.conditions))
        motion = motion + settings.noise * torch.randn_like(motion)
        context = context + settings.noise * torch.randn_like(context)
        kept = torch.rand(motion.shape[0], motion.shape[1] - settings.history, device=motion.device)
        condition = network.condition(motion, context, kept >= settings.pose_dropout)
        return network.left(motion, condition), condition

    def rate(self, step):
        """Noam: a linear rise over `warm_up` iterations, then a fall with the square root, not below `least_rate`."""
        along = (step + 1) / self.settings.warm_up
        return max(self.settings.learning_rate * min(along, along**-0.5), self.settings.least_rate * min(along, 1))

    def iterate(self, step, rng):
        left, condition = self._batch(rng)
        loss = -self.generator.flow.log_likelihood(left, condition).mean() / left.shape[2]
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
        features, channels = self.pairs.channels["features"], sum(self.generator.sizes)
        example = {"features": torch.randn(1, features, 24), "noise": torch.randn(1, channels, 24)}
        if "control" in self.generator.conditions:
            example["control"] = self.generator.control_mean.cpu() + torch.zeros(1, 1, 24)
        return self.generator.cpu().eval().ready(), example, self.generator.parts
