"""Level tables: the joints, bone vectors and coarse-to-fine levels of HA2G's two skeletons, one data file each.

Every other module here reads the hierarchy from a `LevelTable`, so that there is one loop over levels and no second
copy of anything for another skeleton.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import read_yaml

TABLES = ("expressive43", "ted10")


@dataclass(frozen=True)
class LevelTable:
    """A skeleton as unit bone vectors in levels.

    Attributes
    ----------
    joints : tuple of J names. places : tuple of J names, where each is in `upper55` (see `bones.POINTS`).
    bones : int (V, 2), parent and child joint of each vector, parents first.
    lengths : float (V,), the released bone lengths in metres.
    levels : tuple of int arrays, the vectors that each level adds.
    angle_pairs : int (A, 2), two vectors each that include an angle.
    palm_pairs : int (B, 3), a forearm's vector, and the little finger's and the thumb's, whose cross product is the
        palm's normal: the angle of forearm and normal. P = A + B.
    """

    name: str
    joints: tuple
    places: tuple
    bones: np.ndarray
    lengths: np.ndarray
    levels: tuple
    angle_pairs: np.ndarray
    palm_pairs: np.ndarray

    @property
    def vectors(self):
        """V, the number of bone vectors."""
        return len(self.bones)

    @property
    def angles(self):
        """P, the number of included angles: of pairs, then of palms."""
        return len(self.angle_pairs) + len(self.palm_pairs)

    @cached_property
    def _cumulative(self):
        return tuple(np.sort(np.concatenate(self.levels[: i + 1])) for i in range(len(self.levels)))

    def upto(self, level):
        """Ascending numbers of the vectors that level 0, 1, ... `level` have between them."""
        return self._cumulative[level]

    def dims(self, level):
        """Numbers in the poses of that level: three for each vector."""
        return 3 * len(self.upto(level))

    def channels(self, level):
        """Where the poses of that level lie among the 3V numbers of a whole pose, int (dims,)."""
        return (3 * self.upto(level)[:, None] + np.arange(3)).ravel()


@cache
def level_table(name):
    """The `LevelTable` called "expressive43" (TED Expressive: 42 vectors, 6 levels) or "ted10" (TED Gesture: 9, 3)."""
    if name not in TABLES:
        raise CospeechError(f"level table {name!r} is not known; known: {', '.join(TABLES)}")
    table = read_yaml(files("cospeech.gestures.ha2g.dataset") / f"{name}.yaml")
    numbers = {key: np.array(table[key], np.int64).reshape(-1, n) for key, n in (("angle_pairs", 2), ("palm_pairs", 3))}
    return LevelTable(
        name,
        *zip(*table["joints"], strict=True),
        np.array([bone[:2] for bone in table["bones"]]),
        np.array([bone[2] for bone in table["bones"]]),
        tuple(np.array(level) for level in table["levels"]),
        **numbers,
    )


def included_angles(vectors, table):
    """Angles between neighbouring bones, in units of pi (HA2G section 4.3 and appendix D).

    vectors (..., V, 3), any lengths -> (..., P) in 0..1: acos of each pair's cosine over pi, then each palm's.
    """
    first, second = (vectors[..., table.angle_pairs[:, i], :] for i in (0, 1))
    forearm, little, thumb = (vectors[..., table.palm_pairs[:, i], :] for i in (0, 1, 2))
    first = np.concatenate([first, forearm], axis=-2)
    second = np.concatenate([second, np.cross(little, thumb)], axis=-2)
    norms = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    cosine = np.sum(first * second, axis=-1) / np.maximum(norms, 1e-8)
    return np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi
