"""Keywords: the right gesture, its stroke at the word, and Algorithm 1 as ever around it."""

import h5py
import numpy as np
import pytest
import yaml

from cospeech.clip import Clip, Words
from cospeech.demo import read_take, write_take
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.matching import KNN, Database
from cospeech.matching.control.keywords import Keyword, apex, gestures_of_word, spoken
from cospeech.matching.database.descriptors import pose_features
from cospeech.skeleton import bone_lengths
from tests.matching.reference import algorithm1

FPS = 15.0
WRIST = 7
STROKES = {"big": (100, [0.3, 0.2, 0.0]), "vast": (230, [0.1, 0.3, 0.1])}  # word: frame of arrival, way of the wrist


def words(*said):
    """`Words` of (text, frame of the middle), each 0.2 s long."""
    middles = np.array([frame / FPS for _, frame in said])
    return Words(middles - 0.1, middles + 0.1, [text for text, _ in said])


@pytest.fixture(scope="module")
def takes(random_takes):
    """Two takes of small random motion; in the first the left wrist is thrown out and stays half a second, twice."""
    positions, features = random_takes(np.random.default_rng(5), (320, 256))
    for p in positions:
        p *= 0.05
        p += np.random.default_rng(0).normal(size=(55, 3)).astype(np.float32) * 0.1
    for at, way in STROKES.values():
        rise = np.clip((np.arange(320) - (at - 4)) / 4, 0, 1) - np.clip((np.arange(320) - (at + 8)) / 8, 0, 1)
        positions[0][:, WRIST] += rise[:, None].astype(np.float32) * np.float32(way)
    said = [words(("Well,", 40), ("BIG", 100), ("very", 215), ("vast.", 230)), words(("big", 120), ("so", 200))]
    return positions, features, said


@pytest.fixture(scope="module")
def knn(takes):
    positions, features, said = takes
    return KNN(Database.from_arrays(positions, features, ["a", "b"], words=said))


@pytest.mark.parametrize("frames", [240, 237])
@pytest.mark.parametrize("at", [3, 8, 60, 127, 236])
def test_the_stroke_is_at_the_word_and_its_windows_are_the_speakers_own_frames(knn, takes, at, frames):
    positions, features = takes[0][0], np.random.default_rng(at).normal(size=(frames, 28))
    match = knn.match(features, controls=[Keyword("huge", "big")], words=words(("huge", at)), initial="mean")
    stroke, own = STROKES["big"][0], at // 8
    called = np.flatnonzero([held == ("huge=big",) for held in match.controls])
    assert own in called and 1 <= len(called) <= 3
    frame = np.arange(called[0] * 8, min(called[-1] * 8 + 8, frames))
    assert np.array_equal(match.positions[frame], positions[stroke + frame - at])
    np.testing.assert_allclose(match.time[called], (stroke + called * 8 - at) / FPS)
    assert set(match.take[called]) == {"a"} and set(match.pose_rank[called]) == {-1}


def test_the_search_goes_on_from_the_gesture_exactly_as_algorithm_1(knn, takes):
    features = np.random.default_rng(0).normal(size=(200, 28))
    match = knn.match(features, controls=[Keyword("huge", "big")], words=words(("huge", 90)), initial="mean")
    called = np.flatnonzero([held == ("huge=big",) for held in match.controls])
    database, queries = knn.matcher.database, knn.matcher.query_features(features)
    last = STROKES["big"][0] + called[-1] * 8 + 7 - 90
    pose = database.pose_normalization(pose_features(takes[0][0])[last])
    arrays = database.pose, database.audio, database.eligible
    truth = algorithm1(*arrays, queries[: called[0]], np.zeros(96))
    truth += algorithm1(*arrays, queries[called[-1] + 1 :], pose.astype(float))
    free = np.setdiff1d(np.arange(25), called)
    columns = (match.clip, match.frame, match.pose_rank, match.audio_rank)
    assert [tuple(row) for row in np.stack(columns, axis=1)[free]] == [tuple(row) for row in truth]


def test_of_several_gestures_the_nearest_pose_is_taken_and_k_takes_the_next(takes):
    positions, features, said = takes
    said = [words(("tag", 100), ("tag", 230)), Words.none()]
    knn = KNN(Database.from_arrays(positions, features, ["a", "b"], words=said))
    strokes, speech = [100, 230], np.random.default_rng(1).normal(size=(120, 28))
    for initial_take, initial_frame in ((0, 90), (0, 222)):
        pose = knn.matcher.database.pose_normalization(pose_features(positions[initial_take])[initial_frame])
        starts = [pose_features(positions[0])[s - 4] for s in strokes]  # the word at frame 4 of the first window
        near = [np.linalg.norm(knn.matcher.database.pose_normalization(s) - pose) for s in starts]
        for k in (1, 2):
            match = knn.match(
                speech, controls=[{"keyword": "x", "gesture": "tag"}], words=words(("x", 4)), initial=pose, k=k
            )
            chosen = strokes[int(np.argsort(near)[k - 1])]
            assert match.time[0] == pytest.approx((chosen - 4) / FPS)


def test_a_word_that_was_said_without_a_gesture_is_passed_over(knn):
    """`big` is said in take b too, where the hands rest."""
    found = gestures_of_word(knn.matcher.database, "big")
    assert [(g.take, round((g.start + g.stroke / FPS) * FPS)) for g in found] == [("a", 100)]


def test_words_are_found_whatever_their_case_and_signs_and_in_a_row():
    said = words(("Not", 0), ("so--very", 5), ("BIG!", 10), ("not", 20), ("big", 25))
    assert [round((a + b) / 2 * FPS) for a, b in spoken(said, "big")] == [10, 25]
    assert [a for a, _ in spoken(said, "not big")] == [said.start[3]] and not spoken(said, "very")


def test_two_words_near_each_other_and_controls_around_them(knn):
    features = np.random.default_rng(0).normal(size=(160, 28))
    controls = ["left_wrist_height=low", Keyword("one", "big"), Keyword("two", "vast")]
    match = knn.match(features, controls=controls, words=words(("one", 60), ("two", 70)))
    held = [match.controls[w] for w in range(20)]
    assert held[60 // 8] == ("one=big",) and held[70 // 8] == ("two=vast",) and held[2] == ("left_wrist_height=low",)
    assert match.time[70 // 8] == pytest.approx((230 + 64 - 70) / FPS)
    with pytest.warns(CospeechNotice, match=r"two=vast.*left out at 4\.13 s"):
        knn.match(features, controls=controls, words=words(("one", 60), ("two", 62)))


def test_the_users_own_gestures_have_the_subjects_bones_and_their_stroke_at_the_word(knn, toy_clips, tmp_path):
    toy_clips[0].write(tmp_path / "own.h5")
    entry = {"clip": str(tmp_path / "own.h5"), "stroke": 6.0, "start": 5.2, "end": 6.1}
    (tmp_path / "g.yaml").write_text(yaml.safe_dump({"wide": [entry, entry | {"stroke": 0.1, "start": 0, "end": 1}]}))
    options = {"words": words(("huge", 93)), "gestures": tmp_path / "g.yaml"}
    match = knn.match(np.zeros((160, 28)), controls=[{"keyword": "huge", "gesture": "wide"}], **options)
    called = np.flatnonzero([held == ("huge=wide",) for held in match.controls])
    assert called.tolist() == [10, 11] and set(match.take[called]) == {"own.h5"}  # frames 81 to 95
    assert match.time[10] == pytest.approx((90 + 80 - 93) / FPS) and set(match.clip[called]) == {-1}
    made, own = match.positions[80:96], toy_clips[0].positions[77:93]
    subject, there = bone_lengths(knn.matcher.database.positions[:, 0]), bone_lengths(own) > 0
    np.testing.assert_allclose(bone_lengths(made), subject * there, atol=1e-6)
    with np.errstate(invalid="ignore"):
        directions = [np.diff(p[:, [6, WRIST]], axis=1)[:, 0] for p in (made, own)]
    cosines = np.sum(directions[0] * directions[1], axis=1) / np.prod(np.linalg.norm(directions, axis=2), axis=0)
    np.testing.assert_allclose(cosines, 1, atol=1e-5)


MISTAKES = {
    "never spoken": ([Keyword("hug", "big")], {}, ["'hug'", "never spoken", "huge"]),
    "no words": ([Keyword("huge", "big")], {"words": None}, ["'huge'", "--words", "--recognize"]),
    "no gesture": ([Keyword("huge", "bigg")], {}, ["'bigg'", "training takes", "big"]),
    "two gestures": ([Keyword("huge", "big"), Keyword("Huge", "vast")], {}, ["huge=big", "Huge=vast", "contradict"]),
    "a key": ([{"keyword": "huge", "gestur": "big"}], {}, ["gestur"]),
    "no file": ([Keyword("huge", "big")], {"gestures": "absent.yaml"}, ["absent.yaml"]),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_is_one_line(knn, what):
    controls, options, expected = MISTAKES[what]
    with pytest.raises(CospeechError) as error:
        knn.match(np.zeros((160, 28)), controls=controls, **({"words": words(("huge", 60))} | options))
    assert all(word in str(error.value) for word in expected) and "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["huge", "=wide", "huge=", "!=wide", "a=b=c"])
def test_a_keyword_is_a_word_and_a_gesture(text):
    with pytest.raises(CospeechError, match="WORD=GESTURE"):
        Keyword.parse(text)


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("own.h5", "expected clip and stroke"),
        ({"clip": "own.h5"}, "expected clip and stroke"),
        ({"clip": "own.h5", "stroke": 3.0, "strt": 1}, "expected clip and stroke"),
        ({"clip": "own.h5", "stroke": "soon"}, "seconds"),
        ({"clip": "own.h5", "stroke": 50.0}, "follow each other"),
        ({"clip": "own.h5", "stroke": 3.0, "start": 3.5}, "follow each other"),
        ({"clip": "absent.h5", "stroke": 3.0}, "absent.h5"),
        ({"clip": "fast.h5", "stroke": 3.0}, "30 fps"),
        ({"clip": "short.h5", "stroke": 0.3}, "9 valid frames"),
    ],
)
def test_a_file_of_gestures_is_checked(knn, toy_clips, tmp_path, monkeypatch, entry, expected):
    monkeypatch.chdir(tmp_path)
    clip = toy_clips[0]
    clip.write("own.h5")
    clip.section(0, 9).write("short.h5")
    Clip("toy", "fast", 30.0, clip.positions, clip.features).write("fast.h5")
    (tmp_path / "g.yaml").write_text(yaml.safe_dump({"wide": entry}))
    with pytest.raises(CospeechError, match=expected):
        knn.match(np.zeros((60, 28)), controls=[Keyword("huge", "wide")], words=words(("huge", 30)), gestures="g.yaml")


def test_the_stroke_of_a_demo_speakers_gesture_is_found_within_a_window_of_the_true_one(tmp_path):
    """The virtual speaker knows when its hands arrive; and each of its gestures is at a word."""
    files = tmp_path / "t.h5", tmp_path / "t.wav"
    write_take("lively", 3, seconds=60.0, seed=0, truth=files[0], wav=files[1])
    clip = read_take(*files, subject="lively", clip="t")
    with h5py.File(files[0]) as file:
        true, said = file["gestures/apex"][()], file["gestures/word"][()]
    found = [apex(clip.positions, FPS, (clip.words.start[i] + clip.words.end[i]) / 2)[0] for i in said]
    errors = np.abs(np.array(found) / FPS - true)
    assert len(true) > 20 and errors.max() < 8 / FPS and np.median(errors) < 1.5 / FPS
