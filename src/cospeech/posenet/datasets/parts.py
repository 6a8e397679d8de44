"""The joints of each part's network: which are predicted in 3D (J) and which have a heatmap (K)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cospeech.posenet import EVALUATED, JOINTS21
from cospeech.skeleton import Skeleton


@dataclass(frozen=True)
class Part:
    """skeleton: of the J joints. heatmaps: names of the K. mirrored: whether a mirror image is one of the same part;
    a hand's is not, as the network knows right hands only."""

    skeleton: Skeleton
    heatmaps: tuple
    mirrored: bool = True

    @cached_property
    def mirror2d(self):
        """(K,) index of each heatmap joint's counterpart when left and right are swapped."""
        twins = [self.skeleton.names[self.skeleton.mirror[i]] for i in self.skeleton.joints(*self.heatmaps)]
        return np.array([self.heatmaps.index(name) for name in twins])


HAND21 = Skeleton.load("hand21")
FACE68 = Skeleton.load("face68")
PARTS = {
    "body": Part(JOINTS21, EVALUATED),
    "hand": Part(HAND21, HAND21.names, mirrored=False),
    "face": Part(FACE68, FACE68.names),
}
