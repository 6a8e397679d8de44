"""The cascade of HA2G (eq. 4): one bidirectional GRU per pose level, each starting from the level before it."""

import torch
from torch import nn
from torch.nn import functional as F

from cospeech.gestures.ha2g.networks.gru import GRU
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import scaled
from cospeech.skeleton import FINGERS

HIDDEN = 300


class Level(nn.Module):
    """One level: what is known of its poses, a flag, speech and style -> its poses (N, T, D)."""

    def __init__(self, channels, conditions, hidden, layers, dropout):
        super().__init__()
        self.gru = GRU(channels + 1 + conditions, hidden, layers, dropout)
        self.head = nn.Sequential(nn.Linear(hidden, hidden // 2), nn.LeakyReLU(0.2), nn.Linear(hidden // 2, channels))

    def forward(self, x):
        return self.head(self.gru(x))


HIERARCHIES = ("full", "none", "body", "hands")


def inferred_levels(table, hierarchy="full"):
    """Which levels of a `LevelTable` have a generator of their own, ascending; the last always has.

    hierarchy : "full", every level; "none", the holistic generator of Table 4; "body", the hands at once (Table 4's
        "without hand hierarchy"); "hands", the body at once ("without body hierarchy").
    """
    of_hands = lambda v: any(finger in table.joints[table.bones[v][1]] for finger in FINGERS)
    body = [level for level, added in enumerate(table.levels) if not of_hands(added[0])]
    hands, last = range(len(body), len(table.levels)), len(table.levels) - 1
    chosen = {"full": [*body, *hands], "none": [], "body": body, "hands": [body[-1], *hands]}[hierarchy]
    return sorted({*chosen, last})


class Cascade(nn.Module):
    """Hierarchical pose inferer (eq. 4): seed poses and conditions -> the poses of every level, coarse to fine.

    The last level is the whole pose.

    levels : list of the pose channels of every level, ascending, each containing those before it
        (`LevelTable.channels`); one level alone is the holistic generator.
    conditions : channels of what every level hears besides poses.
    """

    def __init__(self, levels, conditions, width=1.0, layers=4, dropout=0.3):
        super().__init__()
        hidden = scaled(HIDDEN, width, 2)
        self.levels = nn.ModuleList(Level(len(c), conditions, hidden, layers, dropout) for c in levels)
        before = {}
        for level, channels in enumerate(levels):
            self.register_buffer(f"channels{level}", torch.as_tensor(channels), persistent=False)
            # Where a level finds its slots in the level before it; new ones find the zero appended to that.
            slots = [before.get(channel, len(before)) for channel in channels.tolist()]
            self.register_buffer(f"slots{level}", torch.tensor(slots), persistent=False)
            before = {channel: slot for slot, channel in enumerate(channels.tolist())}

    def of_level(self, level, poses):
        """The channels of a level in whole poses (..., C)."""
        return poses.index_select(-1, getattr(self, f"channels{level}"))

    def forward(self, seed, conditions):
        """seed (N, 4, C), conditions: per level (N, T, K) -> per level (N, T, D)."""
        given, frames = seed.shape[1], conditions[0].shape[1]
        flag = F.pad(seed.new_ones(seed.shape[0], given, 1), (0, 0, 0, frames - given))
        zero = seed.new_zeros(seed.shape[0], frames, 1)
        carried, poses = zero, []
        for level, network in enumerate(self.levels):
            known = carried[:, given:].index_select(2, getattr(self, f"slots{level}"))
            known = torch.cat([self.of_level(level, seed), known], dim=1)
            poses.append(network(torch.cat([known, flag, conditions[level]], dim=2)))
            carried = torch.cat([poses[-1], zero], dim=2)
        return poses
