"""HA2G (Liu et al. 2022): three levels of audio, blended by a speaker's style, drive a cascade of pose levels.

The preset `paper` is the publication's text, `released` its public code; docs/ha2g_models.md lists where they differ.
Words teach the audio encoder (eq. 2) and, in `released` alone, are heard when generating.
"""

from dataclasses import dataclass, replace

import torch
from torch import nn

from cospeech.gestures.ha2g import losses
from cospeech.gestures.ha2g.dataset.corpus import FRAMES
from cospeech.gestures.ha2g.networks.discriminator import Discriminator
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import FEATURES, LEVELS, SpectrogramEncoder
from cospeech.gestures.ha2g.networks.hierarchical_pose_inferer import HIERARCHIES, Cascade, inferred_levels
from cospeech.gestures.ha2g.networks.style import StyleCoordinator, blend, draw, style_of_speakers
from cospeech.gestures.ha2g.networks.text import TextEncoder
from cospeech.gestures.ha2g.task import AdversarialTask
from cospeech.learning.settings import (
    BETAS,
    COUNT,
    DROPOUT,
    NATURAL,
    POSITIVE,
    SHARE,
    UNPUBLISHED,
    WEIGHT,
    Section,
    counts,
    key,
    one_of,
    settings_of,
    some_of,
)
from cospeech.learning.training import device


@dataclass(frozen=True)
class Settings(Section, section="ha2g"):
    """Of one training; the defaults are the paper's on TED Expressive, as far as it or its logs print them."""

    preset: str = key(
        "paper", "what the keys are that are left out: the text, or the public code", limits=one_of("paper", "released")
    )
    epochs: float = key(180.0, "passes over the windows, unless steps are given", limits=POSITIVE)
    steps: int = key(0, "iterations, if not 0", limits=NATURAL)
    batch: int = key(64, "windows of 34 frames in each iteration", limits=COUNT)
    learning_rate: float = key(5e-4, "of Adam", limits=POSITIVE)
    discriminator_rate: float = key(0.2, "the discriminator's learning rate over the generator's", limits=POSITIVE)
    betas: tuple = key((0.5, 0.999), "of both Adams", limits=BETAS)
    warm_up: float = key(0.1, "share of the training before the discriminator joins", limits=SHARE)
    r1: float = key(
        0.0, "weight of the discriminator's squared gradient at real poses", limits=WEIGHT, published=UNPUBLISHED
    )
    mixed: bool = key(
        False, "give the discriminator real and generated poses in one batch, not apart", published=UNPUBLISHED
    )
    width: float = key(1.0, "factor on all channels", limits=POSITIVE)
    blocks: tuple = key((3, 4, 6, 3), "of the stages of the audio encoder, a ResNetSE34", limits=counts(4))
    layers: int = key(4, "of each GRU, and of the text encoder", limits=COUNT)
    dropout: float = key(0.3, "share of units that are dropped", limits=DROPOUT)
    slope: float = key(0.2, "of the discriminator's LeakyReLU, below zero", limits=WEIGHT)
    style: int = key(18, "numbers of a style vector", limits=COUNT)
    style_input: bool = key(
        True, "whether the generators hear the style, as in the code; eq. 4 prints poses and audio alone"
    )
    coordinator: str = key("linear", "how a style makes the shares of low, mid, high", limits=one_of("linear", "mlp"))
    reblend: bool = key(
        True,
        "whether the random styles of the style diverging loss blend the audio themselves; the code forgets it, so "
        "that the coordinator learns nothing from that loss",
    )
    text: bool = key(True, "whether words are used at all")
    text_input: bool = key(False, "whether the generators hear words")
    text_centred: bool = key(True, "16 words around a frame, or else 31 up to it")
    text_copies: bool = key(False, "whether each generator has a text encoder of its own")
    contrast: str = key(
        "temperature",
        "the contrastive loss: cosine over temperature, or 1 / distance",
        limits=one_of("temperature", "distance"),
    )
    temperature: float = key(0.1, "of the contrastive loss", limits=POSITIVE, published=UNPUBLISHED)
    contrast_frames: int = key(0, "random frames of a batch that it compares; 0 for all", "frames", NATURAL)
    in_level_negatives: bool = key(True, "negatives of other frames and clips (Table 3)")
    cross_level_negatives: bool = key(True, "negatives of low and mid (Table 3)")
    audio_levels: tuple = key(LEVELS, "which levels of audio are blended (Table 3)", limits=some_of(*LEVELS, least=1))
    same_audio: bool = key(False, "the same audio for all pose levels (Table 4)")
    pose_hierarchy: str = key(
        "full",
        "all levels; none: the holistic generator; body: without hand hierarchy; hands: without body hierarchy "
        "(Table 4)",
        limits=one_of(*HIERARCHIES),
    )
    weights: dict = key(
        {
            "huber": 166.7,
            "adversarial": 5.0,
            "divergence": 0.1,
            "diverging": 0.05,
            "physical": 0.01,
            "contrastive": 0.2,
        },
        "of the loss terms",
        limits=WEIGHT,
        parts={
            "huber": "Huber loss of every pose level",
            "adversarial": "what the discriminator says",
            "divergence": "Kullback-Leibler divergence of the styles",
            "diverging": "style diverging loss",
            "physical": "how likely the angles between bones are",
            "contrastive": "contrastive loss of audio and words; not published, the code's",
        },
    )


RELEASED = {
    "epochs": 100.0,
    "batch": 96,
    "slope": 0.01,
    "style": 16,
    "coordinator": "mlp",
    "reblend": False,
    "text_input": True,
    "text_centred": False,
    "text_copies": True,
    "contrast": "distance",
}
# (batch, epochs, weight of Huber) where a level table has others than those above: of the logs behind the paper's
# numbers, and of the code's newest configuration.
OF_TABLE = {
    ("paper", "ted10"): (128, 100.0, 70.0),
    ("released", "ted10"): (256, 100.0, 70.0),
    ("released", "expressive43"): (96, 100.0, 250.0),
}


def published(preset, table):
    """The `Settings` of a preset, "paper" or "released", for a level table by name."""
    settings = replace(Settings(), preset=preset, **(RELEASED if preset == "released" else {}))
    if (preset, table) in OF_TABLE:
        batch, epochs, huber = OF_TABLE[preset, table]
        settings = replace(settings, batch=batch, epochs=epochs, weights={**settings.weights, "huber": huber})
    return settings


class HA2G(nn.Module):
    """Eq. 1: speech and four seed poses -> poses (N, 34, 3V), unit bone vectors minus the training mean."""

    def __init__(self, corpus, settings):
        super().__init__()
        s, table = settings, corpus.levels
        levels = inferred_levels(table, s.pose_hierarchy)
        self.inputs = ("mel", "seed", "speaker", "style", *(["words"] if s.text_input else []))
        self.style_input = s.style_input
        self.audio = SpectrogramEncoder(s.blocks, s.width)
        self.style = style_of_speakers(corpus, s.style, s.width)
        named = 0 if corpus.references else len(corpus.speakers)
        self.coordinator = StyleCoordinator(s.coordinator, named, s.style, len(levels), s.audio_levels, s.same_audio)
        encoders = 1 + len(levels) * (s.text_input and s.text_copies) if s.text else 0
        self.texts = nn.ModuleList(
            TextEncoder(corpus.vocabulary, s.width, s.layers, s.text_centred, s.dropout) for _ in range(encoders)
        )
        conditions = FEATURES + s.style * s.style_input + FEATURES * s.text_input
        channels = [table.channels(level) for level in levels]
        self.cascade = Cascade(channels, conditions, s.width, s.layers, s.dropout)

    def text_features(self, words):
        """Features of words (N, T) for the generators: one for each level, from its own encoder or from the one."""
        copies = self.texts[1:] if len(self.texts) > 1 else self.texts
        features = [encoder(words) for encoder in copies]
        return features * len(self.cascade.levels) if len(copies) == 1 else features

    def infer(self, features, shares, style, seed, texts=None):
        """Audio features (N, 3, T, 32), shares (N, L, 3), style (N, Z), seed (N, 4, C) -> poses of every level."""
        conditions = []
        for level, audio in enumerate(blend(shares, features).unbind(1)):
            parts = [audio]
            if self.style_input:
                parts.append(style[:, None].expand(-1, audio.shape[1], -1))
            if texts is not None:
                parts.append(texts[level])
            conditions.append(torch.cat(parts, dim=2))
        return self.cascade(seed, conditions)

    def forward(self, mel, seed, speaker, style, words=None):
        """mel (N, 128, 70) dB, seed (N, 4, 3V), speaker weights (N, S), style (N, Z) added to theirs, words (N, 34)."""
        style = self.style(speaker)[0] + style
        texts = None if words is None else self.text_features(words.long())
        return self.infer(self.audio(mel), self.coordinator(speaker, style), style, seed, texts)[-1]


class HA2GTask(AdversarialTask):
    """Training of HA2G, for `learning.training.train`: all of it in one optimiser, the discriminator in another."""

    model, defaults = "ha2g", Settings()

    @classmethod
    def settings_of(cls, mapping, corpus):
        """`Settings` of a budget's section: those of its `preset`, with its other keys."""
        settings = settings_of(published(mapping.get("preset", "paper"), corpus.levels.name), mapping, "ha2g")
        if settings.text_input and not settings.text:
            settings = replace(settings, text_input=False)
        return settings

    def __init__(self, corpus, settings, seed):
        super().__init__(corpus, settings, seed)
        s = self.settings
        self.conditions = ("mel", "speaker", *(["words"] if s.text else []))
        self.generator = self.add("generator", HA2G(corpus, s), s.learning_rate, s.betas)
        if s.weights["adversarial"]:
            discriminator = Discriminator(self.channels, FRAMES, s.slope, s.width, s.layers, s.dropout)
            self.add("discriminator", discriminator, s.discriminator_rate * s.learning_rate, s.betas)
        tensor = lambda array: torch.as_tensor(array, dtype=torch.float32, device=device())
        self.mean = tensor(corpus.mean)
        self.angles = [tensor(array) for array in corpus.angle_statistics()]

    @property
    def description(self):
        """What whoever generates has to know; `picture` is the side of the reference frames, where there are some."""
        pictures = next(iter(self.corpus.references.values()), None)
        return super().description | ({} if pictures is None else {"picture": pictures.shape[1]})

    def reconstruct(self, batch):
        """Whole poses (N, T, C) and the terms of eq. 9, unweighted, but for the adversarial one."""
        network, weights = self.generator, self.settings.weights
        features = network.audio(batch["mel"])
        mean, log_variance = network.style(batch["speaker"])
        style = draw(mean, log_variance)
        shares = network.coordinator(batch["speaker"], style)
        texts = network.text_features(batch["words"]) if self.settings.text_input else None
        levels = network.infer(features, shares, style, batch["seed"], texts)
        targets = [network.cascade.of_level(level, batch["poses"]) for level in range(len(levels))]
        terms = {"huber": losses.huber(levels, targets), "divergence": losses.divergence(mean, log_variance)}
        if weights["contrastive"] and self.settings.text:
            terms["contrastive"] = self._contrast(batch["words"], features)
        if weights["diverging"]:
            others, other = self._with_another_style(batch, features, shares, texts)
            terms["diverging"] = losses.diverging(levels[-1], others, style, other)
        if weights["physical"]:
            vectors = (levels[-1] + self.mean).unflatten(2, (-1, 3))
            terms["physical"] = losses.physical(losses.included_angles(vectors, self.corpus.levels), *self.angles)
        return levels[-1], terms

    @torch.no_grad()
    def _with_another_style(self, batch, features, shares, texts):
        """Poses and style vector when a random speaker says the same."""
        network = self.generator
        speaker = self.weights_of(torch.randint(len(self.corpus.speakers), (len(shares),), device=shares.device))
        style = draw(*network.style(speaker))
        if self.settings.reblend:
            shares = network.coordinator(speaker, style)
        return network.infer(features, shares, style, batch["seed"], texts)[-1], style

    def _contrast(self, words, features):
        """Eq. 2 on the frames of the batch, or on some of them."""
        s = self.settings
        text = self.generator.texts[0](words).flatten(0, 1)
        features = features.transpose(0, 1).flatten(1, 2)
        if 0 < s.contrast_frames < len(text):
            chosen = torch.randperm(len(text), device=text.device)[: s.contrast_frames]
            text, features = text[chosen], features[:, chosen]
        if s.contrast == "distance":
            return losses.contrastive_by_distance(text, features)
        return losses.contrastive(text, features, s.temperature, s.in_level_negatives, s.cross_level_negatives)
