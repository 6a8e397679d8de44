"""Level tables and bone vectors: the published numbers, angles by hand, and the way to a motion and back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.gestures.ha2g.dataset.bones import (
    PLACES,
    Proportions,
    bone_vectors,
    mean_lengths,
    measure_proportions,
    motion_from_vectors,
    positions_from_vectors,
    table_joints,
)
from cospeech.gestures.ha2g.dataset.levels import included_angles, level_table
from cospeech.skeleton import LEFT_HAND, RIGHT_HAND, UPPER55, bone_lengths
from tests.conftest import make_clip


@pytest.mark.parametrize(
    ("name", "joints", "dims", "angles"),
    [("expressive43", 43, [24, 30, 36, 66, 96, 126], 41), ("ted10", 10, [15, 21, 27], 4)],
)
def test_levels_have_the_published_sizes(name, joints, dims, angles):
    table = level_table(name)
    assert (len(table.joints), table.angles, table.vectors) == (joints, angles, joints - 1)
    assert [table.dims(level) for level in range(len(table.levels))] == dims
    assert sorted(np.concatenate(table.levels)) == list(range(table.vectors))
    assert set(table.places) <= set(PLACES) and table.lengths.min() > 0.02
    assert sorted(table.bones[:, 1]) == list(range(1, joints)), "every joint but the first ends one bone"
    assert all(parent in {0, *table.bones[:i, 1]} for i, (parent, _) in enumerate(table.bones)), "parents first"


def test_channels_are_the_vectors_coordinates():
    table = level_table("ted10")
    assert table.channels(0).tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 18, 19, 20]


def test_unknown_level_table_is_one_line():
    with pytest.raises(CospeechError, match="known: expressive43, ted10"):
        level_table("smplx")


def test_sides_and_fingers_are_told_apart():
    """The left wrist's bones lead to the left hand, and the left is where +x is."""
    clip, table = make_clip(3), level_table("expressive43")
    joints = table_joints(clip.positions, clip.rotation, table)
    for side in ("left", "right"):
        for name in (f"{side}_wrist", f"{side}_little_1"):
            expected = clip.positions[:, UPPER55.index[name]]
            np.testing.assert_array_equal(joints[:, table.joints.index(name)], expected)
    upright = np.zeros((1, 55, 3))
    face = table_joints(upright, np.zeros((1, 3)), table)[0]
    assert face[table.joints.index("left_ear"), 0] > 0.05 > -0.05 > face[table.joints.index("right_ear"), 0]
    assert face[table.joints.index("nose"), 2] > 0.05


def test_angles_by_hand():
    table = level_table("ted10")
    vectors = np.tile([1.0, 0.0, 0.0], (9, 1))
    vectors[4] = [0.0, 2.0, 0.0]  # 90 degrees from 3, any length
    vectors[5] = [0.0, -1.0, 0.0]  # opposite to 4
    np.testing.assert_allclose(included_angles(vectors, table), [0.5, 1.0, 0.0, 0.0], atol=1e-6)


def test_palm_normal_by_hand():
    table = level_table("expressive43")
    vectors = np.tile([0.0, 0.0, 1.0], (42, 1))
    vectors[11], vectors[17] = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]  # their cross product is +z, as the forearm
    vectors[28], vectors[34] = [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]  # -z
    np.testing.assert_allclose(included_angles(vectors, table)[-2:], [0.0, 1.0], atol=1e-6)


def test_vectors_are_of_unit_length_and_lengths_bring_the_joints_back():
    clip, table = make_clip(1), level_table("expressive43")
    vectors = bone_vectors(clip.positions, clip.rotation, table)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 1, atol=1e-5)
    rebuilt = positions_from_vectors(vectors, mean_lengths([clip], table), table)
    joints = table_joints(clip.positions, clip.rotation, table)
    body = slice(0, 38)  # whose bones are rigid in this clip; the head turns freely
    np.testing.assert_allclose(rebuilt[:, body], joints[:, body] - joints[:, :1], atol=1e-5)


def lifelike(frames=40):
    """A clip whose lower trunk rests and whose skull is rigid: what the level tables can tell."""
    clip = make_clip(5, frames)
    positions, turn = clip.positions.astype(float), Rotation.from_rotvec(clip.rotation)
    shift = positions[:, [UPPER55.index["spine"]]] - positions[0, UPPER55.index["spine"]]
    positions -= shift
    for name in ("pelvis", "left_hip", "right_hip"):
        positions[:, UPPER55.index[name]] = positions[0, UPPER55.index[name]]
    neck, head, top = UPPER55.joints("neck", "head", "head_top")
    positions[:, head] = positions[:, neck] + turn.apply([0.0, 0.11, 0.04])
    positions[:, top] = positions[:, head] + turn.apply([0.0, 0.14, -0.02])
    clip.positions = (positions - positions[:, [UPPER55.root]]).astype(np.float32)
    return clip


def test_to_vectors_and_back_is_the_same_motion():
    clip, table = lifelike(), level_table("expressive43")
    figure = Proportions.of(measure_proportions([clip], table).lists())
    motion = motion_from_vectors(bone_vectors(clip.positions, clip.rotation, table), table, figure)
    tips = [joint for name, joint in UPPER55.index.items() if name.endswith("_3")]
    known = [joint for joint in range(55) if joint not in tips]
    np.testing.assert_allclose(motion.positions[:, known], clip.positions[:, known], atol=2e-4)
    np.testing.assert_allclose(motion.rotation, clip.rotation, atol=2e-3)
    assert not motion.positions[:, UPPER55.root].any()


def test_without_hands_the_bones_still_keep_their_lengths():
    clip, table = lifelike(), level_table("ted10")
    figure = measure_proportions([clip], table)
    motion = motion_from_vectors(bone_vectors(clip.positions, clip.rotation, table), table, figure)
    wrists = UPPER55.joints("right_wrist", "left_wrist")
    np.testing.assert_allclose(motion.positions[:, wrists], clip.positions[:, wrists], atol=2e-4)
    np.testing.assert_allclose(bone_lengths(motion.positions), bone_lengths(clip.positions), atol=1e-4)
    hands = [
        motion.positions[:, hand] - motion.positions[:, [wrist]]
        for hand, wrist in zip((RIGHT_HAND, LEFT_HAND), wrists, strict=True)
    ]
    for hand in hands:
        assert np.ptp(np.linalg.norm(hand, axis=-1), axis=0).max() < 1e-4, "a hand is carried as it is"


def test_bones_of_any_vectors_are_the_figures():
    table = level_table("expressive43")
    figure = measure_proportions([lifelike()], table)
    vectors = np.random.default_rng(0).normal(size=(20, 42, 3))
    lengths = bone_lengths(figure.rest[None])
    found = np.linalg.norm(np.diff(motion_from_vectors(vectors, table, figure).positions[:, [3, 4]], axis=1), axis=-1)
    np.testing.assert_allclose(found, lengths[4], rtol=1e-4)


def test_two_speakers_mix_by_weight():
    table = level_table("ted10")
    one, two = measure_proportions([lifelike()], table), measure_proportions([make_clip(9, 40)], table)
    np.testing.assert_allclose(Proportions.mixed([one, two], [0.25, 0.75]).rest, one.rest / 4 + two.rest * 0.75)
    np.testing.assert_allclose(Proportions.mixed([one, two], [1.0, 0.0]).lengths, one.lengths)
