"""Random numbers by sample: what sample i draws depends on (seed, names, i) alone, never on who is drawn beside it."""

import zlib

import numpy as np
from scipy.special import ndtri

PAGE = 256  # numbers drawn for a sample at a time
WIDEST = 2.5  # standard deviations at which normal draws are cut


class Dice:
    """Draws of N samples at once, each sample from a generator of its own.

    names : strings that tell streams apart (domain, part...). indices (N,) : the samples' numbers.
    """

    def __init__(self, seed, names, indices):
        stream = zlib.crc32("/".join(names).encode())
        self._generators = [np.random.default_rng([seed, stream, int(i)]) for i in indices]
        self._numbers, self._used = np.empty((len(self._generators), 0)), 0

    def __len__(self):
        return len(self._generators)

    def generator(self, i):
        """The i-th sample's own generator, for draws that do not batch."""
        return self._generators[i]

    def uniform(self, low=0.0, high=1.0, count=None):
        """(N,), or (N, count); low and high broadcast against it."""
        wanted = count or 1
        while self._used + wanted > self._numbers.shape[1]:
            page = np.stack([generator.random(PAGE) for generator in self._generators])
            self._numbers = np.concatenate([self._numbers[:, self._used :], page], axis=1)
            self._used = 0
        drawn = self._numbers[:, self._used : self._used + wanted]
        self._used += wanted
        return low + (np.asarray(high) - low) * (drawn if count else drawn[:, 0])

    def normal(self, mean=0.0, deviation=1.0, count=None):
        """Normal draws cut at 2.5 deviations: (N,), or (N, count)."""
        return mean + np.asarray(deviation) * np.clip(ndtri(self.uniform(1e-9, 1.0, count)), -WIDEST, WIDEST)

    def chance(self, share):
        """(N,) bool, true with probability `share`, a number or (N,)."""
        return self.uniform() < share

    def choice(self, weights):
        """(N,) int: an index drawn with the given weights (K,)."""
        edges = np.cumsum(weights) / np.sum(weights)
        return np.minimum(np.searchsorted(edges, self.uniform(), side="right"), len(edges) - 1)

    def pick(self, rows):
        """(N, ...): one of the rows (K, ...) for each sample."""
        rows = np.asarray(rows)
        return rows[self.choice(np.ones(len(rows)))]
