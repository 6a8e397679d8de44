"""Skeletons: joint names, order and parents, read from one table each (`skeletons/*.yaml`), and the maths on them."""

from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import read_yaml


@dataclass(frozen=True)
class Skeleton:
    """A named tree of joints.

    Attributes
    ----------
    names : tuple of J strings, in the order of every (..., J, 3) array.
    parents : tuple of J ints as published; -1 for the root; a joint that is its own parent starts a tree of its own.
    attach : {joint: joint}, where such separate trees are joined (with a zero offset) to make one.
    """

    name: str
    names: tuple
    parents: tuple
    attach: dict

    def __len__(self):
        return len(self.names)

    @cached_property
    def index(self):
        """{joint name: its position in `names`}."""
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def root(self):
        """Index of the joint that has no parent."""
        return self.parents.index(-1)

    @cached_property
    def tree(self):
        """(J,) parents of the one joined tree: `parents` with `attach` applied; -1 for the root."""
        parents = np.array(self.parents)
        for joint, onto in self.attach.items():
            parents[self.index[joint]] = self.index[onto]
        return parents

    @cached_property
    def order(self):
        """Joint indices such that every parent comes before its children (in `tree`)."""
        order, rest = [self.root], [j for j in range(len(self)) if j != self.root]
        while rest:
            ready = [j for j in rest if self.tree[j] in order]
            if not ready:
                raise CospeechError(f"skeleton {self.name}: joint {self.names[rest[0]]} never reaches the root")
            order += ready
            rest = [j for j in rest if j not in ready]
        return tuple(order)

    @cached_property
    def mirror(self):
        """(J,) index of each joint's counterpart when left and right are swapped; itself for middle joints."""
        swap = {"left": "right", "right": "left"}
        twins = ("_".join([swap.get(first := n.split("_")[0], first), *n.split("_")[1:]]) for n in self.names)
        return np.array([self.index[twin] for twin in twins])

    def joints(self, *names):
        """Indices (list of int) of the named joints."""
        unknown = [n for n in names if n not in self.index]
        if unknown:
            raise CospeechError(f"skeleton {self.name}: no joint named {unknown[0]!r}; it has {', '.join(self.names)}")
        return [self.index[n] for n in names]

    @classmethod
    def load(cls, name):
        """The skeleton of `skeletons/<name>.yaml`."""
        table = read_yaml(files("cospeech") / "skeletons" / f"{name}.yaml")
        names = tuple(joint for joint, _ in table["joints"])
        parents = tuple(-1 if parent is None else names.index(parent) for _, parent in table["joints"])
        return cls(table["name"], names, parents, table.get("attach", {}))


UPPER55 = Skeleton.load("upper55")
BODY = slice(0, 13)  # the three trees of upper55, as the published arrays are cut
RIGHT_HAND = slice(13, 34)
LEFT_HAND = slice(34, 55)

FINGERS = ("index", "middle", "little", "ring", "thumb")  # as the published layout orders them
LONG_FINGERS = tuple(FINGERS[i] for i in (0, 1, 3, 2))  # as they lie beside each other
ACROSS = ("thumb", *LONG_FINGERS)
FINGER_JOINTS = 4
# The joints of the right and the left hand's five fingers, from the base to the tip: (2, 5, 4).
CHAINS = np.array(
    [
        [UPPER55.joints(*(f"{side}_{finger}_{i}" for i in range(FINGER_JOINTS))) for finger in FINGERS]
        for side in ("right", "left")
    ]
)
BASES = CHAINS[..., 0]
HAND_ROOTS = np.array(UPPER55.joints("right_hand_root", "left_hand_root"))
WRISTS = np.array(UPPER55.joints("right_wrist", "left_wrist"))


def to_parent_relative(positions, skeleton=UPPER55):
    """Offsets from each joint's parent (thesis 5.3.3's representation for the resynchroniser).

    positions (..., J, 3) -> (..., J, 3); the root keeps its own position, a hand root's offset from its wrist is zero.
    """
    relative = positions - positions[..., np.where(skeleton.tree < 0, skeleton.root, skeleton.tree), :]
    relative[..., skeleton.root, :] = positions[..., skeleton.root, :]
    return relative


def from_parent_relative(relative, skeleton=UPPER55):
    """Inverse of `to_parent_relative`: sums offsets from the root outwards. (..., J, 3) -> (..., J, 3)."""
    positions = np.array(relative)
    for joint in skeleton.order[1:]:
        positions[..., joint, :] += positions[..., skeleton.tree[joint], :]
    return positions


def bone_lengths(positions, skeleton=UPPER55):
    """Median distance of each joint from its parent over all frames: (T, J, 3) -> (J,) metres, 0 for the root."""
    lengths = np.median(np.linalg.norm(to_parent_relative(positions, skeleton), axis=-1), axis=0)
    lengths[skeleton.root] = 0.0
    return lengths


def with_bone_lengths(positions, lengths, skeleton=UPPER55):
    """The same bone directions with the given lengths: (T, J, 3), (J,) -> (T, J, 3). A zero bone stays zero."""
    relative = to_parent_relative(positions, skeleton)
    norms = np.linalg.norm(relative, axis=-1, keepdims=True)
    scaled = np.divide(relative * lengths[:, None], norms, out=np.zeros_like(relative), where=norms > 1e-9)
    scaled[..., skeleton.root, :] = positions[..., skeleton.root, :]
    return from_parent_relative(scaled, skeleton)
