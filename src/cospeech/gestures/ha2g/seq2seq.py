"""Seq2Seq with attention (Yoon et al. 2019): from words to poses, one after the other."""

from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.gestures.ha2g.dataset.corpus import FRAMES
from cospeech.gestures.ha2g.networks.gru import GRU
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import scaled
from cospeech.gestures.ha2g.networks.text import EMBEDDING, word_embedding
from cospeech.gestures.ha2g.task import WindowTask
from cospeech.learning.settings import COUNT, DROPOUT, NATURAL, POSITIVE, WEIGHT, Section, key

HIDDEN = 200


@dataclass(frozen=True)
class Settings(Section, section="seq2seq"):
    """Of one training; the defaults are those of HA2G's and Trimodal's comparisons."""

    epochs: float = key(100.0, "passes over the windows, unless steps are given", limits=POSITIVE)
    steps: int = key(0, "iterations, if not 0", limits=NATURAL)
    batch: int = key(128, "windows of 34 frames in each iteration", limits=COUNT)
    learning_rate: float = key(1e-4, "of Adam", limits=POSITIVE)
    clip: float = key(5.0, "largest norm of the gradient", limits=POSITIVE)
    width: float = key(1.0, "factor on all channels", limits=POSITIVE)
    layers: int = key(2, "of each GRU", limits=COUNT)
    dropout: float = key(0.1, "share of units that are dropped", limits=DROPOUT)
    weights: dict = key(
        {"error": 250.0, "change": 0.1, "variety": 25.0},
        "of the loss terms",
        limits=WEIGHT,
        parts={
            "error": "squared error",
            "change": "mean change from frame to frame",
            "variety": "how far poses are from the mean",
        },
    )


class Seq2Seq(nn.Module):
    """Words and four seed poses -> poses (N, 34, 3V). Words stand at the frames where they begin."""

    inputs = ("words", "seed")

    def __init__(self, corpus, settings):
        super().__init__()
        s, channels = settings, 3 * corpus.levels.vectors
        hidden = scaled(HIDDEN, s.width)
        self.embedding = word_embedding(corpus.vocabulary)
        self.encoder = GRU(EMBEDDING, hidden, s.layers, s.dropout)
        self.query, self.key = nn.Linear(hidden, hidden), nn.Linear(hidden, hidden, bias=False)
        self.energy = nn.Linear(hidden, 1, bias=False)
        self.before = nn.Sequential(nn.Linear(channels + hidden, hidden), nn.BatchNorm1d(hidden), nn.ReLU())
        self.cells = nn.ModuleList(nn.GRUCell(hidden, hidden) for _ in range(s.layers))
        self.dropout = nn.Dropout(s.dropout)
        self.head = nn.Linear(hidden, channels)

    def attend(self, state, memory, keys):
        """Bahdanau et al. 2015: state (N, H), memory and its keys (N, T, H) -> what is looked at, (N, H)."""
        energies = self.energy(torch.tanh(self.query(state)[:, None] + keys))
        return (torch.softmax(energies, dim=1) * memory).sum(1)

    def forward(self, words, seed):
        """words (N, 34), seed (N, 4, 3V)."""
        memory = self.encoder(self.embedding(words.long()))
        keys = self.key(memory)
        states = [memory[:, 0]] * len(self.cells)
        pose, poses = seed[:, 0], [seed[:, 0]]
        for frame in range(1, FRAMES):  # every pose needs the one before it, and attention the state that made it
            x = self.before(torch.cat([pose, self.attend(states[-1], memory, keys)], dim=1))
            states = list(states)
            for layer, cell in enumerate(self.cells):
                states[layer] = cell(x if layer == 0 else self.dropout(states[layer - 1]), states[layer])
            poses.append(self.head(states[-1]))
            pose = seed[:, frame] if frame < seed.shape[1] else poses[-1]
        return torch.stack(poses, dim=1)


def terms_of(poses, real):
    """The three losses, unweighted: mean squared error; mean change; minus each channel's norm over time per number."""
    return {
        "error": F.mse_loss(poses, real),
        "change": poses.diff(dim=1).abs().sum() / poses.numel(),
        "variety": -torch.linalg.vector_norm(poses, dim=1).sum() / poses.numel(),
    }


class Seq2SeqTask(WindowTask):
    """Training of Seq2Seq, for `cospeech.learning.training.train`."""

    model, defaults = "seq2seq", Settings()
    conditions = ("words",)

    def __init__(self, corpus, settings, seed):
        super().__init__(corpus, settings, seed)
        self.generator = self.add("generator", Seq2Seq(corpus, self.settings), self.settings.learning_rate)

    def iterate(self, step, rng):
        batch = self.batch(rng)
        terms = terms_of(self.generator(batch["words"], batch["seed"]), batch["poses"])
        weighted = {name: self.settings.weights[name] * term for name, term in terms.items()}
        optimizer = self.optimizers["generator"]
        optimizer.zero_grad(set_to_none=True)
        sum(weighted.values()).backward()
        nn.utils.clip_grad_norm_(self.generator.parameters(), self.settings.clip)
        optimizer.step()
        return {name: term.detach() for name, term in weighted.items()}
