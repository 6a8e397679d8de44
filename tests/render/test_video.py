"""Films play for exactly the clip's length, in sync with their sound, and come out the same twice."""

import av
import cv2
import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.render.video import _sampled, render_video, still
from cospeech.speech import load_audio

SIZE = (320, 180)


def frames_of(path):
    with av.open(str(path)) as film:
        return [frame.to_ndarray(format="bgr24") for frame in film.decode(video=0)]


def facts(path):
    """Duration in seconds of the film and of each stream, its rate, size and codec names."""
    with av.open(str(path)) as film:
        video = film.streams.video[0]
        lengths = {stream.type: float(stream.duration * stream.time_base) for stream in film.streams}
        codecs = {stream.type: stream.codec_context.name for stream in film.streams}
        return (
            film.duration / av.time_base,
            lengths,
            video.average_rate,
            (video.width, video.height),
            codecs,
            video.pix_fmt,
        )


def click(seconds, at, rate=16000):
    """Silence with a short tone burst at `at` seconds."""
    samples = np.zeros(round(seconds * rate), np.float32)
    burst = np.sin(np.arange(rate // 50) * 0.6).astype(np.float32) * 0.8
    samples[round(at * rate) : round(at * rate) + len(burst)] = burst
    return samples, rate


def test_length_rate_and_streams(tmp_path, make_clip):
    clip = make_clip(frames=40)
    render_video(tmp_path / "film.mp4", [("anna", clip)], audio=click(40 / 15, 1.0), size=SIZE)
    duration, lengths, rate, size, codecs, layout = facts(tmp_path / "film.mp4")
    assert (rate, size, layout, codecs) == (30, SIZE, "yuv420p", {"video": "h264", "audio": "aac"})
    assert lengths == pytest.approx({"video": 80 / 30, "audio": 80 / 30}, abs=0.002)
    assert duration == pytest.approx(80 / 30, abs=0.002)
    frames = frames_of(tmp_path / "film.mp4")
    assert len(frames) == 80
    assert all(np.abs(a.astype(int) - b).max() > 30 for a, b in zip(frames[::8], frames[8::8], strict=False))


@pytest.mark.parametrize(
    ("frames", "fps", "expected"), [(1, 15.0, 2), (7, 15.0, 14), (10, 25.0, 10), (9, 7.5, 36), (5, 30.0, 5)]
)
def test_frame_count_follows_the_clip(tmp_path, make_clip, frames, fps, expected):
    render_video(tmp_path / "film.mp4", [("anna", make_clip(frames, fps))], size=(128, 96))
    assert len(frames_of(tmp_path / "film.mp4")) == expected


def test_length_of_the_sound_where_it_is_the_same_take(tmp_path, make_clip):
    """A clip has whole frames of its own rate; the film comes as near to the sound as its own frames allow."""
    for seconds, expected in ((40.4 / 15, 81), (39.6 / 15, 79), (9.0, 80), (1.0, 80)):
        render_video(tmp_path / "film.mp4", [("a", make_clip(40))], audio=click(seconds, 0.5), size=(128, 96))
        duration, lengths, *_ = facts(tmp_path / "film.mp4")
        assert len(frames_of(tmp_path / "film.mp4")) == expected
        assert lengths["audio"] == pytest.approx(expected / 30, abs=0.002)
        assert duration == pytest.approx(expected / 30, abs=0.002)


@pytest.mark.parametrize("rate", [8000, 16000, 44100, 48000])
def test_sound_stays_in_sync(tmp_path, make_clip, rate):
    render_video(tmp_path / "film.mp4", [("a", make_clip(30))], audio=click(2.0, 1.2, rate), size=(128, 96))
    samples, found = load_audio(tmp_path / "film.mp4")
    loud = np.flatnonzero(np.abs(samples) > 0.3)
    assert loud[0] / found == pytest.approx(1.2, abs=0.003)
    assert np.abs(samples[: int(1.1 * found)]).max() < 0.02


def test_sound_from_a_file(tmp_path, make_clip):
    from cospeech.speech import write_wav

    write_wav(tmp_path / "a.wav", *click(2.0, 0.7))
    render_video(tmp_path / "film.mp4", [("a", make_clip(30))], audio=tmp_path / "a.wav", size=(128, 96))
    samples, rate = load_audio(tmp_path / "film.mp4")
    assert np.flatnonzero(np.abs(samples) > 0.3)[0] / rate == pytest.approx(0.7, abs=0.003)


def test_same_input_same_bytes_and_index_in_front(tmp_path, make_clip):
    for name in ("a.mp4", "b.mp4"):
        render_video(tmp_path / name, [("anna", make_clip(20))], audio=click(20 / 15, 0.5), size=SIZE)
    data = (tmp_path / "a.mp4").read_bytes()
    assert data == (tmp_path / "b.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")


def test_panels_share_camera_and_stand_side_by_side(tmp_path, make_clip):
    clip = make_clip(4)
    render_video(tmp_path / "two.mp4", [("same", clip), ("same", clip)], size=(640, 240))
    picture = frames_of(tmp_path / "two.mp4")[3].astype(int)
    assert np.abs(picture[:, 4:316] - picture[:, 324:636]).mean() < 1.0
    assert (picture[:, :320].min(-1) < 120).any()
    render_video(tmp_path / "four.mp4", [(str(i), clip) for i in range(4)], size=(640, 480))
    picture = frames_of(tmp_path / "four.mp4")[3].astype(int)
    assert np.abs(picture[60:230, 4:316] - picture[300:470, 324:636]).mean() < 1.0


def test_shorter_clips_hold_their_last_pose(tmp_path, make_clip):
    render_video(
        tmp_path / "film.mp4",
        [("a", make_clip(30, words=False)), ("b", make_clip(10))],
        subtitles=False,
        size=(320, 120),
    )
    frames = np.stack(frames_of(tmp_path / "film.mp4")).astype(int)
    assert len(frames) == 60
    assert np.abs(frames[30, :, 165:] - frames[50, :, 165:]).max() < 35
    assert np.abs(frames[30, :, :155] - frames[50, :, :155]).max() > 60


def test_between_frames_the_motion_is_interpolated(make_clip):
    clip = make_clip(10)
    clip.rotation[:, 1] = np.arange(10) * 0.2
    positions, rotation, expression = _sampled(clip, np.array([0.0, 2.5 / 15, 9 / 15, 99.0]), clip.expression)
    np.testing.assert_allclose(positions[1], (clip.positions[2] + clip.positions[3]) / 2, atol=1e-6)
    np.testing.assert_allclose(expression[1], (clip.expression[2] + clip.expression[3]) / 2, atol=1e-6)
    np.testing.assert_allclose(rotation[:, 1], [0, 0.5, 1.8, 1.8], atol=1e-6)
    np.testing.assert_array_equal(positions[3], clip.positions[9])


def test_words_are_shown_while_they_are_spoken(tmp_path, make_clip):
    pictures = []
    for time in (0.0, 0.4):
        still(tmp_path / "still.png", make_clip(30), time, size=SIZE)
        pictures.append(cv2.imread(str(tmp_path / "still.png")).astype(int)[-14:])
    assert (pictures[0] - pictures[1] > 80).any(-1).sum() > 20


def test_a_still_is_the_films_frame(tmp_path, make_clip):
    clip = make_clip(30)
    render_video(tmp_path / "film.mp4", [("anna", clip)], size=SIZE)
    still(tmp_path / "still.png", clip, 1.0, size=SIZE, title="anna")
    picture = cv2.imread(str(tmp_path / "still.png")).astype(int)
    assert np.abs(picture - frames_of(tmp_path / "film.mp4")[30]).mean() < 2.0


def test_mistakes_get_one_line_and_leave_no_file(tmp_path, make_clip):
    clip = make_clip(5)
    for panels, name, size, message in (
        ([], "a.mp4", SIZE, "no clip"),
        ([("a", clip)], "a.avi", SIZE, r"a\.avi.*\.mp4"),
        ([("a", clip)], "a.mp4", (321, 180), "321x180.*even"),
        ([("a", make_clip(0))], "a.mp4", SIZE, "0 frames"),
    ):
        with pytest.raises(CospeechError, match=message):
            render_video(tmp_path / name, panels, size=size)
    with pytest.raises(CospeechError, match=r"no frame at 9 s; the clip lasts 0\.33 s"):
        still(tmp_path / "a.png", clip, 9)
    with pytest.raises(CospeechError):
        render_video(tmp_path / "a.mp4", [("a", clip)], audio=tmp_path / "missing.wav", size=SIZE)
    assert not list(tmp_path.iterdir())


def test_real_recording(tmp_path, recordings):
    from cospeech.formats.mocap import read_mocap_take

    take = recordings / "speech_motion" / "zeggs_067"
    bvh, wav = next(take.glob("*.bvh")), next(take.glob("*.wav"))
    clip = read_mocap_take(bvh, wav, "zeggs", subject="zeggs", clip="067", start=50.0, end=54.0)
    render_video(
        tmp_path / "film.mp4", [("ground truth", clip)], audio=load_audio(wav, start=50.0, end=54.0), size=SIZE
    )
    duration, *_ = facts(tmp_path / "film.mp4")
    frames = frames_of(tmp_path / "film.mp4")
    assert duration == pytest.approx(4.0, abs=0.002) and len(frames) == 120
    assert np.abs(frames[0].astype(int) - frames[60]).max() > 60
