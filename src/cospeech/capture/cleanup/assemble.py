"""A track's parts put together: the tracker's skeletons become upper55, at the video's own rate, noise and all."""

from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np

from cospeech.body.anatomy import TORSO_AND_ARM
from cospeech.errors import CospeechError
from cospeech.files import read_yaml
from cospeech.skeleton import BODY, LEFT_HAND, RIGHT_HAND, UPPER55, bone_lengths

UPRIGHT = np.array([1.0, -1.0, -1.0])  # camera axes (x right, y down, z away) to x left, y up, z to the camera
HANDS = {"right_hand": RIGHT_HAND, "left_hand": LEFT_HAND}
PARTS = {"body": BODY, **HANDS}


@dataclass
class Observations:
    """What a track says about the 55 joints in its F frames.

    positions (F, 55, 3): x left, y up, z to the camera; the body relative to the pelvis, each hand to its own wrist; in
    metres if `metric`. pixels (F, 55, 2): where the tracker saw them, y down. score (F, 55) 0..1. seen (F, 55) bool:
    False where the tracker found nothing. apart: whether the hands come from a network of their own, which does not
    share the body's lean.
    """

    positions: np.ndarray
    pixels: np.ndarray
    score: np.ndarray
    seen: np.ndarray
    metric: bool = True
    apart: bool = False

    def __len__(self):
        return len(self.positions)


def assemble(track, name="track"):
    """`Observations` of a Track: its body by the table of joints in `data/upper55.yaml`, its hands by name.

    Hands that the tracker does not see at all stay unseen. Raises CospeechError for a track without a body, for one in
    two dimensions only, and for a skeleton that has no table.
    """
    if track.body is None:
        raise CospeechError(f"{name}: no body in this track; choose a tracker that has one")
    joints = len(UPPER55)
    observed = Observations(
        np.zeros((track.frames, joints, 3)),
        np.zeros((track.frames, joints, 2)),
        np.zeros((track.frames, joints)),
        np.zeros((track.frames, joints), bool),
        track.body.metric,
    )
    for part, where in PARTS.items():
        points = getattr(track, part)
        if points is None:
            continue
        observed.apart |= points.space == "wrist"
        if points.xyz is None:
            raise CospeechError(f"{name}: {part} is in two dimensions only; a clip needs a tracker with depth (xyz)")
        weights = _weights(points.table, part, name)
        observed.positions[:, where] = np.einsum("jk,fkc->fjc", weights, points.xyz, optimize=True) * UPRIGHT
        observed.pixels[:, where] = np.einsum("jk,fkc->fjc", weights, points.xy, optimize=True)
        used = weights != 0
        observed.score[:, where] = np.stack([points.score[:, row].min(axis=1) for row in used], axis=1)
        observed.seen[:, where] = points.observed[:, None]
        origin = UPPER55.index["pelvis"] if part == "body" else where.start
        observed.positions[:, where] -= observed.positions[:, origin, None]
    return observed


def in_metres(observed, bones=None):
    """The same `Observations` in metres: what has no scale gets the size of an adult, or of `bones` (55,), if given."""
    if observed.metric:
        return observed
    chain = UPPER55.joints("spine", "neck", "left_elbow", "left_wrist")
    body = observed.positions[observed.seen[:, chain].all(axis=1)]
    if not len(body):
        return observed
    size = bone_lengths(body)[chain].sum()
    wanted = TORSO_AND_ARM if bones is None else bones[chain].sum()
    return replace(observed, positions=observed.positions * (wanted / size if size else 1.0), metric=True)


def _weights(table, part, name):
    """(J, K) weights of the part's joints of upper55 on a tracker's points."""
    names = UPPER55.names[PARTS[part]]
    if part == "body":
        tables = read_yaml(files("cospeech.capture.cleanup") / "data" / "upper55.yaml")
        if table.name not in tables:
            raise CospeechError(f"{name}: no way from skeleton {table.name!r} to upper55; known: {', '.join(tables)}")
        sources = {joint: tables[table.name].get(joint, {joint: 1.0}) for joint in names}
    else:
        side = f"{part.split('_')[0]}_"
        sources = {joint: {joint.removeprefix(side): 1.0} for joint in names}
    weights = np.zeros((len(names), len(table)))
    for row, joint in enumerate(names):
        weights[row, table.joints(*sources[joint])] = list(sources[joint].values())
    return weights
