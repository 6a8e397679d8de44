"""The personal lexicon (`lexicon.yaml`) and the speakers' parameters (`speakers.yaml`) as arrays."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import read_yaml

# One arm's channels, in this order: wrist (out, up, forward) in arm lengths from its shoulder, four angles in degrees,
# and the hand shape (curl of index, middle, ring, little, thumb; thumb opposition; spread; knuckle bend), each 0..1.
CHANNELS = 15
POSITION, ANGLES, SHAPE = slice(0, 3), slice(3, 7), slice(7, 15)


@dataclass(frozen=True)
class Stroke:
    """One form of gesture: times (K,) s relative to the apex, keys (K, 15) and via (K,) bool for the right hand and for
    the left one (mirrored coordinates), `hands` one, both or either, `hold` a factor, `fixed` size."""

    name: str
    hands: str
    times: np.ndarray
    keys: dict
    via: np.ndarray
    hold: float
    fixed: bool

    @property
    def apex(self):
        """Index of the key at time 0."""
        return int(np.flatnonzero(self.times == 0)[0])


@dataclass(frozen=True)
class Lexicon:
    """strokes {name: Stroke}, rests {name: (15,)}, keywords {word: {stroke name: weight}}."""

    strokes: dict
    rests: dict
    keywords: dict


@cache
def lexicon():
    """The lexicon of `lexicon.yaml`."""
    table = _table("lexicon.yaml")
    shapes = table["shapes"]
    rests = {name: _key([0, *row], shapes)[1] for name, row in table["rests"].items()}
    strokes = {name: _stroke(name, entry, table["gestures"], shapes) for name, entry in table["gestures"].items()}
    keywords = {}
    for group in table["keywords"]:
        for word in group["words"]:
            keywords[word] = keywords.get(word, {}) | group["gestures"]
    return Lexicon(strokes, rests, keywords)


def speaker_parameters(speaker):
    """The entry of `speakers.yaml`, a dict; CospeechError lists the speakers when there is none of that name."""
    table = _table("speakers.yaml")
    if speaker not in table:
        raise CospeechError(f"demo speaker {speaker!r}: no such speaker; there are {', '.join(table)}")
    return table[speaker]


@cache
def _table(name):
    return read_yaml(files("cospeech.demo") / name)


def _key(row, shapes, shape=None):
    time, *numbers, name = row[:9]
    return time, np.array([*numbers, *shapes[shape or name]], float)


def _stroke(name, entry, gestures, shapes):
    base = gestures[entry["like"]] if "like" in entry else entry
    apex_on = lambda row: entry.get("shape") if row[0] >= 0 else None
    right = [_key(row, shapes, apex_on(row)) for row in base["keys"]]
    left = [_key(row, shapes, apex_on(row)) for row in base.get("left", base["keys"])]
    keys = {"right": np.array([key for _, key in right]), "left": np.array([key for _, key in left])}
    times = np.array([time for time, _ in right], float)
    via = np.array([row[-1] == "via" for row in base["keys"]])
    return Stroke(name, base["hands"], times, keys, via, base.get("hold", 1.0), base.get("fixed", False))
