"""Positions to rotations: exact on rigid motion, calm on noise, and the twist where an animator expects it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from cospeech.formats.ik import FINGERS, INDEX, NAMES, SOURCES, animation_from_clip
from cospeech.formats.mocap import read_mocap_take
from cospeech.skeleton import LEFT_HAND, RIGHT_HAND, UPPER55, bone_lengths
from tests.formats.figure import FPS, clip_of, offsets, pose, steps

SIDES = ("Left", "Right")
PHALANGES = [INDEX[f"{side}Hand{finger}{k}"] for side in SIDES for finger in FINGERS for k in (1, 2, 3)]


def world_error(animation, clip):
    """Distances (T, 55) in metres between the animation's joints and the clip's, both in the world."""
    positions, _ = animation.forward_kinematics()
    root = animation.translation if clip.root is None else clip.root
    return np.linalg.norm(positions - (clip.positions + root[:, None])[:, SOURCES], axis=-1)


def between(animation, name, expected):
    """Degrees (T,) between a joint's local rotations and the expected `Rotation`."""
    found = Rotation.from_quat(animation.rotations[:, INDEX[name]])
    return np.degrees((found.inv() * expected).magnitude())


def wander(frames, size, seed, names=NAMES, smooth=4.0):
    """Smooth random rotations of about `size` radians for each name."""
    noise = np.random.default_rng(seed).normal(size=(len(names), frames, 3))
    curves = gaussian_filter1d(noise, smooth, axis=1, mode="nearest") * size * np.sqrt(2 * np.sqrt(np.pi) * smooth)
    return dict(zip(names, curves, strict=True))


def test_a_t_pose_has_no_rotations():
    animation = animation_from_clip(clip_of(pose(5)))
    assert steps(np.stack([animation.rotations, np.broadcast_to([0, 0, 0, 1.0], (5, 55, 4))])).max() < 1e-4
    np.testing.assert_allclose(animation.offsets[:], offsets(), atol=1e-9)


def test_skeleton_is_55_joints_parents_first_with_mixamo_names():
    animation = animation_from_clip(clip_of(pose(2)))
    assert len(animation.names) == len(set(animation.names)) == 55
    assert all(parent < joint for joint, parent in enumerate(animation.parents))
    assert {"Hips", "Spine", "RightShoulder", "LeftForeArm", "RightHandIndex1", "LeftHandPinky4"} <= set(NAMES)
    assert animation.fps == FPS and animation.rotations.shape == (2, 55, 4)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, np.pi))
def test_any_rigid_motion_comes_back_exactly(seed, size):
    rng = np.random.default_rng(seed)
    turns = {name: rng.uniform(-1, 1, (8, 3)) * size for name in NAMES}
    truth = pose(8, turns, root=rng.normal(size=(8, 3)))
    clip = clip_of(truth)
    animation = animation_from_clip(clip)
    assert world_error(animation, clip).max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(animation.rotations, axis=-1), 1.0, atol=1e-9)
    lengths = np.linalg.norm(animation.offsets, axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(truth.offsets, axis=1), atol=1e-9)


def test_single_precision_costs_less_than_a_tenth_of_a_millimetre():
    clip = clip_of(pose(60, wander(60, 0.5, seed=3)))
    clip.positions = clip.positions.astype(np.float32)
    straight = clip_of(pose(60, {"Hips": wander(60, 0.5, seed=4)["Hips"]}))
    straight.positions = straight.positions.astype(np.float32)
    assert world_error(animation_from_clip(clip), clip).max() < 1e-4
    assert world_error(animation_from_clip(straight), straight).max() < 1e-4


@pytest.mark.parametrize("side", SIDES)
def test_elbow_is_a_hinge_and_the_forearm_carries_the_twist(side):
    frames, s = 40, 1 if side == "Left" else -1
    bend = np.linspace(0.7, 1.9, frames)[:, None] * np.array([0, -s, 0])  # brings the forearm forward
    pronation = np.linspace(-1.2, 1.2, frames)[:, None] * np.array([s, 0, 0])
    wave = np.linspace(0.5, -0.5, frames)[:, None] * np.array([0, 0, s])
    forearm = Rotation.from_rotvec(bend) * Rotation.from_rotvec(pronation)
    turns = {f"{side}ForeArm": forearm, f"{side}Hand": wave, f"{side}HandIndex2": 0.8 * np.array([0, 0, -s])}
    animation = animation_from_clip(clip_of(pose(frames, turns)))
    for name, turn in turns.items():
        expected = turn if isinstance(turn, Rotation) else Rotation.from_rotvec(turn)
        assert between(animation, name, expected).max() < 1e-3, name
    assert between(animation, f"{side}Arm", Rotation.identity()).max() < 1e-3


def test_upper_arm_roll_is_read_from_the_elbow_plane():
    roll = 0.8 * np.sin(np.arange(90) / 8)[:, None] * np.array([1, 0, 0])
    turns = {"LeftArm": roll, "LeftForeArm": np.array([0, -1.3, 0])}
    animation = animation_from_clip(clip_of(pose(90, turns)))
    assert between(animation, "LeftArm", Rotation.from_rotvec(roll)).max() < 2.0
    assert between(animation, "LeftForeArm", Rotation.from_rotvec(turns["LeftForeArm"])).max() < 2.0


def test_hips_spine_and_head_turn_as_recorded():
    turns = wander(60, 0.3, seed=1, names=("Hips", "Spine"))
    nod = wander(60, 0.3, seed=2, names=("Head",))
    truth = pose(60, turns | nod)
    _, world = truth.forward_kinematics()
    head = Rotation.from_quat(world[:, INDEX["Head"]])
    animation = animation_from_clip(clip_of(truth, rotation=head.as_rotvec()))
    for name, turn in turns.items():
        assert between(animation, name, Rotation.from_rotvec(turn)).max() < 1e-3
    _, found = animation.forward_kinematics()
    assert np.degrees((Rotation.from_quat(found[:, INDEX["Head"]]).inv() * head).magnitude()).max() < 1e-3


def test_head_and_neck_share_a_turn_that_positions_do_not_show():
    yaw = np.array([0, 0.9, 0])
    still = animation_from_clip(clip_of(pose(4)))
    turned = animation_from_clip(clip_of(pose(4), rotation=np.tile(yaw, (4, 1))))
    for name in ("Neck", "Head"):
        assert between(still, name, Rotation.identity()).max() < 1e-4
        assert between(turned, name, Rotation.from_rotvec(yaw / 2)).max() < 1e-3


def talking(frames, curl=1.2, bend=1.3):
    """A seated talker: upper arms down, elbows bent, fingers curling slowly (period of 4 s)."""
    curling = curl * (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frames) / (4 * FPS)))[:, None]
    turns = {}
    for side, s in (("Left", 1), ("Right", -1)):
        turns |= {f"{side}Arm": np.array([0, 0, -1.2 * s]), f"{side}ForeArm": np.array([0, -bend * s, 0])}
        for finger in FINGERS[1:]:
            turns |= {f"{side}Hand{finger}{k}": curling * np.array([0, 0, -s]) for k in (1, 2, 3)}
    return pose(frames, turns)


@pytest.mark.parametrize("noise", [0.001, 0.002, 0.005])
def test_jitter_does_not_spin_fingers(noise):
    truth = talking(300)
    clip = clip_of(truth, noise=noise)
    animation = animation_from_clip(clip)
    turning = steps(animation.rotations)[:, PHALANGES]
    assert turning.max() < 25 and np.percentile(turning, 99) < 15  # unsmoothed at 5 mm: 177 and 94
    curls = [f"{side}Hand{finger}2" for side in SIDES for finger in FINGERS[1:]]
    off = [between(animation, name, Rotation.from_quat(truth.rotations[:, INDEX[name]])).mean() for name in curls]
    assert np.mean(off) < 12  # the curl itself, up to 69 degrees, is still there
    assert world_error(animation, clip).mean() < 2.5 * noise


def test_clean_fast_fingers_are_not_smoothed():
    truth = pose(60, {"RightHandIndex1": np.outer(np.arange(60) % 2, [0, 0, 0.8])})
    clip = clip_of(truth)
    assert world_error(animation_from_clip(clip), clip).max() < 1e-6


@pytest.mark.parametrize("side", SIDES)
def test_a_straight_noisy_arm_does_not_roll(side):
    s = 1 if side == "Left" else -1
    hanging = pose(200, {f"{side}Arm": np.array([0, 0, -1.4 * s]), f"{side}ForeArm": np.array([0, -0.03 * s, 0])})
    animation = animation_from_clip(clip_of(hanging, noise=0.003))
    for part, bound in (("Arm", 15), ("ForeArm", 20), ("Hand", 20)):
        assert steps(animation.rotations)[:, INDEX[side + part]].max() < bound, part


def test_an_arm_that_straightens_and_bends_again_does_not_flip():
    bend = 1.4 * np.abs(np.cos(2 * np.pi * np.arange(120) / 60))
    turns = {"RightArm": np.array([0, 0, 1.2]), "RightForeArm": np.outer(bend, [0, 1, 0])}
    truth = pose(120, turns)
    animation = animation_from_clip(clip_of(truth, noise=0.001))
    extra = steps(animation.rotations) - steps(truth.rotations)
    assert np.abs(extra[:, [INDEX[f"Right{part}"] for part in ("Arm", "ForeArm", "Hand")]]).max() < 15


def test_wrists_are_reached_although_the_shoulders_change_their_distance():
    clip = clip_of(pose(120, {"LeftArm": np.array([0, -1.5, 0]), "LeftForeArm": np.array([0, -1.3, 0])}))
    shrug = 0.012 * np.sin(np.arange(120) / 5)
    shoulder, neck = UPPER55.joints("left_shoulder", "neck")
    outward = clip.positions[:, shoulder] - clip.positions[:, neck]
    clip.positions[:, shoulder] += outward / np.linalg.norm(outward, axis=-1, keepdims=True) * shrug[:, None]
    error = world_error(animation_from_clip(clip), clip)
    assert error[:, INDEX["LeftArm"]].max() > 0.01  # constant bones cannot follow the shoulder
    assert error[:, INDEX["LeftHand"]].max() < 3e-4
    assert error[:, INDEX["LeftHandIndex4"]].max() < 3e-4


def test_a_wrist_out_of_reach_leaves_a_straight_arm_towards_it():
    clip = clip_of(talking(30, bend=0.4))
    clip.positions[10:12, LEFT_HAND] += [0, -0.5, 0]
    clip.positions[10:12, UPPER55.joints("left_wrist")] += [0, -0.5, 0]
    animation = animation_from_clip(clip)
    positions, _ = animation.forward_kinematics()
    shoulder, elbow, wrist = (positions[10, INDEX[f"Left{part}"]] for part in ("Arm", "ForeArm", "Hand"))
    assert np.linalg.norm(np.cross(elbow - shoulder, wrist - shoulder)) < 0.02 * np.linalg.norm(wrist - shoulder) ** 2
    assert np.isfinite(animation.rotations).all()


def test_bones_are_the_clips_medians():
    clip = clip_of(talking(50), noise=0.004)
    animation = animation_from_clip(clip)
    arm, forearm = UPPER55.joints("left_elbow", "left_wrist")
    lengths = np.linalg.norm(animation.offsets, axis=1)
    expected = bone_lengths(clip.positions)
    np.testing.assert_allclose(lengths[[INDEX["LeftForeArm"], INDEX["LeftHand"]]], expected[[arm, forearm]], rtol=1e-9)


def test_neighbouring_frames_have_neighbouring_quaternions():
    spin = np.outer(np.linspace(0, 4 * np.pi, 90), [0, 1, 0])
    rotations = animation_from_clip(clip_of(pose(90, {"Hips": spin}))).rotations
    assert np.sum(rotations[1:] * rotations[:-1], axis=-1).min() > 0.9


def test_root_follows_the_clip_or_stands_at_hip_height():
    path = np.cumsum(np.full((20, 3), 0.01), axis=0)
    clip = clip_of(pose(20, root=path))
    np.testing.assert_array_equal(animation_from_clip(clip).translation, path)
    clip.root = None
    height = animation_from_clip(clip).translation
    assert np.ptp(height, axis=0).max() == 0 and 0.7 < height[0, 1] < 1.0


def test_missing_fingers_and_a_single_frame_stay_finite():
    clip = clip_of(talking(1))
    for side, fingers in (("left", LEFT_HAND), ("right", RIGHT_HAND)):
        clip.positions[:, fingers] = clip.positions[:, UPPER55.joints(f"{side}_wrist")]
    animation = animation_from_clip(clip)
    assert np.isfinite(animation.rotations).all()
    assert between(animation, "LeftHand", Rotation.identity()).max() < 1e-3  # the hand just continues the forearm
    np.testing.assert_allclose(np.linalg.norm(animation.rotations, axis=-1), 1.0, atol=1e-9)


def test_real_mocap_stays_within_three_millimetres(recordings):
    folder = recordings / "speech_motion" / "zeggs_067"
    motion, audio = next(folder.glob("*.bvh")), next(folder.glob("*.wav"))
    clip = read_mocap_take(motion, audio, "zeggs", subject="zeggs", clip="067")
    error = world_error(animation_from_clip(clip), clip)
    assert error.mean() < 0.003
    assert error.max() < 0.03  # the shoulders, whose clavicles here keep one length
    assert error[:, [INDEX["LeftHand"], INDEX["RightHand"]]].max() < 0.001
