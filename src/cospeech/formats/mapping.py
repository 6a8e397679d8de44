"""Joint mappings: which joint of a recording is which of upper55 (`skeletons/*.yaml`, or one's own file)."""

import math
import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.files import read_yaml
from cospeech.skeleton import BODY, UPPER55

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}  # metres
AXES = {sign + axis: value * np.eye(3)["xyz".index(axis)] for sign, value in (("", 1), ("-", -1)) for axis in "xyz"}
KEYS = {"name", "units", "up", "rest", "forward", "head_rotation", "joints"}
HAND_ROOTS = {"right_hand_root": "right_wrist", "left_hand_root": "left_wrist"}


@dataclass(frozen=True)
class Mapping:
    """A mapping file (docs/mocap.md).

    source: the file, for messages; joints: {upper55 name: ({joint of the recording: weight}, offset (3,) in metres in
    the heaviest joint's own frame)}; units (m, cm, mm, inch or metres in one) and up as declared, or None; rest: "zero"
    or "first"; forward: pairs of joints of the recording that point ahead; head_rotation: the joint that turns with
    the skull.
    """

    source: str
    joints: dict
    units: str | float | None
    up: str | None
    rest: str
    forward: tuple
    head_rotation: str

    def bind(self, names, motion):
        """`Points`, this mapping on a recording whose joints are `names`; body joints that it lacks are an error."""
        index = self._index(names, motion)
        weights, offsets, anchors = np.zeros((len(UPPER55), len(names))), np.zeros((len(UPPER55), 3)), {}
        for target, (sources, offset) in self.joints.items():
            if sources.keys() <= index.keys():
                joint = UPPER55.index[target]
                weights[joint, [index[source] for source in sources]] = list(sources.values())
                offsets[joint], anchors[joint] = offset, index[max(sources, key=sources.get)]
        lacking = [
            f"{' + '.join(self.joints[n][0])} ({n})" for n in UPPER55.names[BODY] if UPPER55.index[n] not in anchors
        ]
        if self.head_rotation not in index:
            lacking.append(f"{self.head_rotation} (head_rotation)")
        if lacking:
            raise CospeechError(
                f"{motion}: has no joint {', '.join(lacking)}; the mapping {self.source} does not fit. It has: "
                f"{', '.join(names)}"
            )
        forward = [(index[a], index[b]) for a, b in self.forward if a in index and b in index]
        return Points(weights, offsets, anchors, forward, index[self.head_rotation])

    def _index(self, names, motion):
        """{name in this mapping: joint}. Of several joints that are alike but for the prefix before their colon, the
        one of the character is taken: the prefix that most of the mapping's joints have. CospeechError in doubt."""
        wanted = {name for sources, _ in self.joints.values() for name in sources} | {self.head_rotation}
        wanted |= {name for pair in self.forward for name in pair}
        index, alike = {}, defaultdict(list)
        for i, name in enumerate(names):
            index[name] = i
            prefix, _, short = name.rpartition(":")
            alike[short].append((prefix, i))
        owned = Counter(prefix for short in wanted for prefix, _ in alike.get(short, ()))
        owner = max(owned, key=owned.get, default="")
        rivals = {prefix for prefix, count in owned.items() if prefix != owner and 2 * count >= owned[owner]}
        for short, places in alike.items():
            own = [i for prefix, i in places if len(places) == 1 or prefix == owner]
            if short in wanted and (len(own) != 1 or rivals & {prefix for prefix, _ in places if len(places) > 1}):
                raise CospeechError(
                    f"{motion}: {short!r} may be {' or '.join(names[i] for _, i in places)}; write the joint's whole "
                    f"name into the mapping {self.source}"
                )
            index[short] = own[0] if own else places[-1][1]
        return index


@dataclass(frozen=True)
class Points:
    """A mapping bound to the J joints of one recording: weights (55, J), offsets (55, 3) metres in the frame of joint
    `anchors[i]` (only joints that are there have one), pairs `forward` and joint `head` as indices."""

    weights: np.ndarray
    offsets: np.ndarray
    anchors: dict
    forward: list
    head: int

    @property
    def present(self):
        """(55,) bool: joints that the recording has."""
        return np.isin(np.arange(len(self.weights)), list(self.anchors))

    def positions(self, positions, rotations, scale):
        """World positions and rotations (T, J, 3 | 4) in file units -> (T, 55, 3) metres; absent joints are zero."""
        points = self.weights @ positions * scale
        for joint in np.flatnonzero(self.offsets.any(axis=1)):
            points[:, joint] += Rotation.from_quat(rotations[:, self.anchors[joint]]).apply(self.offsets[joint])
        return points


def load_mapping(skeleton):
    """Read and check a mapping: `skeleton` is the name of a shipped one (zeggs, beat) or the path of a YAML file."""
    shipped = files("cospeech") / "skeletons" / f"{skeleton}.yaml"
    path = shipped if re.fullmatch(r"[\w-]+", str(skeleton)) and shipped.is_file() else Path(skeleton)
    if not path.is_file():
        raise CospeechError(
            f"{skeleton}: no such joint mapping; give zeggs, beat or the path of a file (docs/mocap.md)"
        )
    table = read_yaml(path, invalid="not readable as YAML")
    if not isinstance(table, dict) or not isinstance(table.get("joints"), dict):
        raise CospeechError(f"{path}: not a joint mapping (it needs 'joints:' with lines like 'pelvis: Hips')")
    if unknown := sorted(map(str, table.keys() - KEYS)):
        raise CospeechError(f"{path}: unknown key {unknown[0]!r}; expected {', '.join(sorted(KEYS))}")
    return _mapping(str(skeleton), table)


def _mapping(source, table):
    joints = {name: _sources(source, name, entry) for name, entry in table["joints"].items()}
    if unknown := [name for name in joints if name not in UPPER55.index]:
        raise CospeechError(f"{source}: joints: {unknown[0]!r} is no joint of upper55 ({', '.join(UPPER55.names)})")
    if missing := [name for name in UPPER55.names[BODY] if name not in joints]:
        raise CospeechError(f"{source}: joints: {', '.join(missing)} missing; every body joint needs a source")
    for root, wrist in HAND_ROOTS.items():
        joints.setdefault(root, joints[wrist])
    forward = table.get("forward", [])
    if not (isinstance(forward, list) and all(isinstance(pair, list) and len(pair) == 2 for pair in forward)):
        raise CospeechError(f"{source}: forward: expected pairs of joints like [[LeftFoot, LeftToeBase]]")
    head = table.get("head_rotation", max(joints["head"][0], key=joints["head"][0].get))
    for key, allowed in (("up", AXES), ("rest", ("zero", "first"))):
        check_choice(source, key, table.get(key), allowed)
    if table.get("units") is not None:
        metres(source, table["units"])
    pairs = tuple((str(a), str(b)) for a, b in forward)
    return Mapping(source, joints, table.get("units"), table.get("up"), table.get("rest", "zero"), pairs, str(head))


def check_choice(where, key, value, allowed):
    """CospeechError unless `value` is None or one of `allowed`."""
    if value is not None and value not in allowed:
        raise CospeechError(f"{where}: {key}: {value!r}; expected one of {', '.join(allowed)}")


def metres(where, units):
    """Metres in one of `units`: m, cm, mm, inch or that number itself; CospeechError for anything else."""
    if isinstance(units, str) and units in UNITS:
        return UNITS[units]
    if isinstance(units, bool) or not isinstance(units, int | float) or not 0 < units < math.inf:
        raise CospeechError(
            f"{where}: units: {units!r}; expected one of {', '.join(UNITS)}, or the metres in one unit as a number "
            "above 0, as in 0.056444"
        )
    return float(units)


def _sources(source, name, entry):
    """({joint: weight}, offset) of `Hips`, `{Hip1: 0.5, Hip2: 0.5}`, `{joint: Head, offset: [0, 0.1, 0]}`."""
    offset = np.zeros(3)
    if isinstance(entry, dict) and "joint" in entry:
        numbers = entry.get("offset", [0, 0, 0])
        fits = isinstance(numbers, list) and len(numbers) == 3 and all(isinstance(v, int | float) for v in numbers)
        if not fits or entry.keys() - {"joint", "offset"}:
            raise CospeechError(f"{source}: joints: {name}: expected joint: and offset: [x, y, z] in metres")
        offset, entry = np.array(numbers, float), entry["joint"]
    weights = entry if isinstance(entry, dict) else {entry: 1.0}
    if not all(isinstance(k, str) and isinstance(v, int | float) for k, v in weights.items()):
        raise CospeechError(f"{source}: joints: {name}: expected a joint's name, or names with weights")
    if abs(sum(weights.values()) - 1) > 1e-6:
        raise CospeechError(f"{source}: joints: {name}: the weights add up to {sum(weights.values()):g}, expected 1")
    return weights, offset
