"""A stretch of a take without a cut: filled, on the clip's clock, upright, facing forward, on its bones, smoothed."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from cospeech.body.anatomy import REST_FOREARM, UP, facing_of, rest_hand
from cospeech.capture.cleanup.assemble import HANDS
from cospeech.capture.cleanup.fill import EXCLUDED, fill_gaps, fill_joints
from cospeech.rotation import between, continuous, resample, resample_rotations
from cospeech.skeleton import BODY, UPPER55, with_bone_lengths

TRUST = np.array([0.0, 0.5, 1.0])  # factor on the confidence of what is excluded, interpolated, observed
SETTLED = 5.0  # seconds of a face whose mean direction tells where it looks to
AHEAD = np.array([0.0, 0.0, 1.0])
SIDES = {"right": -1.0, "left": 1.0}


@dataclass
class Face:
    """A face over F frames: rotation (F, 3) axis-angle, score (F,) with 0 where no face was seen, expression (F, E) or
    None. Rotation 0 looks along +z: at the video's rate into the camera, on the clip's clock forward."""

    rotation: np.ndarray
    score: np.ndarray
    expression: np.ndarray | None = None

    def section(self, where):
        """The frames of a slice."""
        return Face(*(None if a is None else a[where] for a in (self.rotation, self.score, self.expression)))

    @classmethod
    def joined(cls, faces):
        """Faces one after the other."""
        return cls(
            *(
                None if parts[0] is None else np.concatenate(parts)
                for parts in zip(*((f.rotation, f.score, f.expression) for f in faces), strict=True)
            )
        )


@dataclass
class Stretch:
    """What became of one stretch; the arrays as in `clean.Cleaned`."""

    positions: np.ndarray
    confidence: np.ndarray
    state: np.ndarray
    tilt: float
    face: Face | None = None
    face_state: np.ndarray | None = None


def clean_stretch(observed, believed, typical, bones, face, *, clock, apart, sigma, unify, upright, forward, ahead):
    """Clean one stretch of a take.

    observed, believed : as `clean.believe` judged them. typical (55, 3) : for joints never believed here;
    NaN for hands that are to rest. bones (55,). clock : (fps, rate, frames, start): frame i of the result shows the
    video at start + i / rate seconds. apart : frames of the video up to which gaps are filled. sigma : frames of
    the result.
    """
    fps, rate, frames, start = clock
    positions = np.where(believed.any(axis=0)[:, None], observed.positions, typical)
    resting = np.isnan(positions).any(axis=(0, 2))
    known = np.concatenate([np.where(resting[:, None], 0.0, positions), observed.score[..., None]], axis=-1)
    filled, state = fill_joints(known, believed, apart)
    at = _nearest(len(observed), *clock)
    positions = resample(filled[..., :3], fps, rate, frames, start)
    state, score = state[at], np.clip(filled[at, :, 3], 0, 1)
    settled = face is not None and (face.score > 0).sum() >= SETTLED * fps
    ahead = ahead and settled
    turn, tilt = _upright(positions, state) if upright else (Rotation.identity(), 0.0)
    others = _shared(turn, face) if observed.apart and settled else turn
    positions = np.concatenate([_turned(positions[:, BODY], turn), _turned(positions[:, BODY.stop :], others)], axis=1)
    away = facing_of(positions, rate) if forward else Rotation.identity(frames)
    aside = _aside(away, others, face) if observed.apart and forward and ahead else Rotation.identity()
    for joints, own in ((BODY, away), (slice(BODY.stop, None), away * aside)):
        positions[:, joints] = _turned(positions[:, joints], own.inv())
    _attach_hands(positions, resting, bones)
    if unify:
        positions = with_bone_lengths(positions, bones)
    positions = smooth(positions, sigma)
    if unify:  # smoothing cuts the corners of turning bones
        positions = with_bone_lengths(positions, bones)
    faces = (None, None) if face is None else _clean_face(face, away.inv() * others, clock, apart, sigma, ahead)
    return Stretch(positions, score * TRUST[state], state, tilt, *faces)


def smooth(values, sigma):
    """Zero-phase Gaussian along time, (T, ...), sigma in frames; the ends are held (scipy's mode "nearest")."""
    return gaussian_filter1d(values, sigma, axis=0, mode="nearest") if sigma else values


def smooth_rotations(rotations, sigma):
    """`smooth` for rotations (T, 3) axis-angle: the components of sign-continuous quaternions are filtered."""
    quaternions = smooth(continuous(Rotation.from_rotvec(rotations).as_quat()), sigma)
    return Rotation.from_quat(quaternions).as_rotvec()


def _nearest(length, fps, rate, frames, start):
    return np.clip(np.round((start + np.arange(frames) / rate) * fps).astype(int), 0, length - 1)


def _upright(positions, state):
    """The rotation that makes the mean trunk (pelvis to neck) vertical, and its angle in degrees."""
    neck, pelvis = UPPER55.joints("neck", "pelvis")
    known = (state[:, neck] != EXCLUDED) if (state[:, neck] != EXCLUDED).any() else slice(None)
    trunk = (positions[known, neck] - positions[known, pelvis]).mean(axis=0)
    if not np.linalg.norm(trunk):
        return Rotation.identity(), 0.0
    turn = Rotation.from_quat(between(trunk, UP))
    return turn, float(np.degrees(turn.magnitude()))


def _turned(positions, rotations):
    """(T, J, 3) by one rotation, or by T."""
    return positions @ np.swapaxes(rotations.as_matrix(), -1, -2)


def _looking(face, axis):
    """(3,) where an axis of the head points to on average over the frames in which a face was seen."""
    return Rotation.from_rotvec(face.rotation[face.score > 0]).apply(axis).mean(axis=0)


def _shared(turn, face):
    """The part of the body's turn upright that the head's mean lean asks for as well. A leaning camera shows in both;
    what only the body leans is its tracker's fault, of which hands and head, seen by other networks, know nothing."""
    head, body = Rotation.from_quat(between(_looking(face, UP), UP)).as_rotvec(), turn.as_rotvec()
    return Rotation.from_rotvec(np.clip(head @ body / max(body @ body, 1e-12), 0, 1) * body)


def _aside(away, others, face):
    """Half the turn about the vertical from where the body is seen to face, on average, to where the head looks: each
    is one network's idea of where the speaker faces, and hands seen by a third share neither's error."""
    look, body = others.apply(_looking(face, AHEAD)), away.mean().apply(AHEAD)
    angle = np.arctan2(look[0], look[2]) - np.arctan2(body[0], body[2])
    return Rotation.from_rotvec(((angle + np.pi) % (2 * np.pi) - np.pi) / 2 * UP)


def _attach_hands(positions, resting, bones):
    """Put hands, relative to their wrists, onto the arms, in place; those never seen rest, turning with the forearm."""
    for side, sign in SIDES.items():
        elbow, wrist, root = UPPER55.joints(f"{side}_elbow", f"{side}_wrist", f"{side}_hand_root")
        hand = HANDS[f"{side}_hand"]
        if resting[root]:
            forearm = positions[:, wrist] - positions[:, elbow] + [1e-9 * sign, 0.0, 0.0]
            turn = Rotation.from_quat(between([sign, 0.0, 0.0], forearm))
            positions[:, root] = 0.0
            for finger, offsets in rest_hand(bones[wrist] / REST_FOREARM or 1.0, sign).items():
                for i, bone in enumerate(np.cumsum(offsets, axis=0)):
                    positions[:, UPPER55.index[f"{side}_{finger}_{i}"]] = turn.apply(bone)
        positions[:, hand] += positions[:, wrist, None] - positions[:, root, None]


def stand(bones):
    """(55, 3) metres: somebody with these bone lengths (55,) who stands, arms hanging, pelvis at the origin."""
    ways = {"spine": (0, 1, 0), "neck": (0, 1, 0), "head": (0, 0.9, 0.4), "head_top": (0, 1, 0)}
    for side, sign in SIDES.items():
        ways |= {f"{side}_hip": (sign, -0.5, 0), f"{side}_shoulder": (sign, -0.2, 0)}
        ways |= {f"{side}_elbow": (0.1 * sign, -1, 0), f"{side}_wrist": (0.1 * sign, -1, 0.1)}
    positions = np.zeros((1, len(UPPER55), 3))
    for joint in UPPER55.order:
        if (name := UPPER55.names[joint]) in ways:
            way = np.array(ways[name]) / np.linalg.norm(ways[name])
            positions[0, joint] = positions[0, UPPER55.parents[joint]] + bones[joint] * way
    _attach_hands(positions, np.ones(len(UPPER55), bool), bones)
    return positions[0]


def _clean_face(face, turn, clock, apart, sigma, ahead):
    """The face on the clip's clock, its rotation in the clip's axes by `turn` (T rotations) and smoothed; with `ahead`
    its mean is straight ahead."""
    fps, rate, frames, start = clock
    seen = face.score > 0
    quaternions = Rotation.from_rotvec(face.rotation).as_quat()
    quaternions[seen] = continuous(quaternions[seen])
    columns = [quaternions, face.score[:, None]] + ([] if face.expression is None else [face.expression])
    filled, state = fill_gaps(np.concatenate(columns, axis=1), seen, apart)
    at = _nearest(len(seen), *clock)
    turned = filled[:, :4] / np.linalg.norm(filled[:, :4], axis=1, keepdims=True)
    rotation = turn * Rotation.from_quat(resample_rotations(turned, fps, rate, frames, start))
    expression = None if face.expression is None else resample(filled[:, 5:], fps, rate, frames, start)
    score = np.clip(filled[at, 4], 0, 1) * TRUST[state[at]]
    if ahead and (score > 0).any():
        rotation = rotation[score > 0].mean().inv() * rotation
    return Face(smooth_rotations(rotation.as_rotvec(), sigma), score, expression), state[at]
