"""What the trainings of this folder share: batches of a corpus, a discriminator that joins late, the export."""

from abc import ABC, abstractmethod
from dataclasses import asdict, replace

import torch

from cospeech.gestures.ha2g.dataset.corpus import FPS, FRAMES, SAMPLES, SEED_FRAMES
from cospeech.gestures.ha2g.losses import discriminator_loss, generator_loss
from cospeech.learning.settings import settings_of
from cospeech.learning.training import descend, device
from cospeech.speech.mel import BINS, COLUMNS, S2G_BINS, S2G_COLUMNS


class WindowTask:
    """A training on windows of a `Corpus`. A subclass sets `generator` and says what one iteration does.

    settings : its dataclass, with `steps`, `epochs` and `batch`; steps of 0 are those that the epochs make.
    conditions : those of the corpus's keys that the network is conditioned on.
    """

    model, defaults = "", None
    conditions = ()
    sequences = False  # its inputs are units of a fixed length

    @classmethod
    def settings_of(cls, mapping, corpus):
        """The settings of a budget's section on a `Corpus`: its keys over the `defaults`."""
        del corpus  # those of HA2G depend on it
        return settings_of(cls.defaults, mapping, cls.model)

    def __init__(self, corpus, settings, seed):
        torch.manual_seed(seed)
        self.corpus, self.seed = corpus, seed
        steps = settings.steps or max(1, round(settings.epochs * len(corpus) / settings.batch))
        self.settings = replace(settings, steps=steps)
        self.modules, self.optimizers = {}, {}

    def add(self, name, module, learning_rate, betas=(0.9, 0.999)):
        """Take a network into the training, with one Adam for all of it."""
        self.modules[name] = module.to(device())
        self.optimizers[name] = torch.optim.Adam(module.parameters(), learning_rate, betas)
        return self.modules[name]

    @property
    def channels(self):
        """Numbers of a whole pose, 3V."""
        return 3 * self.corpus.levels.vectors

    def batch(self, rng):
        """Random windows, {key: tensor on the training device}; the speaker as weights (N, S)."""
        keys = (*self.conditions, "poses")
        arrays = self.corpus.sample(rng, self.settings.batch, keys=keys)
        batch = {key: torch.from_numpy(array).to(device()) for key, array in arrays.items()}
        if "speaker" in batch:
            batch["speaker"] = self.weights_of(batch["speaker"])
        batch["seed"] = batch["poses"][:, :SEED_FRAMES]
        return batch

    def weights_of(self, speakers):
        """Speaker numbers (N,) -> weights (N, S)."""
        return torch.nn.functional.one_hot(speakers, len(self.corpus.speakers)).float()

    @property
    def description(self):
        """What whoever generates has to know, JSON-able."""
        corpus = self.corpus
        return {
            "model": self.model,
            "settings": asdict(self.settings),
            "levels": corpus.levels.name,
            "fps": FPS,
            "frames": FRAMES,
            "seed_frames": SEED_FRAMES,
            "inputs": {name: list(x.shape[1:]) for name, x in self.example().items()},
            "mean": corpus.mean.tolist(),
            "lengths": corpus.lengths.tolist(),
            "speakers": list(corpus.speakers),
            "vocabulary": list(corpus.vocabulary.words) if "words" in self.conditions else [],
            "multiple": 1,
            "halo": None,
        }

    @property
    def remembered(self):
        """What the file that generates holds besides: first poses of training windows, and every speaker's build."""
        figures = {name: figure.lists() for name, figure in self.corpus.figures.items()}
        return {"starts": self.corpus.starts(self.seed), "figures": figures}

    def example(self):
        """{input: example (1, ...)} of the network at work, given one unit after the other; words in float32."""
        shapes = {
            "mel": (BINS, COLUMNS),
            "wave": (SAMPLES,),
            "s2g_mel": (S2G_COLUMNS, S2G_BINS),
            "words": (FRAMES,),
            "seed": (SEED_FRAMES, self.channels),
            "speaker": (len(self.corpus.speakers),),
        }
        if "speaker" in self.generator.inputs:
            shapes["style"] = (self.settings.style,)
        numbers = torch.Generator().manual_seed(0)
        example = {name: torch.randn(1, *shapes[name], generator=numbers) for name in self.generator.inputs}
        if "words" in example:
            example["words"] = (example["words"].abs() * 10).round().clamp(max=self.corpus.vocabulary.size - 1)
        return example

    def export(self):
        """What is kept: (module in eval mode on the CPU, {input: example (1, ...)}, output names)."""
        return self.generator.cpu().eval(), self.example(), ["poses"]


class AdversarialTask(WindowTask, ABC):
    """A training with a discriminator, which joins after the share `warm_up` of it.

    With `mixed`, the discriminator is given real and generated poses in one batch. Given one after the other, as
    published, its batch norm brings both to the same mean and deviation, so that it cannot tell motion that is too
    small.
    """

    discriminator_loss, generator_loss = staticmethod(discriminator_loss), staticmethod(generator_loss)

    @abstractmethod
    def reconstruct(self, batch):
        """What the discriminator shall judge, (N, T, C), and the other loss terms, unweighted."""

    def iterate(self, step, rng):
        """One update of each network: the discriminator's, and that of HA2G's eq. 9, the weighted sum of all terms."""
        batch, settings = self.batch(rng), self.settings
        poses, terms = self.reconstruct(batch)
        losses = {}
        if settings.weights["adversarial"] and step >= settings.warm_up * settings.steps:
            losses["discriminator"] = self._update_discriminator(batch["poses"], poses.detach())
            terms["adversarial"] = self.generator_loss(
                self.scores(batch["poses"] if settings.mixed else None, poses)[1]
            )
        weighted = {name: settings.weights[name] * term for name, term in terms.items()}
        descend(self, "generator", sum(weighted.values()))
        return losses | {name: term.detach() for name, term in weighted.items()}

    def scores(self, real, generated):
        """What the discriminator says to real (or None: it is not asked) and to generated poses (N, T, C)."""
        discriminator = self.modules["discriminator"]
        if self.settings.mixed:
            return discriminator(torch.cat([real, generated])).chunk(2)
        return None if real is None else discriminator(real), discriminator(generated)

    def _update_discriminator(self, real, generated):
        """One step; `r1` penalises the gradient at real poses (Mescheder et al. 2018), which cuDNN cannot do."""
        r1 = self.settings.r1
        real = real.clone().requires_grad_(r1 > 0)
        with torch.backends.cudnn.flags(enabled=not r1):
            scores, of_generated = self.scores(real, generated)
            loss = total = self.discriminator_loss(scores, of_generated)
            if r1:
                (gradient,) = torch.autograd.grad(scores.sum(), real, create_graph=True)
                total = loss + r1 / 2 * gradient.square().sum((1, 2)).mean()
            descend(self, "discriminator", total)
        return loss.detach()
