"""The discriminator of Trimodal and HA2G (Table 8): real or generated, from the poses alone."""

from torch import nn

from cospeech.gestures.ha2g.networks.gru import GRU
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import scaled

UNPADDED = 6  # frames that its three convolutions eat


class Discriminator(nn.Module):
    """Table 8: poses (N, T, C) -> scores (N,); their sigmoid, which is in the losses, is the probability of being real.

    slope : of LeakyReLU, 0.2 in the paper and torch's default 0.01 in the released code.
    """

    def __init__(self, channels, frames, slope=0.2, width=1.0, layers=4, dropout=0.3):
        super().__init__()
        self.convolutions = nn.Sequential(
            nn.Conv1d(channels, 16, 3),
            nn.BatchNorm1d(16),
            nn.LeakyReLU(slope),
            nn.Conv1d(16, 8, 3),
            nn.BatchNorm1d(8),
            nn.LeakyReLU(slope),
            nn.Conv1d(8, 8, 3),
        )
        hidden = scaled(64, width)
        self.gru = GRU(8, hidden, layers, dropout, twice=True)  # by the penalty `r1`
        self.frame = nn.Linear(hidden, 1)
        self.window = nn.Linear(frames - UNPADDED, 1)

    def forward(self, poses):
        x = self.gru(self.convolutions(poses.transpose(1, 2)).transpose(1, 2))
        return self.window(self.frame(x).squeeze(2)).squeeze(1)
