"""The published layout, and the maths on it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cospeech.errors import CospeechError
from cospeech.skeleton import (
    BODY,
    LEFT_HAND,
    RIGHT_HAND,
    UPPER55,
    bone_lengths,
    from_parent_relative,
    to_parent_relative,
    with_bone_lengths,
)

# As printed in the published annotation's README (root -1).
PUBLISHED_PARENTS = [
    *(1, 11, 1, 2, 3, 1, 5, 6),
    *(10, 10, -1, 10, 1),
    *(13, 13, 14, 15, 13, 17, 18, 13, 20, 21, 13, 23, 24, 13, 26, 27, 16, 19, 22, 25, 28),
    *(34, 34, 35, 36, 34, 38, 39, 34, 41, 42, 34, 44, 45, 34, 47, 48, 37, 40, 43, 46, 49),
]


def poses(seed, frames=5):
    return np.random.default_rng(seed).normal(size=(frames, 55, 3))


def test_parents_are_the_published_ones():
    assert list(UPPER55.parents) == PUBLISHED_PARENTS


def test_names_follow_the_published_ids():
    published = {0: "head_top", 4: "right_wrist", 7: "left_wrist", 10: "pelvis", 13: "right_hand_root"}
    published |= {14: "right_index_0", 20: "right_little_0", 29: "right_index_3", 33: "right_thumb_3"}
    published |= {35: "left_index_0", 54: "left_thumb_3"}
    assert {i: UPPER55.names[i] for i in published} == published


def test_hands_are_cut_where_their_roots_are():
    assert UPPER55.names[RIGHT_HAND][0] == "right_hand_root"
    assert UPPER55.names[LEFT_HAND][0] == "left_hand_root"
    assert (BODY.stop, RIGHT_HAND.stop, LEFT_HAND.stop) == (13, 34, 55)


def test_tree_joins_hands_at_wrists_and_orders_parents_first():
    assert UPPER55.tree[13] == 4 and UPPER55.tree[34] == 7
    seen = set()
    for joint in UPPER55.order:
        assert UPPER55.tree[joint] in seen or joint == UPPER55.root
        seen.add(joint)
    assert len(seen) == 55


def test_mirror_swaps_sides_and_is_its_own_inverse():
    assert UPPER55.names[UPPER55.mirror[2]] == "left_shoulder"
    assert UPPER55.mirror[10] == 10
    assert (UPPER55.mirror[UPPER55.mirror] == np.arange(55)).all()


def test_unknown_joint_is_named():
    with pytest.raises(CospeechError, match="left_toe"):
        UPPER55.joints("left_wrist", "left_toe")


@given(st.integers(0, 2**32 - 1))
def test_parent_relative_round_trip(seed):
    x = poses(seed)
    np.testing.assert_allclose(from_parent_relative(to_parent_relative(x)), x, atol=1e-12)


def test_parent_relative_is_the_difference_to_the_parent():
    x = poses(0)
    relative = to_parent_relative(x)
    np.testing.assert_allclose(relative[:, 3], x[:, 3] - x[:, 2])
    np.testing.assert_allclose(relative[:, 13], x[:, 13] - x[:, 4])
    np.testing.assert_allclose(relative[:, 10], x[:, 10])


def test_bone_lengths_can_be_set_without_turning_bones():
    x, lengths = poses(1), np.abs(poses(2)[0, :, 0]) + 0.1
    changed = with_bone_lengths(x, lengths)
    expected = np.where(np.arange(55) == UPPER55.root, 0, lengths)
    np.testing.assert_allclose(bone_lengths(changed), expected, atol=1e-9)
    a, b = to_parent_relative(x), to_parent_relative(changed)
    cosine = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    np.testing.assert_allclose(np.delete(cosine, UPPER55.root, 1), 1, atol=1e-9)
