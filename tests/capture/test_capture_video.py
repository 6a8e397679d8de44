"""Films in: every picture at its time, upright, whatever the file; and one line for what is no film."""

import threading
import time

import numpy as np
import pytest

from cospeech.capture.film.decoding import open_film
from cospeech.capture.film.prefetch import prefetch
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.speech import load_audio
from tests.capture.films import numbered, numbers, textured, write_film, write_live


def test_every_picture_once_at_the_files_own_rate(tmp_path):
    film = open_film(write_film(tmp_path / "film.mp4", numbered(30)))
    assert (film.width, film.height, film.fps, film.frames) == (64, 48, 25.0, 30)
    pictures = list(film.pictures())
    assert numbers(pictures) == list(range(30)) and [p.index for p in pictures] == list(range(30))


@pytest.mark.parametrize(("rate", "kept"), [(50, 25.0), (60, 30.0), (30, 30.0), (120, 30.0), (24, 24.0)])
def test_fast_films_are_tracked_at_an_even_part_of_their_rate(tmp_path, rate, kept):
    film = open_film(write_film(tmp_path / "film.mp4", numbered(24), fps=rate))
    assert film.fps == pytest.approx(kept)
    assert numbers(film.pictures()) == list(range(0, 24, round(rate / kept)))


def test_variable_rate_becomes_constant_by_the_nearest_picture(tmp_path):
    rng = np.random.default_rng(0)
    times = np.round(np.cumsum(rng.uniform(0.02, 0.16, 40)), 3)
    times -= times[0]
    film = open_film(write_film(tmp_path / "film.mkv", numbered(40), times=times), fps=15)
    found = numbers(film.pictures())
    wanted = [int(np.abs(times - i / 15).argmin()) for i in range(len(found))]
    assert found == wanted
    assert len(found) / 15 == pytest.approx(times[-1] + 1 / 25, abs=0.15)


@pytest.mark.parametrize("head", [1000, 24])  # Hz that the file's head claims
@pytest.mark.parametrize("codec", ["libvpx", "libvpx-vp9"])
def test_a_live_recording_has_the_rate_of_its_pictures(tmp_path, head, codec):
    film = open_film(write_live(tmp_path / "live.webm", numbered(60), np.arange(60) * 0.033, head, codec))
    assert film.rate == pytest.approx(1 / 0.033, rel=1e-3) and film.fps == film.rate and film.frames == 60
    assert film.end == pytest.approx(60 * 0.033, abs=0.002)
    assert numbers(film.pictures()) == list(range(60))


def test_picture_times_are_those_of_the_file(tmp_path):
    times = np.concatenate([np.arange(30) / 30, 1 + np.arange(15) / 15])
    film = open_film(write_film(tmp_path / "film.mp4", numbered(45), times=times))
    np.testing.assert_allclose(film.picture_times(), times, atol=1e-4)
    late = open_film(write_film(tmp_path / "late.mp4", numbered(45), times=times + 0.48))
    np.testing.assert_allclose(late.picture_times(), times, atol=1e-4)


@pytest.mark.parametrize(
    ("start", "end", "first", "count"), [(0.4, 1.0, 10, 15), (0.0, 0.2, 0, 5), (1.92, None, 48, 12)]
)
def test_a_stretch_is_that_stretch_of_the_whole(tmp_path, start, end, first, count):
    path = write_film(tmp_path / "film.mp4", numbered(60))
    film = open_film(path, start, end)
    assert numbers(film.pictures()) == list(range(first, first + count)) and film.frames == count


@pytest.mark.parametrize("rotation", [0, 90, 180, 270])
def test_rotation_flags_are_obeyed(tmp_path, rotation):
    """The white mark is where a player shows it: FFmpeg turns pictures counterclockwise by the display's rotation."""
    path = write_film(tmp_path / "film.mp4", numbered(5, height=48, width=80), rotation=rotation)
    film = open_film(path)
    rgb = next(iter(film.pictures())).rgb
    assert rgb.shape[:2] == ((48, 80) if rotation % 180 == 0 else (80, 48)) == (film.height, film.width)
    low, high = (slice(2, 10), slice(-10, -2))
    corner = {0: (low, low), 90: (high, low), 180: (high, high), 270: (low, high)}[rotation]
    assert rgb[corner].mean() > 200 and rgb.mean() < 60


def test_odd_sizes_and_pixels_that_are_not_square(tmp_path):
    path = write_film(tmp_path / "odd.mkv", numbered(4, height=47, width=63), codec="ffv1", pixels="bgr0")
    assert next(iter(open_film(path).pictures())).rgb.shape == (47, 63, 3)
    path = write_film(tmp_path / "wide.mp4", numbered(4, height=48, width=64), aspect="3/2")
    film = open_film(path)
    assert (film.width, film.height) == (96, 48) and next(iter(film.pictures())).rgb.shape == (48, 96, 3)


def test_large_pictures_are_made_smaller_for_trackers(tmp_path):
    film = open_film(write_film(tmp_path / "film.mp4", numbered(3, height=2160, width=3840), pixels="yuv420p"))
    assert (film.width, film.height) == (3840, 2160)
    picture = next(iter(film.pictures()))
    assert picture.rgb.shape == (720, 1280, 3) and picture.rgb[:170, :300].min() > 240


def test_sound_tracks(tmp_path):
    for count in (1, 2):
        path = write_film(tmp_path / f"{count}.mp4", numbered(25), sounds=count)
        samples, rate = load_audio(path)
        spectrum = np.abs(np.fft.rfft(samples))
        assert spectrum.argmax() * rate / len(samples) == pytest.approx(220, abs=3)
        assert open_film(path).frames == 25
    with pytest.raises(CospeechError, match="no audio stream"):
        load_audio(write_film(tmp_path / "silent.mp4", numbered(5)))


def test_shot_cuts_are_where_the_picture_changes(tmp_path):
    shots = [textured(1, 12), textured(2, 20), textured(3, 9)]
    film = open_film(write_film(tmp_path / "film.mp4", [picture for shot in shots for picture in shot]))
    assert [p.index for p in film.pictures() if p.cut] == [12, 32]


def test_what_is_no_film_gets_one_line(tmp_path):
    whole = write_film(tmp_path / "film.mp4", numbered(30), sounds=1)
    content = whole.read_bytes()
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "text.mp4").write_text("no film at all\n" * 100)
    (tmp_path / "half.mp4").write_bytes(content[: len(content) // 2])
    with pytest.raises(CospeechError, match="no such file"):
        open_film(tmp_path / "gone.mp4")
    for name, words in {"empty.mp4": "0 bytes", "text.mp4": "not a video", "half.mp4": "not a video"}.items():
        with pytest.raises(CospeechError, match=words) as error:
            open_film(tmp_path / name)
        assert name in str(error.value) and "\n" not in str(error.value)
    from cospeech.speech import write_wav

    write_wav(tmp_path / "sound.wav", np.zeros(1000), 16000)
    with pytest.raises(CospeechError, match="no video stream"):
        open_film(tmp_path / "sound.wav")


def test_a_wrong_extension_does_not_matter(tmp_path):
    film = write_film(tmp_path / "film.mp4", numbered(10)).rename(tmp_path / "film.txt")
    assert numbers(open_film(film).pictures()) == list(range(10))


def test_a_film_that_breaks_off_is_used_up_to_there(tmp_path):
    path = write_film(tmp_path / "film.mkv", textured(1, 60), codec="mpeg4", pixels="yuv420p")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.warns(CospeechNotice, match="breaks off"):
        pictures = list(open_film(path).pictures())
    assert 10 < len(pictures) < 45


def test_takes_outside_the_film_are_named(tmp_path):
    path = write_film(tmp_path / "film.mp4", numbered(50))
    for start, end, words in ((2.5, 3.0, "outside"), (1.0, 9.0, "outside"), (1.0, 0.5, "start")):
        with pytest.raises(CospeechError, match=words) as error:
            open_film(path, start, end)
        assert str(error.value).startswith(str(path))
    assert open_film(path, 1.0, 2.05).frames == 25  # the rounding of somebody's cut list


def test_decoding_runs_ahead_by_a_bounded_number_of_items():
    made = []

    def items():
        for i in range(100):
            made.append(i)
            yield i

    consumer = prefetch(items(), 4)
    assert next(consumer) == 0
    deadline = time.monotonic() + 5
    while len(made) < 6 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.05)
    assert 5 <= len(made) <= 6  # one taken, four waiting, one in hand
    before = threading.active_count()
    consumer.close()
    assert threading.active_count() == before - 1


def test_exceptions_of_the_thread_arrive_at_the_consumer():
    def items():
        yield 1
        raise CospeechError("broken")

    consumer = prefetch(items(), 2)
    assert next(consumer) == 1
    with pytest.raises(CospeechError, match="broken"):
        next(consumer)


def test_real_films(recordings):
    """Lengths as ffprobe counts their packets: 55, 73, 43, 64 pictures at 25 fps, 58 at 29.92; upright, no cuts."""
    counts = {"requesting_review": 55, "displaying_id": 73, "introducing": 43, "requesting_answer": 64}
    for name, count in counts.items():
        film = open_film(recordings / "video" / "presenter" / f"{name}.mp4")
        pictures = list(film.pictures(320))
        assert len(pictures) == count and not any(p.cut for p in pictures) and pictures[0].rgb.shape == (180, 320, 3)
