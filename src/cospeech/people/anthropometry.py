"""Who the synthetic people are: sex, age, stature, build, and the length of every bone."""

from dataclasses import dataclass, fields
from importlib.resources import files

import numpy as np

from cospeech.files import read_yaml
from cospeech.skeleton import UPPER55

TABLE = read_yaml(files("cospeech.people") / "anthropometry.yaml")
LIMITS = {name: np.array(limit, float) for name, limit in TABLE["limits"].items()}
LEGS = tuple(f"{side}_{joint}" for side in ("right", "left") for joint in ("knee", "ankle", "toe"))
JOINTS61 = (*UPPER55.names, *LEGS)  # of every person here: the clip file's joints, then the legs
INDEX = {name: i for i, name in enumerate(JOINTS61)}


@dataclass
class Build:
    """N people. female (N,) bool; age (N,) years; stature (N,) metres; girth (N,), 1 for an average build.

    lengths {name: (N,)} and offsets {name: (N, 3)} metres, as in anthropometry.yaml; face (N, 8) deviations of its
    features (`faces.py`).
    """

    female: np.ndarray
    age: np.ndarray
    stature: np.ndarray
    girth: np.ndarray
    lengths: dict
    offsets: dict
    face: np.ndarray

    def __getitem__(self, chosen):
        """The people at an index array."""
        pick = lambda x: {k: v[chosen] for k, v in x.items()} if isinstance(x, dict) else x[chosen]
        return Build(*(pick(getattr(self, f.name)) for f in fields(self)))


def draw_build(dice, children=0.0):
    """Draw a `Build`; `children` is the share of people under 17."""
    female = dice.chance(0.5)
    age = np.where(dice.chance(children), dice.uniform(7, 17), dice.uniform(18, 78))
    mean, deviation = np.where(female[:, None], TABLE["stature"]["female"], TABLE["stature"]["male"]).T
    stature = dice.normal(mean, deviation) * np.interp(age, *np.transpose(TABLE["child"]))
    factor = {name: np.where(female, value, 1.0) for name, value in TABLE["female"].items()}
    own = lambda: dice.normal(1, TABLE["deviation"])
    lengths = {name: share * stature * own() * factor.get(name, 1) for name, share in TABLE["lengths"].items()}
    lengths["head"] *= np.interp(age, [7, 17], [1.22, 1.0])  # a child's head is nearly grown
    offsets = {name: np.multiply.outer(stature * own(), share) for name, share in TABLE["offsets"].items()}
    for name in offsets.keys() & factor.keys():
        offsets[name][:, 0] *= factor[name]  # breadths
    girth = np.clip(dice.normal(1.0, 0.12), 0.78, 1.35)
    return Build(female, age, stature, girth, lengths, offsets, dice.normal(count=8))
