"""Reference frames: the right picture of the right take, cut about the speaker, and of the training part alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.gestures.ha2g.dataset.references import ReferenceFrames, evenly, take_reference_frames, upper_body_boxes
from cospeech.skeleton import Skeleton
from cospeech.track import Points, Track
from tests.capture.films import numbered, numbers, write_film

FPS, FRAMES, WIDTH, HEIGHT = 15, 60, 64, 48
PLACES = {"left_shoulder": (38, 28), "right_shoulder": (26, 28), "head": (32, 20), "head_top": (32, 14)}
WHOLE = [(0.0, 4.0)]
pytestmark = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")


def make_track(frames=FRAMES, places=PLACES, **changes):
    """Somebody who stands still in the middle of the picture and is seen in every frame."""
    table = Skeleton.load("mpi_inf_3dhp21")
    xy = np.full((frames, len(table), 2), (WIDTH / 2, HEIGHT - 4), np.float32)
    for name, place in places.items():
        xy[:, table.index[name]] = place
    body = Points(table.name, xy, np.full((frames, len(table)), 0.5, np.float32), np.ones(frames, bool))
    return Track(float(FPS), frames, WIDTH, HEIGHT, body, **changes)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A film whose pictures tell their numbers."""
    return write_film(tmp_path_factory.mktemp("film") / "a.mp4", numbered(FRAMES, HEIGHT, WIDTH), FPS)


def shown(frames):
    """The numbers of the film's pictures that reference frames were cut from."""
    return numbers([type("", (), {"rgb": picture}) for picture in frames.pictures])


def test_pictures_are_the_frames_that_they_are_said_to_be(film):
    found = take_reference_frames("ada", {"a": (film, make_track())}, {"a": WHOLE}, count=8, size=64)
    assert found.pictures.shape == (8, 64, 64, 3) and found.pictures.dtype == np.uint8
    assert shown(found) == np.rint(found.times * FPS).astype(int).tolist()
    assert found.takes == ["a"] * 8 and (np.diff(found.times) > 0.3).all(), "all over the take"


def test_a_take_that_is_a_part_of_a_film_has_its_own_clock(film):
    track = make_track(30, start=1.6)
    found = take_reference_frames("ada", {"a": (film, track)}, {"a": [(0.0, 2.0)]}, count=4, size=64)
    assert shown(found) == (np.rint(found.times * FPS).astype(int) + 24).tolist()


def test_frames_are_of_the_training_part_alone(film, tmp_path):
    """Of a take that is cut in time the training stretches only; the films of other takes are never opened."""
    films = {"a": (film, make_track()), "b": (tmp_path / "of_the_test_part.mp4", make_track())}
    stretches = {"a": [(0.4, 1.0), (3.0, 3.5)]}
    found = take_reference_frames("ada", films, stretches, count=100, size=64)
    assert set(found.takes) == {"a"}
    assert shown(found) == [*range(6, 15), *range(45, 52)]


def test_the_surest_frames_of_every_stretch_are_taken_and_unseen_ones_never(film):
    track = make_track()
    track.body.score[[5, 17, 33, 58]] = 0.9
    track.body.observed[:10] = False
    track.body.score[20:24, track.body.table.index["left_shoulder"]] = 0
    found = take_reference_frames("ada", {"a": (film, track)}, {"a": WHOLE}, count=2, size=64)
    assert shown(found) == [17, 58]  # 5 is not seen; 33 is as sure, but in the same half of the others
    np.testing.assert_allclose(found.sureness, 0.9, atol=1e-6)
    everything = take_reference_frames("ada", {"a": (film, track)}, {"a": WHOLE}, count=45, size=64)
    assert shown(everything) == [*range(10, 20), *range(24, 59)]


@given(st.lists(st.integers(0, 30), max_size=8), st.integers(0, 60))
def test_takes_give_evenly(available, count):
    shares = evenly(available, count)
    assert sum(shares) == min(count, sum(available))
    assert all(share <= there for share, there in zip(shares, available, strict=True))
    unused = [share for share, there in zip(shares, available, strict=True) if share < there]
    assert not unused or max(shares) - min(unused) <= 1


def twice_as_large(track):
    """The same track in a picture of twice the size."""
    track.body.xy *= 2
    return replace(track, width=2 * WIDTH, height=2 * HEIGHT)


def test_a_picture_shows_head_and_upper_body(tmp_path):
    """On a film whose red is x and whose green is y, the crop's colours tell where it was cut."""
    y, x = np.mgrid[: 2 * HEIGHT, : 2 * WIDTH]
    picture = np.stack([2 * x, 2 * y, 0 * x], axis=2).astype(np.uint8)
    film = write_film(tmp_path / "a.mp4", [picture] * 8, FPS)
    track = twice_as_large(make_track(8))
    (found,) = take_reference_frames("ada", {"a": (film, track)}, {"a": [(0.0, 1.0)]}, count=1, size=64).pictures
    middle, width = np.array([64.0, 56.0]), 24.0  # of the shoulders
    low = middle + np.array([0, 0.2 * width]) - 1.4 * width
    for row, column in ((32, 32), (14, 30), (50, 26)):
        seen = found[row, column, :2] / 2
        expected = low + (np.array([column, row]) + 0.5) / 64 * 2.8 * width - 0.5
        np.testing.assert_allclose(seen, expected, atol=1.5)


def test_nothing_but_the_speaker_is_seen(tmp_path):
    """A white film is white where the track says that there is somebody, with a margin, and black in its corners."""
    film = write_film(tmp_path / "a.mp4", np.full((8, 2 * HEIGHT, 2 * WIDTH, 3), 255, np.uint8), FPS)
    track = twice_as_large(make_track(8, PLACES | {"left_elbow": (42, 34)}))
    hidden = replace(track, body=replace(track.body, score=track.body.score.copy()))
    hidden.body.score[:, track.body.table.index["left_elbow"]] = 0
    with_arm, without = (
        take_reference_frames("ada", {"a": (film, one)}, {"a": WHOLE}, count=1, size=64).pictures[0, :, :, 0] > 128
        for one in (track, hidden)
    )
    boxes = upper_body_boxes(track.body)
    for point in [*(PLACES[name] for name in ("left_shoulder", "right_shoulder", "head")), (32, 35)]:
        x, y = ((2 * np.array(point) - boxes[0, :2]) / boxes[0, 2:] * 64 + 31.5).round().astype(int)
        assert with_arm[y - 2 : y + 3, x - 2 : x + 3].all(), point
    assert not with_arm[:8, :16].any() and not with_arm[:, :8].any() and not with_arm[:, -6:].any()
    assert with_arm.sum() > without.sum() + 20 and 0.2 < with_arm.mean() < 0.5


def test_who_stands_sideways_is_no_larger():
    places = PLACES | {"left_shoulder": (33, 28), "right_shoulder": (31, 28), "head": (32, 18), "head_top": (32, 14)}
    boxes = upper_body_boxes(make_track(1, places).body)
    np.testing.assert_allclose(boxes[0, 2:], 2.8 * 1.2 * 10)


def test_the_file_is_the_same_whenever_it_is_made(film, tmp_path):
    for name in ("one.h5", "two.h5"):
        films = {"a": (film, make_track(licence_note="by A")), "b": (film, make_track(licence_note="by B"))}
        found = take_reference_frames("ada", films, {"a": WHOLE, "b": WHOLE}, count=5, size=64)
        found.write(tmp_path / name)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.h5", "two.h5"]
    back = ReferenceFrames.read(tmp_path / "one.h5")
    np.testing.assert_array_equal(back.pictures, found.pictures)
    assert (back.subject, back.takes, back.licence_note) == ("ada", ["a", "a", "a", "b", "b"], "by A; by B")


def test_takes_that_show_nobody_are_left_out(film):
    blind = make_track()
    blind.body.observed[:] = False
    films = {"a": (film, make_track(refused="no sound")), "b": (film, blind), "c": (film, Track(15.0, 60, 64, 48))}
    films["d"] = film, make_track()
    with pytest.warns(CospeechNotice, match="ada: 59 reference frames instead of 99"):
        found = take_reference_frames("ada", films, {take: WHOLE for take in films}, count=99, size=64)
    assert set(found.takes) == {"d"}
    del films["d"]
    with pytest.raises(CospeechError, match=r"^ada: no reference frames: .* set ensemble\.identity: speaker$"):
        take_reference_frames("ada", films, {take: WHOLE for take in films})


def test_another_film_than_the_tracked_one_is_one_line(film):
    track = replace(make_track(), width=1920, height=1080)
    with pytest.raises(CospeechError, match=r"a\.mp4: is 64 x 48 pixels, its track was made of a film of 1920 x 1080"):
        take_reference_frames("ada", {"a": (film, track)}, {"a": WHOLE}, count=2, size=64)
