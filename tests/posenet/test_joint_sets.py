"""The joint sets of MPI-INF-3DHP as its owners and users print them, and the maps between them."""

from cospeech.posenet import EVALUATED, JOINTS17, JOINTS21, JOINTS28
from cospeech.skeleton import UPPER55


def test_the_28_have_the_published_parents():
    published = [2, 0, 3, 4, -1, 1, 5, 6, 5, 8, 9, 10, 11, 5, 13, 14, 15, 16, 4, 18, 19, 20, 21, 4, 23, 24, 25, 26]
    assert list(JOINTS28.parents) == published


def test_the_relevant_17_sit_where_the_owners_say_in_the_28():
    published = [7, 5, 14, 15, 16, 9, 10, 11, 23, 24, 25, 18, 19, 20, 4, 3, 6]
    assert JOINTS28.joints(*JOINTS17.names) == published


def test_the_21_are_the_17_with_hands_and_toes():
    assert JOINTS21.names[:17] == JOINTS17.names
    assert JOINTS28.joints(*JOINTS21.names[17:]) == [17, 12, 27, 22]
    parents = [16, 15, 1, 2, 3, 1, 5, 6, 14, 8, 9, 14, 11, 12, -1, 14, 1, 4, 7, 10, 13]
    assert list(JOINTS21.parents) == parents and list(JOINTS17.parents) == parents[:17]


def test_every_set_is_one_tree_with_two_sides():
    for skeleton in (JOINTS28, JOINTS17, JOINTS21):
        assert len(skeleton.order) == len(skeleton) == len(set(skeleton.names))
        assert list(skeleton.mirror[skeleton.mirror]) == list(range(len(skeleton)))
    assert EVALUATED[2] == "right_shoulder" and JOINTS17.mirror[2] == 5


def test_the_body_of_the_clip_file_can_be_cut_out_of_the_17():
    assert set(UPPER55.names[:13]) <= set(JOINTS17.names)
