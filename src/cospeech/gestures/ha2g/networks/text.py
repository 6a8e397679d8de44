"""The encoder of words: a temporal convolutional network (Bai et al. 2018) over one word or padding per frame."""

from torch import nn
from torch.nn import functional as F
from torch.nn.utils.parametrizations import weight_norm

from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import FEATURES, scaled

EMBEDDING = 300  # size of a word vector
CHANNELS = 300


def word_embedding(vocabulary):
    """The table of word vectors, fine-tuned: those of the vocabulary where it has some, else drawn at random."""
    embedding = nn.Embedding(vocabulary.size, EMBEDDING, padding_idx=0)
    if vocabulary.vectors is not None:
        embedding.weight.data.copy_(embedding.weight.new_tensor(vocabulary.vectors))
    return embedding


class TemporalBlock(nn.Module):
    """Dilated convolutions of kernel 2, ReLU, dropout, + input, ReLU: (N, C, T) -> the same T.

    Causal blocks see the past alone; others are centred.
    """

    def __init__(self, channels_in, channels, dilation, convolutions, causal, dropout):
        super().__init__()
        before = dilation if causal else dilation // 2
        layers = []
        for i in range(convolutions):
            convolution = nn.Conv1d(channels if i else channels_in, channels, 2, dilation=dilation)
            nn.init.normal_(convolution.weight, 0, 0.01)
            layers += [nn.ConstantPad1d((before, dilation - before), 0.0), weight_norm(convolution)]
            layers += [nn.ReLU(), nn.Dropout(dropout)]
        self.body = nn.Sequential(*layers)
        self.skip = nn.Conv1d(channels_in, channels, 1) if channels_in != channels else nn.Identity()

    def forward(self, x):
        return F.relu(self.body(x) + self.skip(x))


class TextEncoder(nn.Module):
    """Word numbers (N, T), 0 where no word begins -> features (N, T, 32).

    centred : HA2G's text, one convolution a block, 16 words around each frame; otherwise the released code's (and
    Trimodal's), two a block, the 31 words up to each frame.
    """

    def __init__(self, vocabulary, width=1.0, layers=4, centred=False, dropout=0.3, embedding_dropout=0.1):
        super().__init__()
        self.embedding = word_embedding(vocabulary)
        self.dropout = nn.Dropout(embedding_dropout)
        channels = scaled(CHANNELS, width)
        self.blocks = nn.Sequential(
            *(
                TemporalBlock(channels if i else EMBEDDING, channels, 2**i, 1 if centred else 2, not centred, dropout)
                for i in range(layers)
            )
        )
        self.linear = nn.Linear(channels, FEATURES)

    def forward(self, words):
        x = self.dropout(self.embedding(words)).transpose(1, 2)
        return self.linear(self.blocks(x).transpose(1, 2))
