"""What every tracker shares: the speaker is followed, others are left out, and MediaPipe runs in its environment."""

import os
import sys

import numpy as np
import pytest

from cospeech.capture.film.decoding import open_film
from cospeech.capture.trackers.follow import frames_of_others
from cospeech.capture.trackers.mediapipe import COMPLETE, MediapipeTracker, _parts, build_environment
from cospeech.capture.trackers.mediapipe_runner import cut, record
from cospeech.capture.trackers.registry import run_trackers
from cospeech.cli import main
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.track import Points, Track
from tests.capture.films import textured, write_film

ROOM = textured(9, 1, 120, 160)[0] // 4
RED, GREEN = (200, 40, 40), (40, 180, 60)


def person(colour, x, y=60, size=50):
    """A picture of the room with a coloured person-sized block at x, y, and its box as two points."""
    picture = ROOM.copy()
    half = size // 2
    picture[max(y - half, 0) : y + half, max(x - half // 2, 0) : x + half // 2] = colour
    return picture, [[x - half // 2, y - half], [x + half // 2, y + half]]


class BoxTracker:
    """A tracker that knows where somebody was drawn."""

    name, version, parts, model_sha256, licence_note = "boxes", "1", ("body",), "", ""

    def __init__(self, boxes):
        self.boxes = boxes

    def track(self, film, pictures, seen):
        points = Points.empty("coco23", sum(1 for _ in pictures))
        for frame, box in enumerate(self.boxes):
            if box is not None:
                points.observed[frame], points.score[frame] = True, 1
                points.xy[frame, ::2], points.xy[frame, 1::2] = box[0], box[1]
        return {"body": points}


def tracked(tmp_path, people):
    shots = [person(*p) if p else (ROOM, None) for p in people]
    film = open_film(write_film(tmp_path / "film.mp4", [picture for picture, _ in shots]))
    return run_trackers(film, BoxTracker([box for _, box in shots]))


def test_one_person_is_followed_wherever_they_go(tmp_path):
    track = tracked(tmp_path, [(RED, 40 + 2 * i) for i in range(30)])
    assert track.body.observed.all() and not len(track.cuts)


def test_somebody_else_between_is_left_out(tmp_path):
    """The speaker at the left, another at the right for a while, and the speaker again, elsewhere."""
    people = [(RED, 40)] * 15 + [(GREEN, 120)] * 8 + [(RED, 60, 70)] * 12
    with pytest.warns(CospeechNotice, match="8 of 35 frames show another person"):
        track = tracked(tmp_path, people)
    np.testing.assert_array_equal(track.body.observed, [True] * 15 + [False] * 8 + [True] * 12)
    assert not track.body.xy[15:23].any() and not track.body.score[15:23].any()


def test_the_one_seen_most_is_the_speaker(tmp_path):
    with pytest.warns(CospeechNotice, match="another person"):
        track = tracked(tmp_path, [(GREEN, 120)] * 6 + [(RED, 40)] * 20)
    np.testing.assert_array_equal(track.body.observed, [False] * 6 + [True] * 20)


def test_the_speaker_may_leave_and_come_back(tmp_path):
    track = tracked(tmp_path, [(RED, 40)] * 10 + [None] * 30 + [(RED, 100)] * 10)
    np.testing.assert_array_equal(track.body.observed, [True] * 10 + [False] * 30 + [True] * 10)


def test_a_body_without_pixels_is_the_speakers_in_every_shot(tmp_path):
    film = open_film(write_film(tmp_path / "film.mp4", np.concatenate([textured(1, 10), textured(2, 10)])))
    body = Points.empty("upper13", 20)
    body.observed[:], body.score[:] = True, 1
    assert not frames_of_others(film, body, np.array([10])).any()


def test_one_stretch_needs_no_second_look(tmp_path):
    film = open_film(write_film(tmp_path / "film.mp4", [ROOM] * 5))
    (tmp_path / "film.mp4").unlink()
    body = Points.empty("coco23", 5)
    body.observed[:], body.score[:] = True, 1
    body.xy[:, 0] = 50
    assert not frames_of_others(film, body, []).any()


def test_cuts_go_into_the_track(tmp_path):
    pictures = textured(1, 12) + textured(2, 12)
    film = open_film(write_film(tmp_path / "film.mp4", pictures))
    with pytest.warns(CospeechNotice, match="another person"):  # the second texture looks like nobody in the first
        track = run_trackers(film, BoxTracker([[[40, 10], [80, 90]]] * 24))
    np.testing.assert_array_equal(track.cuts, [12])


def test_without_its_environment_mediapipe_says_how_to_make_it(tmp_path):
    with pytest.raises(CospeechError, match=r"docs/capture\.md"):
        MediapipeTracker(tmp_path)


def test_an_environment_that_cannot_be_made_is_no_environment(tmp_path):
    asked = tmp_path / "asked.txt"
    asked.write_text("./no-such-package-here\n")
    with pytest.raises(CospeechError, match="cannot be made"):
        build_environment(tmp_path / "env", asked)
    assert not (tmp_path / "env" / COMPLETE).exists()
    (tmp_path / "env" / COMPLETE).write_text(asked.read_text())
    build_environment(tmp_path / "env", asked)  # made from the same pins: nothing is asked for again


def test_a_runner_that_fails_is_one_line(tmp_path):
    """An interpreter without MediaPipe in it."""
    film = open_film(write_film(tmp_path / "film.mp4", [ROOM] * 20))
    (tmp_path / "env" / "bin").mkdir(parents=True)
    os.symlink(sys.executable, tmp_path / "env" / "bin" / "python")
    (tmp_path / "env" / COMPLETE).touch()
    with pytest.raises(CospeechError, match=r"MediaPipe failed .*No module named") as error:
        run_trackers(film, MediapipeTracker(tmp_path / "env"))
    assert "\n" not in str(error.value)


def test_squares_of_the_runner_and_their_way_back():
    """A picture whose colours are its coordinates: every pixel of a square says where it came from, turned or not."""
    rows, columns = np.mgrid[:200, :250]
    picture = np.stack([columns, rows, 0 * rows], -1).astype(np.uint8)
    for direction in ((0.0, -1.0), (3.0, -4.0), (-1.0, 0.2)):
        square, back = cut(picture, np.array([120.0, 100.0]), 60.0, direction)
        x, y = np.meshgrid(np.arange(60), np.arange(60))
        origin = np.stack([x, y], -1) @ back[:, :2].T + back[:, 2]
        np.testing.assert_allclose(square[..., :2], origin, atol=1.0)
        up = back[:, :2] @ [0, -1]
        np.testing.assert_allclose(up, np.array(direction) / np.hypot(*direction), atol=1e-6)  # it is up in the square
        assert np.linalg.det(back[:, :2]) == pytest.approx(1)  # and nothing is mirrored
    assert cut(picture, np.array([-200.0, 0.0]), 60.0) == cut(picture, np.array([9.0, 9.0]), 5.0) == (None, None)


def test_what_the_runner_writes_is_read_back(tmp_path):
    """Parts that are absent are not observed; hands are turned to be relative to their wrists; pixels are scaled."""
    rng = np.random.default_rng(0)
    body, hand = (rng.uniform(0, 1, (count, 6)).astype(np.float32) for count in (33, 21))
    rows = np.stack([record({"body": (0.9, body), "right_hand": (0.8, hand)}), record({})])
    (tmp_path / "records").write_bytes(rows.tobytes())
    parts = _parts(tmp_path / "records", 2, 1.5)
    assert {name: points.observed.tolist() for name, points in parts.items()} == {
        "body": [True, False],
        "left_hand": [False, False],
        "right_hand": [True, False],
        "face_landmarks": [False, False],
    }
    np.testing.assert_allclose(parts["body"].xy[0], body[:, :2] * 1.5)
    np.testing.assert_allclose(parts["body"].xyz[0], body[:, 2:5])
    np.testing.assert_allclose(parts["right_hand"].xyz[0], hand[:, 2:5] - hand[0, 2:5])
    np.testing.assert_allclose(parts["right_hand"].score[0], hand[:, 5])


def test_track_and_overlay_from_the_command_line(tmp_path, capsys, monkeypatch):
    from tests.capture.networks import dots, simcc_network
    from tests.capture.test_onnx_tracker import PLACES

    monkeypatch.chdir(tmp_path)
    write_film("film.mp4", dots(PLACES), sounds=1)
    simcc_network("rtmw.onnx", (288, 384), points=133)
    command = ["track", "film.mp4", "--tracker", "onnx", "--manifest", "rtmw", "--model", "rtmw.onnx"]
    assert main([*command, "--out", "track.h5", "--start", "0.08"]) == 0
    track = Track.read("track.h5")
    assert (track.frames, track.start, track.source) == (10, 0.08, "film.mp4")
    assert "body 100%" in capsys.readouterr().out
    assert main(["overlay", "track.h5", "film.mp4", "--out", "seen.mp4"]) == 0
    seen = open_film("seen.mp4")
    assert (seen.frames, seen.width, seen.height) == (10, 160, 120)
    first = next(iter(seen.pictures())).rgb.astype(int)
    x, y = PLACES[2, 1].astype(int)  # the second point: green there, and drawn over in the body's colour
    assert first[y - 3 : y + 4, x - 3 : x + 4].sum() > 0
    for arguments, words in (
        ([*command, "--out", "track.csv"], "a track is written as .h5"),
        (["track", "film.mp4", "--tracker", "sonar", "--out", "t.h5"], "sonar"),
        (["track", "film.mp4", "--tracker", "onnx", "--out", "t.h5"], "--manifest"),
        (["track", "gone.mp4", "--out", "t.h5"], "no such file"),
        (["overlay", "track.h5", "rtmw.onnx", "--out", "o.mp4"], "not a video"),
        (["overlay", "film.mp4", "film.mp4", "--out", "o.mp4"], "not a readable HDF5"),
    ):
        assert main(arguments) == 2
        message = capsys.readouterr().err
        assert words in message and message.count("\n") == 1, message
