"""Bodies, hands and faces of the synthetic people against published proportions and joint limits."""

import numpy as np
import pytest

from cospeech.face.expressions import COSPEECH64
from cospeech.people import faces
from cospeech.people.anthropometry import INDEX, draw_build
from cospeech.people.dice import Dice
from cospeech.people.poses import Arm, Pose, draw_pose, pose_people

COUNT = 600


@pytest.fixture(scope="module")
def crowd():
    """Build and joints of 600 grown people, each in a pose."""
    dice = Dice(3, ("bodies",), range(COUNT))
    build = draw_build(dice)
    joints, _ = pose_people(build, draw_pose(dice, lively_hands=0.6))
    return build, joints


def bone(joints, start, end):
    return joints[:, INDEX[end]] - joints[:, INDEX[start]]


def angle(a, b):
    """Degrees between directions (N, 3)."""
    cos = np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return np.degrees(np.arccos(np.clip(cos, -1, 1)))


@pytest.mark.parametrize(
    ("start", "end", "share"),  # of stature, Drillis & Contini (1966)
    [("elbow", "wrist", 0.146), ("hip", "knee", 0.245), ("knee", "ankle", 0.246)],
)
def test_limbs_have_the_published_shares_of_stature(crowd, start, end, share):
    build, joints = crowd
    for side in ("left", "right"):
        ratio = np.linalg.norm(bone(joints, f"{side}_{start}", f"{side}_{end}"), axis=1) / build.stature
        assert ratio.mean() == pytest.approx(share, rel=0.02)
        assert ratio.min() > 0.89 * share and ratio.max() < 1.11 * share


def test_statures_are_those_of_men_and_women(crowd):
    """Means 1.756 m and 1.629 m (ANSUR II, 2012), within three standard errors."""
    build, _ = crowd
    for female, mean, deviation in ((False, 1.756, 0.069), (True, 1.629, 0.064)):
        own = build.stature[build.female == female]
        assert abs(own.mean() - mean) < 3 * deviation / np.sqrt(len(own))
        assert own.std() == pytest.approx(deviation, rel=0.15)


def test_a_person_who_stands_straight_is_as_tall_as_their_stature(crowd):
    build, _ = crowd
    zero = np.zeros((COUNT, 3))
    arm = Arm(np.tile([0.1, -0.95, 0.05], (COUNT, 1)), np.zeros((COUNT, 4)), np.zeros((COUNT, 8)))
    legs = {side: np.zeros((COUNT, 5)) for side in ("left", "right")}
    joints, head = pose_people(build, Pose({"left": arm, "right": arm}, zero, zero, legs, zero[:, 0], zero[:, 0]))
    soles = joints[:, INDEX["left_ankle"], 1] - 0.039 * build.stature  # the ankle's height, Drillis & Contini
    height = joints[:, INDEX["head_top"], 1] - soles
    assert np.median(height / build.stature) == pytest.approx(1, abs=0.015)
    assert np.abs(height / build.stature - 1).max() < 0.08
    assert np.abs(head - np.eye(3)).max() < 1e-12
    assert (bone(joints, "right_shoulder", "left_shoulder")[:, 0] > 0.25).all()  # x points to the person's left
    for side in ("left", "right"):  # arms hang with the thumbs ahead and the palms to the thighs
        fingers = bone(joints, f"{side}_hand_root", f"{side}_middle_0")
        thumb = bone(joints, f"{side}_little_0", f"{side}_index_0")
        assert (fingers[:, 1] < 0).all() and (thumb[:, 2] > 0).all()
        assert (np.cross(fingers, thumb)[:, 0] < 0).all()  # for both hands the same: one palm looks left, one right


def test_elbows_and_knees_bend_as_far_as_they_can_and_the_right_way(crowd):
    _, joints = crowd
    for side in ("left", "right"):
        upper, fore = bone(joints, f"{side}_shoulder", f"{side}_elbow"), bone(joints, f"{side}_elbow", f"{side}_wrist")
        flexion = angle(upper, fore)
        assert flexion.max() <= 150.5 and flexion.min() > 0 and np.ptp(flexion) > 100
        thigh, shank = bone(joints, f"{side}_hip", f"{side}_knee"), bone(joints, f"{side}_knee", f"{side}_ankle")
        assert angle(thigh, shank).max() <= 135.5
        axis = bone(joints, "right_hip", "left_hip")
        assert (np.sum(np.cross(thigh, shank) * axis, axis=1) > -1e-3).all()  # heels go back, never forward
        assert angle(thigh, np.array([[0.0, -1.0, 0.0]])).max() <= 121


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "little"])
def test_fingers_bend_within_their_limits_towards_the_palm(crowd, finger):
    _, joints = crowd
    for side, sign in (("left", 1), ("right", -1)):
        palm = sign * np.cross(
            bone(joints, f"{side}_hand_root", f"{side}_middle_0"), bone(joints, f"{side}_little_0", f"{side}_index_0")
        )
        bones = [bone(joints, f"{side}_{finger}_{i}", f"{side}_{finger}_{i + 1}") for i in range(3)]
        for near, far, limit in ((bones[0], bones[1], 100), (bones[1], bones[2], 90)):
            assert angle(near, far).max() <= limit + 0.5
            bent = angle(near, far) > 20
            turn = np.cross(near, far)[bent]
            thumbwards = bone(joints, f"{side}_little_0", f"{side}_index_0")[bent]
            assert (sign * np.sum(turn * thumbwards, axis=1) < 0).all()
        knuckle = 90 - angle(bones[0], palm)  # out of the palm's plane, towards its inside
        assert knuckle.max() > 50 and knuckle.min() > -45


def test_wrists_bend_within_their_limits(crowd):
    """Flexion 80, extension 70, 30 and 20 degrees to the sides (AAOS): the hand's axis against the forearm."""
    _, joints = crowd
    for side in ("left", "right"):
        fore = bone(joints, f"{side}_elbow", f"{side}_wrist")
        hand = bone(joints, f"{side}_hand_root", f"{side}_middle_0")
        assert angle(fore, hand).max() <= 85  # 80 and 30 together, less the middle knuckle's own 2 degrees


def test_hands_stay_out_of_the_trunk(crowd):
    """Wrists below the shoulders keep in front of the spine by half a trunk, or beside it."""
    build, joints = crowd
    for side in ("left", "right"):
        wrist = (joints[:, INDEX[f"{side}_wrist"]] - joints[:, INDEX["spine"]]) / build.stature[:, None]
        beside, low = np.abs(wrist[:, 0]) > 0.075, np.abs(wrist[:, 1]) < 0.08
        assert (wrist[low & ~beside, 2] > 0.03).mean() > 0.97


def test_people_do_all_that_talking_people_do(crowd):
    _, joints = crowd
    wrist = {
        side: joints[:, INDEX[f"{side}_wrist"]] - joints[:, INDEX[f"{side}_shoulder"]] for side in ("left", "right")
    }
    raised = (wrist["left"][:, 1] > 0) | (wrist["right"][:, 1] > 0)
    both = (wrist["left"][:, 2] > 0.2) & (wrist["right"][:, 2] > 0.2)
    crossed = joints[:, INDEX["left_wrist"], 0] < joints[:, INDEX["right_wrist"], 0]
    seated = bone(joints, "left_hip", "left_knee")[:, 2] > 0.25
    for share, low, high in ((raised, 0.1, 0.4), (both, 0.25, 0.8), (crossed, 0.02, 0.3), (seated, 0.1, 0.35)):
        assert low < share.mean() < high


def test_landmarks_mirror_each_other_and_follow_the_named_coefficients():
    rest = faces.skin(np.zeros((1, 8)), np.zeros((1, 64)))[0]
    assert np.abs(rest[faces.TWIN] - rest * [-1, 1, 1]).max() < 1e-12
    assert (faces.TWIN[faces.TWIN] == np.arange(97)).all()

    def moved(*names):
        weights = np.zeros((1, 64))
        weights[0, [COSPEECH64.index(name) for name in names]] = 1
        return faces.skin(np.zeros((1, 8)), weights)[0] - rest

    assert moved("jaw_open")[8, 1] < -0.025 and abs(moved("jaw_open")[36:48]).max() == 0  # the chin, not the eyes
    assert moved("eye_blink_left")[43, 1] < -0.008 and abs(moved("eye_blink_left")[36:42]).max() == 0
    assert moved("mouth_smile_left")[54, 1] > 0.005 and moved("mouth_smile_left")[54, 0] > 0.005
    both = moved("mouth_smile_left", "mouth_smile_right", "brow_inner_up")
    assert np.abs(both[faces.TWIN] - both * [-1, 1, 1]).max() < 1e-12


def test_the_skin_faces_outwards():
    skin = faces.skin(np.zeros((1, 8)), np.zeros((1, 64)))
    normals = faces.normals(skin)[0]
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)
    assert (normals[[30, 95, 8], 2] > 0.5).all()  # nose, forehead and chin look ahead
    assert normals[1, 0] < -0.3 < 0.3 < normals[15, 0]  # the right jaw looks to the right


def test_draws_are_the_same_alone_and_in_company():
    alone, together = Dice(5, ("a",), [7]), Dice(5, ("a",), range(10))
    for _ in range(30):
        assert alone.normal(count=20)[0].tobytes() == together.normal(count=20)[7].tobytes()
    assert (Dice(5, ("b",), [7]).uniform(count=5) != Dice(5, ("a",), [7]).uniform(count=5)).all()
    values = Dice(1, ("c",), range(4000))
    assert values.uniform(2, 4).mean() == pytest.approx(3, abs=0.03)
    assert np.bincount(values.choice([1, 3])) / 4000 == pytest.approx([0.25, 0.75], abs=0.03)
