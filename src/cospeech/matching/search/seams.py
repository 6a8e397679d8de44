"""Seams: where a window does not go on from the one before, made a transition (`blend`, `inertialize`) or left (`off`).

Bones are turned, never stretched, so they keep their lengths; no frame before a seam is touched.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.matching.database.descriptors import WINDOW
from cospeech.matching.database.sources import following
from cospeech.rotation import between
from cospeech.skeleton import UPPER55, from_parent_relative, to_parent_relative

SEAMS = ("off", "blend", "inertialize")
BLEND = 4  # frames of a cross-fade, as in HA2G's long synthesis
HALF_LIFE = 0.1  # seconds in which half of an inertialised offset is gone
SPAN = 1.0  # seconds after which nothing of it is left


def check_seams(seams):
    """CospeechError that lists the known transitions, unless `seams` is one."""
    if seams not in SEAMS:
        raise CospeechError(f"seams {seams!r} is not known; known: {', '.join(SEAMS)}")


def borders(match):
    """(n,) numbers of the windows whose source is not what truly followed the window before."""
    jumped = np.abs(np.diff(match.time) * match.database.fps - WINDOW) > 0.5
    return 1 + np.flatnonzero(jumped | (match.take[1:] != match.take[:-1]))


def smoothed(match, seams):
    """(positions (T, 55, 3), rotation (T, 3) or None) of a `Match`, with transitions at its `borders`.

    "off" : the frames as they were found. "blend" : the old source goes on for `BLEND` frames and fades into the new
    one. "inertialize" : the new source and, on top, the seam's difference in place and speed, which a critically damped
    spring takes away (Bollo, Inertialization, GDC 2018; Holden's spring).
    """
    check_seams(seams)
    positions, rotation, windows = match.positions, match.rotation, borders(match)
    if seams == "off" or not len(windows):
        return positions, rotation
    if seams == "inertialize":
        frames, fps = windows * WINDOW, match.database.fps
        turned = inertialized_rotation(rotation, frames, fps) if rotation is not None else None
        return inertialized(positions, frames, fps), turned
    positions, rotation = positions.copy(), None if rotation is None else rotation.copy()
    for window in windows:
        part = slice(window * WINDOW, min(window * WINDOW + BLEND, len(positions)))
        old, old_rotation = _went_on(match, window - 1, part.stop - part.start)
        fade = 1 - np.arange(1, len(old) + 1) / (BLEND + 1)
        positions[part] = cross_fade(positions[part], old, fade)
        if rotation is not None and old_rotation is not None:
            rotation[part] = cross_fade_rotation(rotation[part], old_rotation, fade)
    return positions, rotation


def _went_on(match, window, count):
    """What the source of a window holds after it: (count, 55, 3) positions and (count, 3) head rotations or None."""
    inserted = next((one for one in getattr(match, "inserted", ()) if one.first <= window < one.end), None)
    if inserted:
        own = inserted.gesture
        at = inserted.offset + (window + 1 - inserted.first) * WINDOW + np.arange(count)
        at = np.minimum(at, len(own.positions) - 1)
        return own.positions[at], None if own.rotation is None else own.rotation[at]
    clips, frames = following(match.database, match.clip[window], match.frame[window], count)
    rotation = match.database.rotation
    return match.database.positions[clips, frames], None if rotation is None else rotation[clips, frames]


def cross_fade(one, other, share):
    """Motion `share` (T,) of the way from `one` to `other`, both (T, 55, 3): bones turned, lengths in between."""
    (a, a_length, root), (b, b_length, other_root) = _bones(one), _bones(other)
    share = np.asarray(share, float)[:, None, None]
    bones = _turned(a, share * _turn(a, b)) * (a_length + share * (b_length - a_length))
    return _joined(bones, root + share[:, 0] * (other_root - root), one.dtype)


def cross_fade_rotation(one, other, share):
    """Head rotation `share` (T,) of the way from `one` to `other` (both (T, 3) axis-angle), by the shorter way."""
    a = Rotation.from_rotvec(one)
    way = (Rotation.from_rotvec(other) * a.inv()).as_rotvec()
    return (Rotation.from_rotvec(np.asarray(share)[:, None] * way) * a).as_rotvec().astype(one.dtype)


def inertialized(positions, frames, fps):
    """Motion (T, 55, 3) whose seams lie before `frames`, as transitions: -> (T, 55, 3)."""
    bones, lengths, root = _bones(positions)
    moved = bones.copy()
    for begin, end in _spans(frames, len(moved), fps):
        before = _turn(moved[begin - 2], moved[begin - 1]) if begin > 1 else np.zeros(bones.shape[1:])
        after = _turn(bones[begin], bones[begin + 1]) if end - begin > 1 else before
        offset = _turn(bones[begin], _turned(moved[begin - 1], before))
        moved[begin:end] = _turned(bones[begin:end], _decaying(offset, before - after, end - begin, fps))
    return _joined(moved * lengths, root, positions.dtype)


def inertialized_rotation(rotation, frames, fps):
    """The same for head rotations: (T, 3) axis-angle -> (T, 3)."""
    target, moved = Rotation.from_rotvec(rotation), rotation.astype(float)
    for begin, end in _spans(frames, len(moved), fps):
        last = Rotation.from_rotvec(moved[begin - 1])
        before = (last * Rotation.from_rotvec(moved[begin - 2]).inv()).as_rotvec() if begin > 1 else np.zeros(3)
        after = (target[begin + 1] * target[begin].inv()).as_rotvec() if end - begin > 1 else before
        offset = (Rotation.from_rotvec(before) * last * target[begin].inv()).as_rotvec()
        extra = Rotation.from_rotvec(_decaying(offset, before - after, end - begin, fps))
        moved[begin:end] = (extra * target[begin:end]).as_rotvec()
    return moved.astype(rotation.dtype)


def _spans(frames, total, fps):
    """(begin, end) of what each seam changes: up to the next seam, and `SPAN` at most."""
    ends = np.minimum([*frames[1:], total], np.asarray(frames) + round(SPAN * fps))
    return zip(frames, ends, strict=True)


def _decaying(offset, velocity, count, fps):
    """A critically damped spring's way back to zero: offset, velocity (a frame) (...) -> (count, ...)."""
    damping = 2 * np.log(2) / (HALF_LIFE * fps)
    time = np.arange(count).reshape(-1, *[1] * offset.ndim)
    return np.exp(-damping * time) * (offset + (velocity + damping * offset) * time)


def _bones(positions):
    """Unit directions (T, 55, 3) and lengths (T, 55, 1) of the bones, and the root's position (T, 3)."""
    relative = to_parent_relative(np.asarray(positions, float))
    root = relative[:, UPPER55.root].copy()
    lengths = np.linalg.norm(relative, axis=-1, keepdims=True)
    directions = np.divide(relative, lengths, out=np.zeros_like(relative), where=lengths > 1e-9)
    directions[lengths[..., 0] <= 1e-9] = [0.0, 1.0, 0.0]  # a bone without length may point anywhere
    return directions, lengths, root


def _joined(bones, root, dtype):
    bones[:, UPPER55.root] = root
    return from_parent_relative(bones).astype(dtype)


def _turn(a, b):
    """The smallest rotation vectors (..., 3) that take directions a to b."""
    turn = between(a, b)
    return Rotation.from_quat(turn.reshape(-1, 4)).as_rotvec().reshape((*turn.shape[:-1], 3))


def _turned(directions, turns):
    directions, turns = np.broadcast_arrays(directions, turns)
    turned = Rotation.from_rotvec(turns.reshape(-1, 3)).apply(directions.reshape(-1, 3))
    return turned.reshape(directions.shape)
