"""Trimodal (Yoon et al. 2020): words, wave and speaker drive one bidirectional GRU, with a discriminator of poses.

It is the cascade of `hierarchical_pose_inferer` with one level, other ears and other weights (Yoon et al. 2020).
"""

from dataclasses import dataclass

import torch
from torch import nn

from cospeech.gestures.ha2g import losses
from cospeech.gestures.ha2g.dataset.corpus import FRAMES
from cospeech.gestures.ha2g.networks.discriminator import Discriminator
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import FEATURES, WaveEncoder
from cospeech.gestures.ha2g.networks.hierarchical_pose_inferer import Cascade, inferred_levels
from cospeech.gestures.ha2g.networks.style import SpeakerStyle, draw
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
    key,
)


@dataclass(frozen=True)
class Settings(Section, section="trimodal"):
    """Of one training; the defaults are published."""

    epochs: float = key(100.0, "passes over the windows, unless steps are given", limits=POSITIVE)
    steps: int = key(0, "iterations, if not 0", limits=NATURAL)
    batch: int = key(128, "windows of 34 frames in each iteration", limits=COUNT)
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
    layers: int = key(4, "of each GRU, and of the text encoder", limits=COUNT)
    dropout: float = key(0.3, "share of units that are dropped", limits=DROPOUT)
    slope: float = key(0.2, "of the discriminator's LeakyReLU, below zero", limits=WEIGHT)
    style: int = key(16, "numbers of a style vector", limits=COUNT)
    weights: dict = key(
        {"huber": 500.0, "adversarial": 5.0, "divergence": 0.1, "diverging": 0.05},
        "of the loss terms",
        limits=WEIGHT,
        parts={
            "huber": "Huber loss",
            "adversarial": "what the discriminator says",
            "divergence": "Kullback-Leibler divergence of the styles",
            "diverging": "style diverging loss",
        },
    )


class Trimodal(nn.Module):
    """Wave, words, speaker and four seed poses -> poses (N, 34, 3V)."""

    inputs = ("wave", "words", "seed", "speaker", "style")

    def __init__(self, corpus, settings):
        super().__init__()
        s, table = settings, corpus.levels
        self.audio = WaveEncoder(s.width)
        self.text = TextEncoder(corpus.vocabulary, s.width, s.layers, dropout=s.dropout)
        self.style = SpeakerStyle(len(corpus.speakers), s.style)
        channels = [table.channels(level) for level in inferred_levels(table, "none")]
        self.cascade = Cascade(channels, 2 * FEATURES + s.style, s.width, s.layers, s.dropout)

    def infer(self, features, style, seed):
        """features (N, T, 64) of wave and words, style (N, Z), seed (N, 4, C) -> poses (N, T, C)."""
        return self.cascade(seed, [torch.cat([features, style[:, None].expand(-1, features.shape[1], -1)], dim=2)])[0]

    def encode(self, wave, words):
        return torch.cat([self.audio(wave), self.text(words)], dim=2)

    def forward(self, wave, words, seed, speaker, style):
        """wave (N, 36267), words (N, 34), seed (N, 4, 3V), speaker weights (N, S), style (N, Z) added to theirs."""
        return self.infer(self.encode(wave, words.long()), self.style(speaker)[0] + style, seed)


class TrimodalTask(AdversarialTask):
    """Training of Trimodal, for `cospeech.learning.training.train`."""

    model, defaults = "trimodal", Settings()
    conditions = ("wave", "words", "speaker")

    def __init__(self, corpus, settings, seed):
        super().__init__(corpus, settings, seed)
        s = self.settings
        self.generator = self.add("generator", Trimodal(corpus, s), s.learning_rate, s.betas)
        if s.weights["adversarial"]:
            discriminator = Discriminator(self.channels, FRAMES, s.slope, s.width, s.layers, s.dropout)
            self.add("discriminator", discriminator, s.discriminator_rate * s.learning_rate, s.betas)

    def reconstruct(self, batch):
        network = self.generator
        mean, log_variance = network.style(batch["speaker"])
        style = draw(mean, log_variance)
        features = network.encode(batch["wave"], batch["words"])
        poses = network.infer(features, style, batch["seed"])
        terms = {"huber": losses.huber([poses], [batch["poses"]]), "divergence": losses.divergence(mean, log_variance)}
        if self.settings.weights["diverging"]:
            with torch.no_grad():
                speaker = torch.randint(len(self.corpus.speakers), (len(poses),), device=poses.device)
                other = draw(*network.style(self.weights_of(speaker)))
                others = network.infer(features, other, batch["seed"])
            terms["diverging"] = losses.diverging(poses, others, style, other)
        return poses, terms
