"""Who speaks: a distribution of style vectors for every speaker, and how each blends the levels of audio (eq. 3).

A speaker is given by weights (N, S) over the speakers of the training: one of them, a mixture by name and weight, or
none at all (zeros), to which a style vector drawn from a normal distribution is added. What tells the speakers apart is
an embedding of each (as released), or what they look like (as published).
"""

import torch
from torch import nn

from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import LEVELS
from cospeech.gestures.ha2g.networks.identity import IdentityEncoder

PICTURES = 4  # reference frames of a speaker that are encoded in an iteration: as many as a window's seed poses


class SpeakerStyle(nn.Module):
    """Speaker weights (N, S) -> mean and log variance of the style vector, (N, size) each."""

    def __init__(self, speakers, size):
        super().__init__()
        self.embedding = nn.Embedding(speakers, size)
        self.linear = nn.Linear(size, size)
        self.mean = nn.Linear(size, size)
        self.log_variance = nn.Linear(size, size)

    def forward(self, weights):
        x = self.linear(weights @ self.embedding.weight)
        # Without a speaker the mean is that of the prior, 0, and a drawn style vector alone decides.
        return self.mean(x) * weights.sum(1, keepdim=True), self.log_variance(x)


class FrameStyle(nn.Module):
    """`SpeakerStyle` by reference frames: weights (N, S) -> mean and log variance of the style vector, (N, size) each.

    While it is trained, it looks at a few random frames of each speaker that has a weight. From `eval()` on a speaker
    is the mean over all their frames; that is kept with the weights, the pictures are not.
    references : of S speakers, (K, side, side, 3) uint8 each. width : factor on the encoder's channels.
    """

    def __init__(self, references, size, width=1.0):
        super().__init__()
        self.encoder = IdentityEncoder(references[0].shape[1], size, width)
        self.pictures = [torch.from_numpy(pictures).permute(0, 3, 1, 2) for pictures in references]  # no buffers
        self.register_buffer("means", torch.zeros(len(references), size))
        self.register_buffer("log_variances", torch.zeros(len(references), size))

    def forward(self, weights):
        if not self.training:
            return weights @ self.means, weights @ self.log_variances
        asked = weights.any(0).nonzero()[:, 0]
        drawn = [self.pictures[i][torch.randint(len(self.pictures[i]), (PICTURES,))] for i in asked.tolist()]
        encoded = self.encoder(torch.cat(drawn).to(weights))
        mean, log_variance = (of_frames.unflatten(0, (-1, PICTURES)).mean(1) for of_frames in encoded)
        return weights[:, asked] @ mean, weights[:, asked] @ log_variance

    def train(self, mode=True):
        super().train(mode)
        if not mode:
            with torch.no_grad():
                for speaker, pictures in enumerate(self.pictures):
                    encoded = self.encoder(pictures.to(self.means))
                    self.means[speaker], self.log_variances[speaker] = (of_frames.mean(0) for of_frames in encoded)
        return self


def style_of_speakers(corpus, size, width):
    """What tells the speakers of a `Corpus` apart: their reference frames if it has them, else an embedding of each."""
    if corpus.references:
        return FrameStyle([corpus.references[name] for name in corpus.speakers], size, width)
    return SpeakerStyle(len(corpus.speakers), size)


def draw(mean, log_variance):
    """A style vector from its distribution, differentiable in both."""
    return mean + torch.exp(log_variance / 2) * torch.randn_like(mean)


class StyleCoordinator(nn.Module):
    """Shares of low, mid and high audio at every pose level, (N, levels, 3); each level's sum to one.

    form : "linear", the paper's FC(18, 18) on the style vector (for six levels); "mlp", the released code's, which has
        an embedding of the speakers to itself: 16, 16, 32, 3 x levels with ELU.
    speakers : how many have an embedding; 0 for none, where pictures tell them apart: "mlp" then gets the style vector.
    audio_levels : those of `LEVELS` that may have a share (Table 3); same : one blend for all levels (Table 4).
    """

    def __init__(self, form, speakers, size, levels, audio_levels=LEVELS, same=False):
        super().__init__()
        self.levels, self.columns = levels, 1 if same else levels
        count = len(LEVELS) * self.columns
        self.embedding = None
        if form == "mlp":
            self.embedding = nn.Embedding(speakers, 16) if speakers else None
            self.body = nn.Sequential(
                nn.Linear(16 if speakers else size, 16), nn.ELU(), nn.Linear(16, 32), nn.ELU(), nn.Linear(32, count)
            )
        else:
            self.body = nn.Linear(size, count)
        barred = [0.0 if level in audio_levels else -torch.inf for level in LEVELS]
        self.register_buffer("barred", torch.tensor(barred))

    def forward(self, weights, style):
        x = self.body(style if self.embedding is None else weights @ self.embedding.weight)
        shares = torch.softmax(x.unflatten(1, (self.columns, len(LEVELS))) + self.barred, dim=2)
        return shares.expand(-1, self.levels, -1)


def blend(shares, features):
    """Eq. 3: shares (N, L, 3), features (N, 3, T, 32) -> (N, L, T, 32)."""
    return torch.einsum("nlk,nktc->nltc", shares, features)
