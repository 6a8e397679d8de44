"""Joint Embedding (Ahuja and Morency 2019) as ported for Trimodal's comparison: speech and poses into one vector.

Half of the windows are drawn from speech, half from the poses themselves, by one decoder; no term aligns the two
embeddings, as in the port (the original does not align them either).
"""

from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.gestures.ha2g.dataset.corpus import FRAMES, SEED_FRAMES
from cospeech.gestures.ha2g.networks.gru import GRU
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import FEATURES, WaveEncoder, scaled
from cospeech.gestures.ha2g.networks.hierarchical_pose_inferer import HIDDEN
from cospeech.gestures.ha2g.networks.text import TextEncoder
from cospeech.gestures.ha2g.task import WindowTask
from cospeech.learning.settings import COUNT, DROPOUT, NATURAL, POSITIVE, Section, key
from cospeech.learning.training import descend

EMBEDDED = 32  # numbers of the joint embedding
CONVOLVED = FRAMES // 2 - 5  # frames left by the pose encoder's convolutions: two of kernel 3, a stride of 2, one of 3


@dataclass(frozen=True)
class Settings(Section, section="joint_embedding"):
    """Of one training; the defaults are the port's."""

    epochs: float = key(100.0, "passes over the windows, unless steps are given", limits=POSITIVE)
    steps: int = key(0, "iterations, if not 0", limits=NATURAL)
    batch: int = key(128, "windows of 34 frames in each iteration", limits=COUNT)
    learning_rate: float = key(5e-4, "of Adam", limits=POSITIVE)
    width: float = key(1.0, "factor on all channels", limits=POSITIVE)
    layers: int = key(4, "of the decoder's GRU", limits=COUNT)
    dropout: float = key(0.3, "share of units that are dropped", limits=DROPOUT)


class PoseEncoder(nn.Module):
    """Poses (N, 34, C) -> (N, 32)."""

    def __init__(self, channels):
        super().__init__()
        layers, sizes = [], (channels, 32, 64, 64)
        for i, (kernel, stride) in enumerate([(3, 1), (3, 1), (4, 2)]):
            layers += [nn.Conv1d(sizes[i], sizes[i + 1], kernel, stride), nn.BatchNorm1d(sizes[i + 1])]
            layers += [nn.LeakyReLU(0.2)]
        self.body = nn.Sequential(
            *layers,
            nn.Conv1d(64, 32, 3),
            nn.Flatten(),
            nn.Linear(32 * CONVOLVED, 256),
            nn.BatchNorm1d(256),
            nn.LeakyReLU(0.2),
            nn.Linear(256, 128),
            nn.BatchNorm1d(128),
            nn.LeakyReLU(0.2),
            nn.Linear(128, EMBEDDED),
        )

    def forward(self, poses):
        return self.body(poses.transpose(1, 2))


class SpeechEncoder(nn.Module):
    """Wave (N, 36267) and words (N, 34) -> (N, 32), the last state of a GRU on both."""

    def __init__(self, vocabulary, width, dropout):
        super().__init__()
        hidden = scaled(256, width)
        self.audio = WaveEncoder(width)
        self.text = TextEncoder(vocabulary, width, dropout=dropout)
        self.gru = GRU(2 * FEATURES, hidden, 2, dropout, bidirectional=False)
        self.head = nn.Sequential(
            nn.Linear(hidden, 128), nn.BatchNorm1d(128), nn.LeakyReLU(0.2), nn.Linear(128, EMBEDDED)
        )

    def forward(self, wave, words):
        return self.head(self.gru(torch.cat([self.audio(wave), self.text(words)], dim=2))[:, -1])


class JointEmbedding(nn.Module):
    """Wave, words and four seed poses -> poses (N, 34, 3V)."""

    inputs = ("wave", "words", "seed")

    def __init__(self, corpus, settings):
        super().__init__()
        s, channels = settings, 3 * corpus.levels.vectors
        hidden = scaled(HIDDEN, s.width, 2)
        self.speech = SpeechEncoder(corpus.vocabulary, s.width, s.dropout)
        self.poses = PoseEncoder(channels)
        self.start = nn.Sequential(
            nn.Flatten(), nn.Linear(SEED_FRAMES * channels, 32), nn.BatchNorm1d(32), nn.ReLU(), nn.Linear(32, 32)
        )
        self.gru = GRU(32 + EMBEDDED, hidden, s.layers, s.dropout)
        self.head = nn.Sequential(nn.Linear(hidden, hidden // 2), nn.LeakyReLU(0.2), nn.Linear(hidden // 2, channels))

    def decode(self, embedded, seed):
        """embedded (N, 32), seed (N, 4, C) -> poses (N, 34, C)."""
        x = torch.cat([self.start(seed), embedded], dim=1)
        return self.head(self.gru(x[:, None].expand(-1, FRAMES, -1)))

    def forward(self, wave, words, seed):
        """wave (N, 36267), words (N, 34), seed (N, 4, 3V)."""
        return self.decode(self.speech(wave, words.long()), seed)


class JointEmbeddingTask(WindowTask):
    """Training of Joint Embedding, for `learning.training.train`: every iteration from speech or from poses."""

    model, defaults = "joint_embedding", Settings()
    conditions = ("wave", "words")

    def __init__(self, corpus, settings, seed):
        super().__init__(corpus, settings, seed)
        self.generator = self.add("generator", JointEmbedding(corpus, self.settings), self.settings.learning_rate)

    def iterate(self, step, rng):
        batch, network = self.batch(rng), self.generator
        source = "speech" if rng.random() < 0.5 else "poses"
        if source == "speech":
            embedded = network.speech(batch["wave"], batch["words"])
        else:
            embedded = network.poses(batch["poses"])
        loss = F.l1_loss(network.decode(embedded, batch["seed"]), batch["poses"])
        descend(self, "generator", loss)
        return {f"from_{source}": loss.detach()}
