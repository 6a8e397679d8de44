"""Motion capture in: a BVH or SMPL-X file and its sound become a clip (docs/mocap.md)."""

import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.body.anatomy import HEADING_SECONDS, REST_FOREARM, TORSO_AND_ARM, UP, facing_of, left_of, rest_hand
from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError, notice
from cospeech.files import load_arrays, sha256
from cospeech.formats.bvh import read_bvh
from cospeech.formats.mapping import AXES, UNITS, check_choice, load_mapping, metres
from cospeech.formats.smplx_motion import is_smplx, smplx_animation
from cospeech.rotation import between, resample, resample_rotations
from cospeech.skeleton import LEFT_HAND, RIGHT_HAND, UPPER55, to_parent_relative

LIKELY = 0.75, 1.6  # metres of torso and arm, beyond which a guess of the unit makes a dwarf or a giant
JOINT = UPPER55.index


@dataclass
class ConvertedMotion:
    """Motion as a clip has it: positions (T, 55, 3), root (T, 3), head rotation (T, 3), confidence (T, 55)."""

    positions: np.ndarray
    rotation: np.ndarray
    root: np.ndarray
    confidence: np.ndarray


def read_mocap_take(
    motion,
    audio,
    skeleton=None,
    *,
    subject,
    clip,
    fps=15.0,
    start=0.0,
    end=None,
    words=None,
    units=None,
    up=None,
    audio_path="",
    body_model=None,
):
    """One take of motion capture as a `Clip`.

    motion: BVH, or SMPL-X parameters (.npz), whichever it holds; audio: any sound file that starts with it; skeleton:
    "zeggs", "beat" or the path of a mapping, which SMPL-X does not need; body_model: the SMPL-X model of its bones.
    Seconds `start` to `end` are taken (to the end of the shorter file by default), T = round(seconds * fps). `words` is
    a file of word times, by default the one beside the audio. `units` (m, cm, mm, inch, or metres in one) and `up`
    (x, y, z, -x, -y, -z) overrule the mapping; what neither tells is guessed, with a notice. `audio_path` becomes
    `clip.audio`.
    Raises CospeechError for files that do not fit the mapping or each other, and for takes outside the files.
    """
    from cospeech.speech import audio_duration, integrated_loudness, load_audio, speech_features
    from cospeech.speech.words import cut_words, find_words, read_words

    mapping, animation, seen = read_motion(motion, skeleton, body_model)
    seconds = audio_duration(audio)
    end = _end(motion, audio, len(animation) / animation.fps, seconds, start, end, fps)
    frames = round((end - start) * fps)
    if not frames:
        raise CospeechError(f"{motion}: the take from {start:g} s to {end:g} s has 0 frames at {fps:g} fps")
    converted = convert(animation, mapping, frames, fps=fps, start=start, units=units, up=up, name=motion)
    share = _share_seen(seen, animation.fps, fps, frames, start)
    converted.confidence *= share[:, None]
    samples, rate = load_audio(audio, start=start, end=min(end, seconds))
    spoken = read_words(words, Path(audio).stem, seconds) if words else find_words(audio, seconds)
    return Clip(
        subject,
        clip,
        float(fps),
        converted.positions.astype(np.float32),
        speech_features(samples, rate, fps=fps, frames=frames),
        confidence=converted.confidence.astype(np.float32),
        root=converted.root.astype(np.float32),
        rotation=converted.rotation.astype(np.float32),
        valid=share > 0,
        words=cut_words(spoken or Words.none(), start, end),
        audio=audio_path,
        sample_rate=rate,
        loudness_lufs=integrated_loudness(samples, rate),
        source=Path(motion).name,
        source_sha256=sha256(motion),
    ).validate(motion)


def read_motion(motion, skeleton=None, body_model=None):
    """(`Mapping`, `Animation`, seen (T,) bool) of a motion file, whose content and not its suffix says what it is."""
    if not zipfile.is_zipfile(motion):
        if skeleton is None:
            raise CospeechError(f"{motion}: needs 'skeleton': zeggs, beat or the path of a mapping (docs/mocap.md)")
        mapping, animation = load_mapping(skeleton), read_bvh(motion)
        return mapping, animation, np.ones(len(animation), bool)
    arrays = load_arrays(motion)
    if not is_smplx(arrays):
        shapes = ", ".join(f"{key} {array.shape}" for key, array in arrays.items())
        raise CospeechError(
            f"{motion}: no SMPL-X parameters ('poses', or 'global_orient' and 'body_pose'); it holds {shapes}"
        )
    animation, seen = smplx_animation(arrays, motion, body_model)
    return load_mapping("smplx" if skeleton in (None, "auto") else skeleton), animation, seen


def _share_seen(seen, rate, fps, frames, start):
    """(frames,) share of the file's frames within each of the clip's that were seen."""
    ends = (start + (np.arange(frames + 1) - 0.5) / fps) * rate
    first = np.clip(np.ceil(ends[:-1]).astype(int), 0, len(seen) - 1)
    last = np.clip(np.ceil(ends[1:]).astype(int), first + 1, None)  # at least the nearest one
    total = np.concatenate([[0], np.cumsum(seen)])
    return (total[np.minimum(last, len(seen))] - total[first]) / (np.minimum(last, len(seen)) - first)


def _end(motion, audio, moving, sounding, start, end, fps):
    """Where the take ends, in seconds, after checking it against both files' lengths."""
    both, frame = min(moving, sounding), 1 / fps
    lengths = f"{motion} lasts {moving:.3f} s, {audio} {sounding:.3f} s"
    if start < 0 or (end is not None and end <= start):
        raise CospeechError(f"{motion}: start {start:g} s and end {end} s; expected 0 <= start < end")
    if start >= both or (end or 0) > max(moving, sounding) + frame:
        span = f"{start:g} s" if end is None else f"{start:g} s to {end:g} s"
        raise CospeechError(f"{motion}: the take from {span} lies outside the recording ({lengths})")
    if abs(moving - sounding) > frame and (end is None or end > both + frame):
        notice(f"{lengths}; what both have is used, up to {both:.3f} s")
    return both if end is None else min(end, both)


def convert(animation, mapping, frames, fps=15.0, start=0.0, units=None, up=None, name="motion"):
    """An `Animation` in its file's units and axes -> `ConvertedMotion`: upper55 in the character's own axes at `fps`.

    Joint rotations and the root's path are resampled, and positions follow from them by forward kinematics, so bones
    keep their lengths. Heading (from hips and shoulders, smoothed over 0.5 s) is taken out of positions and head
    rotation; the root's path keeps its shape, turned so that the first frame faces +z.
    """
    check_choice(name, "up", up, AXES)
    points = mapping.bind(animation.names, name)
    rest, axes = _rest_pose(animation, mapping, points, name)
    declared = mapping.units if units is None else units
    scale = metres(name, _guess_units(points.weights @ rest[0][0], name) if declared is None else declared)
    moving, take = _resampled(animation, fps, frames, start)
    joints, turns = moving.forward_kinematics()
    positions = points.positions(joints, turns, scale)
    upright = Rotation.from_quat(between(AXES[up or mapping.up or _guess_up(positions, name)], UP))
    positions = upright.apply(positions.reshape(-1, 3)).reshape(positions.shape)
    _check_forward(points, positions, [upright.apply(joints[:, b] - joints[:, a]) for a, b in points.forward], name)

    def since_rest(joint):
        return upright * Rotation.from_quat(turns[:, joint]) * Rotation.from_quat(rest[1][0, joint]).inv()

    if not points.present.all():
        _add_hands(positions, points, points.positions(*rest, scale)[0], axes, since_rest, name)
    facing = facing_of(positions, fps)
    pelvis = positions[:, JOINT["pelvis"]]
    relative = np.einsum("tji,tkj->tki", facing.as_matrix(), positions - pelvis[:, None])
    rotation = (facing.inv() * since_rest(points.head) * axes).as_rotvec()
    root = facing[take][0].inv().apply(pelvis[take])
    return ConvertedMotion(relative[take], rotation[take], root, np.tile(points.present.astype(float), (frames, 1)))


def _resampled(animation, fps, frames, start):
    """The take at `fps`, with what the file has on both sides as far as it counts for the heading, and the take's place
    in that as a slice."""
    margin = round(4 * HEADING_SECONDS * fps)
    before = min(margin, int(start * fps))
    after = max(0, min(margin, int((len(animation) / animation.fps - start) * fps) - frames))
    rates = animation.fps, fps, before + frames + after, start - before / fps
    local = None if animation.local is None else resample(animation.local, *rates)
    rotations, translation = resample_rotations(animation.rotations, *rates), resample(animation.translation, *rates)
    moving = replace(animation, rotations=rotations, translation=translation, local=local, fps=fps)
    return moving, slice(before, before + frames)


def _rest_pose(animation, mapping, points, name):
    """Joint positions (1, J, 3) and rotations (1, J, 4) of the T-pose, and the rotation that takes the character's
    axes to the file's in it.

    That pose is all rotations zero, or the first frame if the mapping says so, or if zero is no standing figure.
    """
    zero = np.broadcast_to([0.0, 0.0, 0.0, 1.0], animation.rotations[:1].shape)
    poses = {
        "zero": replace(animation, rotations=zero, translation=np.zeros((1, 3)), local=None),
        "first": _cut_to_first(animation),
    }
    for choice in dict.fromkeys((mapping.rest, "first")):
        pose = poses[choice].forward_kinematics()
        axes = _character_axes(points.weights @ pose[0][0])
        if axes is not None:
            return pose, axes
        if choice == "zero":
            notice(
                f"{name}: with all rotations zero the skeleton is no standing figure; its first frame serves as the "
                "rest pose (as 'rest: first' in the mapping would say)"
            )
    raise CospeechError(f"{name}: the rest pose is no standing figure; check joints and sides in {mapping.source}")


def _cut_to_first(animation):
    local = None if animation.local is None else animation.local[:1]
    return replace(animation, rotations=animation.rotations[:1], translation=animation.translation[:1], local=local)


def _character_axes(points):
    """Rotation that takes x left, y up, z forward to the axes of one standing pose (55, 3), or None if it is none."""
    spine = points[JOINT["head_top"]] - points[JOINT["pelvis"]]
    up = np.sign(spine) * (np.abs(spine) == np.abs(spine).max())  # files stand along one of their axes
    if not np.linalg.norm(spine) or spine @ up < 0.8 * np.linalg.norm(spine):
        return None
    left = left_of(points[None])[0].sum(axis=0)
    left = left - up * (left @ up)
    if np.linalg.norm(left) < 0.5:
        return None
    left /= np.linalg.norm(left)
    return Rotation.from_matrix(np.stack([left, up, np.cross(left, up)], axis=1))


def _guess_units(points, name):
    """The unit in which pelvis, spine, neck and the arms, (55, 3) in file units, are nearest to an adult's size."""
    chains = (("pelvis", "spine", "neck"), *((f"{s}_shoulder", f"{s}_elbow", f"{s}_wrist") for s in ("left", "right")))
    trunk, *arms = (np.linalg.norm(np.diff(points[UPPER55.joints(*chain)], axis=0), axis=1).sum() for chain in chains)
    size = trunk + np.mean(arms)
    if not size:
        raise CospeechError(f"{name}: torso and arms have no length")
    unit = min(UNITS, key=lambda unit: abs(np.log(size * UNITS[unit] / TORSO_AND_ARM)))
    if not LIKELY[0] <= size * UNITS[unit] <= LIKELY[1]:
        raise CospeechError(
            f"{name}: no usual unit fits: torso and arm are {size:.4g} long, {size * UNITS[unit]:.2f} m in {unit}; an "
            f"adult's are about {TORSO_AND_ARM} m. Give the metres in one unit, as in 'units: "
            f"{TORSO_AND_ARM / size:.3g}', in the subject file's source or in the mapping"
        )
    notice(
        f"{name}: units are taken as {unit} (torso and arm measure {size * UNITS[unit]:.2f} m then); if they are not, "
        "declare 'units' in the subject file's source or in the mapping"
    )
    return unit


def _guess_up(positions, name):
    """The axis that points from the pelvis to the top of the head, on average."""
    spine = (positions[:, JOINT["head_top"]] - positions[:, JOINT["pelvis"]]).mean(axis=0)
    up = max(AXES, key=lambda axis: AXES[axis] @ spine)
    notice(f"{name}: the up axis is taken as {up} (from pelvis to head); declare 'up' if it is not")
    return up


def _check_forward(points, positions, ahead, name):
    """CospeechError if what points forward (feet, say) points backward: sides swapped, or left-handed axes."""
    forward = np.cross(left_of(positions).sum(axis=1), UP)
    if ahead and np.sum(forward * sum(ahead), axis=-1).mean() < 0:
        raise CospeechError(
            f"{name}: its feet point backward; left and right are swapped in the mapping, or the file's axes are "
            "left-handed"
        )


def _add_hands(positions, points, rest, axes, since_rest, name):
    """Fill in, in place, the hand joints that the recording lacks: a resting hand that turns with the wrist.

    rest (55, 3) metres: the rest pose; axes: the character's axes in it; since_rest(joint): the joint's turns from it.
    """
    lacking = [UPPER55.names[i] for i in np.flatnonzero(~points.present)]
    notice(f"{name}: {_listed(lacking)} not recorded; a resting hand stands in, with confidence 0")
    for side, sign in (("right", -1.0), ("left", 1.0)):
        elbow, wrist, root = UPPER55.joints(f"{side}_elbow", f"{side}_wrist", f"{side}_hand_root")
        forearm = rest[wrist] - rest[elbow]
        aside = axes.apply([sign, 0.0, 0.0])
        # the shortest turn from a T-pose's arm to this one keeps the palm as an arm does that sinks to the side
        onto = Rotation.from_quat(between(aside, forearm)) * axes
        turn = since_rest(points.anchors[wrist])
        for finger, bones in rest_hand(np.linalg.norm(forearm) / REST_FOREARM, sign).items():
            parent = root
            for joint, bone in zip(UPPER55.joints(*(f"{side}_{finger}_{i}" for i in range(4))), bones, strict=True):
                if not points.present[joint]:
                    positions[:, joint] = positions[:, parent] + turn.apply(onto.apply(bone))
                parent = joint


def _listed(names):
    """The names, or "right hand: all fingers" where a whole hand is among them."""
    texts = []
    for side, joints in (("right", RIGHT_HAND), ("left", LEFT_HAND)):
        own = [name for name in names if name.startswith(side)]
        texts += [f"{side} fingers"] if len(own) == joints.stop - joints.start - 1 else own
    return ", ".join(texts)


def check_mapping(skeleton, motion):
    """Try a mapping on a recording, for those who write one.

    Returns {upper55 joint: (length of the bone that ends in it, range of that length over time)} in metres. Raises
    CospeechError where the mapping does not fit; notices tell what was guessed.
    """
    mapping, animation = load_mapping(skeleton), read_bvh(motion)
    converted = convert(animation, mapping, len(animation), fps=animation.fps, name=motion)
    lengths = np.linalg.norm(to_parent_relative(converted.positions), axis=-1)
    return {n: (float(np.median(lengths[:, i])), float(np.ptp(lengths[:, i]))) for n, i in JOINT.items()}
