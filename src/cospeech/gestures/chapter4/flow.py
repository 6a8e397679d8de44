"""A conditional normalising flow over time (MoGlow, Henter et al. 2020; Alexanderson et al. 2020): exact likelihood.

Every frame x_t (D,) becomes Gaussian noise z_t (D,) through K steps, each an activation normalisation, an invertible
linear mix of the channels and an affine coupling, whose shift and scale an LSTM remembers over time from half of the
channels and a condition c_t. Training sees whole sequences at once; sampling goes frame by frame through the inverses.
"""

import math

import torch
from torch import nn
from torch.nn import functional as F

LAYERS = 2  # of the LSTM of a coupling
FACTOR = 3.0  # by which scales are stored smaller, so that they learn faster (Glow, Kingma and Dhariwal 2018)


class ActNorm(nn.Module):
    """(x + bias) * exp(FACTOR * log_scale) per channel; `fit` makes a first batch zero-mean with deviation one."""

    def __init__(self, channels):
        super().__init__()
        self.bias, self.log_scale = nn.Parameter(torch.zeros(channels)), nn.Parameter(torch.zeros(channels))

    def fit(self, x):
        """Set both from x (B, T, D)."""
        with torch.no_grad():
            self.bias.copy_(-x.mean((0, 1)))
            self.log_scale.copy_(-x.std((0, 1)).clamp_min(1e-4).log() / FACTOR)

    def forward(self, x):
        scale = FACTOR * self.log_scale
        return (x + self.bias) * scale.exp(), scale.sum()

    def inverse(self, y):
        return y * (-FACTOR * self.log_scale).exp() - self.bias


class InvertibleLinear(nn.Module):
    """x W^T with W = P L (U + diag(sign * exp(log_diagonal))): a random rotation at first, cheap determinant always."""

    def __init__(self, channels):
        super().__init__()
        rotation, _ = torch.linalg.qr(torch.randn(channels, channels))
        permutation, lower, upper = torch.linalg.lu(rotation)
        diagonal = upper.diagonal()
        self.register_buffer("permutation", permutation)
        self.register_buffer("sign", diagonal.sign())
        self.lower, self.upper = nn.Parameter(lower), nn.Parameter(upper)
        self.log_diagonal = nn.Parameter(diagonal.abs().log())
        self.register_buffer("unit", torch.eye(channels))

    def _factors(self):
        lower = self.lower.tril(-1) + self.unit
        return lower, self.upper.triu(1) + torch.diag(self.sign * self.log_diagonal.exp())

    def forward(self, x):
        lower, upper = self._factors()
        return x @ (self.permutation @ lower @ upper).T, self.log_diagonal.sum()

    def inverse_matrix(self):
        """W^-1 by two triangular solves."""
        lower, upper = self._factors()
        below = torch.linalg.solve_triangular(lower, self.permutation.T, upper=False, unitriangular=True)
        return torch.linalg.solve_triangular(upper, below, upper=True)


class Coupling(nn.Module):
    """(x_b + shift) * scale where shift and scale = sigmoid(s + 2) follow from x_a and the condition through an LSTM.

    The last layer starts at zero, so that the flow starts as a linear map.
    """

    def __init__(self, channels, condition, hidden):
        super().__init__()
        self.kept = channels // 2
        sizes = [self.kept + condition] + [hidden] * (LAYERS - 1)
        self.cells = nn.ModuleList(nn.LSTMCell(size, hidden) for size in sizes)
        self.head = nn.Linear(hidden, 2 * (channels - self.kept))
        nn.init.zeros_(self.head.weight), nn.init.zeros_(self.head.bias)

    def _shift_and_log_scale(self, remembered):
        shift, scale = self.head(remembered).chunk(2, dim=-1)
        return shift, F.logsigmoid(scale + 2)

    def forward(self, x, condition):
        kept, moved = x[..., : self.kept], x[..., self.kept :]
        empty = x.new_zeros(LAYERS, len(x), self.cells[0].hidden_size)
        weights = [w for cell in self.cells for w in (cell.weight_ih, cell.weight_hh, cell.bias_ih, cell.bias_hh)]
        # The cells, over all frames at once: has_biases, layers, dropout, train, bidirectional, batch_first.
        remembered = torch.lstm(
            torch.cat([kept, condition], dim=-1), (empty, empty), weights, True, LAYERS, 0.0, self.training, False, True
        )[0]
        shift, log_scale = self._shift_and_log_scale(remembered)
        return torch.cat([kept, (moved + shift) * log_scale.exp()], dim=-1), log_scale.sum(-1)

    def inverse_step(self, y, condition, state):
        """One frame back: y (B, D), condition (B, C), state of the LSTM (2 * LAYERS, B, H) -> x (B, D), new state."""
        kept, moved = y[..., : self.kept], y[..., self.kept :]
        below, states = torch.cat([kept, condition], dim=-1), []
        for layer, cell in enumerate(self.cells):
            below, memory = cell(below, (state[2 * layer], state[2 * layer + 1]))
            states += [below, memory]
        shift, log_scale = self._shift_and_log_scale(below)
        return torch.cat([kept, moved * (-log_scale).exp() - shift], dim=-1), torch.stack(states)


class Flow(nn.Module):
    """K steps of the above. x (B, T, D) and condition (B, T, C) -> z (B, T, D), log |det dz/dx| (B, T)."""

    def __init__(self, channels, condition, hidden, steps):
        super().__init__()
        self.norms = nn.ModuleList(ActNorm(channels) for _ in range(steps))
        self.mixes = nn.ModuleList(InvertibleLinear(channels) for _ in range(steps))
        self.couplings = nn.ModuleList(Coupling(channels, condition, hidden) for _ in range(steps))

    def forward(self, x, condition, fit=False):
        total = x.new_zeros(x.shape[:2])
        for norm, mix, coupling in zip(self.norms, self.mixes, self.couplings, strict=True):
            if fit:
                norm.fit(x)
            for layer in (norm, mix, lambda y, coupling=coupling: coupling(y, condition)):
                x, change = layer(x)
                total = total + change
        return x, total

    def log_likelihood(self, x, condition):
        """log p(x_t | condition, past), (B, T) in nats, by the change of variables."""
        z, change = self(x, condition)
        return -0.5 * (z.square() + math.log(2 * math.pi)).sum(-1) + change

    def inverse_step(self, z, condition, states, inverses):
        """One frame from noise: z (B, D), states (K, 2 * LAYERS, B, H), inverses (K, D, D) of the mixes.

        Returns x (B, D) and the new states.
        """
        after = []
        for k in reversed(range(len(self.norms))):
            z, state = self.couplings[k].inverse_step(z, condition, states[k])
            z = self.norms[k].inverse(z @ inverses[k].T)
            after.insert(0, state)
        return z, torch.stack(after)

    def inverses(self):
        """(K, D, D): inverses of the linear mixes, which sampling needs once."""
        return torch.stack([mix.inverse_matrix() for mix in self.mixes])
