"""Films and stills of clips: one camera for all panels, H.264 and AAC in an mp4 of exactly the clip's length."""

from fractions import Fraction
from functools import cache
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.clip import Words
from cospeech.errors import CospeechError
from cospeech.files import writing
from cospeech.render.figure import BACKGROUND, FADE, Figure, framing
from cospeech.render.raster import Painter, fade_out

BATCH = 64  # frames posed at once: enough to amortise numpy's overhead, little memory
INK, FAINT = (62, 52, 46), (214, 210, 206)
LEAST_FPS = 24  # a clip below is shown at the smallest multiple of its rate that reaches this
SOUND_RATE = 48000
LINE, PAUSE = 7, 0.6  # subtitles: words a line, and the seconds of silence that end one


def render_video(path, panels, audio=None, size=(960, 540), fps=None, subtitles=True):
    """Write an mp4 that shows clips side by side, with sound.

    Parameters
    ----------
    path : the film, `.mp4`.
    panels : list of (title, Clip), drawn left to right; more than three go into two rows. All share one camera.
    audio : (samples (N,) float32 mono, rate), the path of a sound file, or None for a silent film.
    size : (width, height) in even pixels of the whole picture.
    fps : frames per second; by default the first clip's rate times the smallest whole number that reaches 24.
    subtitles : whether the words of the first clip that has any are shown.

    The film lasts as long as the longest clip, or as the sound where the two agree within one frame of the clip,
    rounded to a whole frame; the sound is cut or filled with silence to the same. Shorter clips hold their last pose.
    Same input, same bytes.
    """
    path = Path(path)
    _check(path, panels, size)
    fps = Fraction(fps).limit_denominator(1001) if fps else _smooth_rate(panels[0][1].fps)
    sound = _sound(audio)
    duration = max(clip.duration for _, clip in panels)
    if sound is not None and abs(len(sound[0]) / sound[1] - duration) <= 1 / panels[0][1].fps:
        duration = len(sound[0]) / sound[1]
    count = max(round(duration * fps), 1)
    with writing(path) as temporary:
        _encode(temporary, _pictures(panels, size, np.arange(count) / float(fps), subtitles), size, fps, sound, count)


def write_film(path, pictures, count, fps, audio=None):
    """Write an mp4 of `count` RGB pictures (height, width, 3) uint8, all of one size, with sound as in `render_video`.

    An odd row or column at the edge is left out, as H.264 wants even sizes.
    """
    path, pictures = Path(path), iter(pictures)
    if path.suffix.lower() != ".mp4":
        raise CospeechError(f"{path}: cannot write this kind of file; give a name that ends in .mp4")
    first = next(pictures)
    size = first.shape[1] // 2 * 2, first.shape[0] // 2 * 2
    shown = (np.ascontiguousarray(p[: size[1], : size[0], ::-1]) for p in chain([first], pictures))
    with writing(path) as temporary:
        _encode(temporary, shown, size, Fraction(fps).limit_denominator(1001), _sound(audio), count)


def still(path, clip, time=0.0, size=(960, 540), title=None):
    """Write one picture (`.png`) of a Clip at `time` seconds, framed as in its film."""
    panels = [(f"{clip.subject} · {clip.clip}" if title is None else title, clip)]
    path = Path(path)
    _check(path, panels, size, suffix=".png")
    if not 0 <= time <= clip.duration:
        raise CospeechError(f"{path}: no frame at {time} s; the clip lasts {clip.duration:.2f} s")
    picture = next(_pictures(panels, size, np.array([time]), subtitles=True))
    with writing(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", picture)[1].tobytes())


def _check(path, panels, size, suffix=".mp4"):
    if path.suffix.lower() != suffix:
        raise CospeechError(f"{path}: cannot write this kind of file; give a name that ends in {suffix}")
    if not panels:
        raise CospeechError(f"{path}: no clip to draw")
    if min(size) < 64 or size[0] % 2 or size[1] % 2:
        raise CospeechError(f"{path}: picture size {size[0]}x{size[1]}; width and height must be even and at least 64")
    for _, clip in panels:
        clip.validate()


def _smooth_rate(fps):
    """`fps` times the smallest whole number that reaches LEAST_FPS, as an exact fraction (15 -> 30)."""
    rate = Fraction(fps).limit_denominator(1001)
    return rate * max(int(np.ceil(LEAST_FPS / rate)), 1)


# ---------------------------------------------------------------------------------------------------------- pictures


def _pictures(panels, size, times, subtitles):
    """Yield a (height, width, 3) uint8 BGR picture for each of `times` (seconds, ascending). The array is reused."""
    columns = len(panels) if len(panels) <= 3 else -(-len(panels) // 2)
    width, height = size[0] // columns, size[1] // -(-len(panels) // columns)
    corners = [(i % columns * width, i // columns * height) for i in range(len(panels))]
    figures = [Figure(clip.positions, clip.face_model) for _, clip in panels]
    painter = Painter(framing(figures, [clip.positions for _, clip in panels], width, height))
    empty = _empty_picture([title for title, _ in panels], corners, size, width, height)
    words = next((clip.words for _, clip in panels if len(clip.words)), Words.none())
    captions = _captions(words) if subtitles else []
    picture = np.empty_like(empty)
    for first in range(0, len(times), BATCH):
        batch = times[first : first + BATCH]
        posed = [figure.pose(*_sampled(clip, batch)) for figure, (_, clip) in zip(figures, panels, strict=True)]
        for i, time in enumerate(batch):
            picture[:] = empty
            for (left, top), figure, (points, colors) in zip(corners, figures, posed, strict=True):
                area = picture[top : top + height, left : left + width]
                painter.draw(area, points[i], colors[i], figure.triangles)
                fade_out(area, round(FADE * height), BACKGROUND)
            spoken = next((text for start, end, text in captions if start <= time < end), "")
            _text(picture, spoken, size[0] / 2, size[1] * 0.965, size[1] / 24, 500)
            yield picture


def _empty_picture(titles, corners, size, width, height):
    """The background with the titles and a thin line between panels."""
    picture = np.empty((size[1], size[0], 3), np.uint8)
    picture[:] = BACKGROUND
    for title, (left, top) in zip(titles, corners, strict=True):
        if left:
            cv2.line(picture, (left, top + height // 20), (left, top + height - height // 20), FAINT, 1)
        area = picture[top : top + height, left : left + width]
        _text(area, str(title), width / 2, height / 14, min(height / 22, width / 20), 600)
    return picture


def _text(picture, text, x, y, size, weight):
    """Write one line centred at x, its baseline at y, `size` pixels high; smaller where it would not fit."""
    if not text:
        return
    font = _font()
    width = cv2.getTextSize((0, 0), text, (0, 0), font, round(size), weight)[2]
    size = max(min(size, size * 0.94 * picture.shape[1] / max(width, 1)), 6)
    width = cv2.getTextSize((0, 0), text, (0, 0), font, round(size), weight)[2]
    cv2.putText(picture, text, (round(x - width / 2), round(y)), INK, font, round(size), weight)


@cache
def _font():
    return cv2.FontFace("sans")  # drawn into OpenCV itself: the same picture on every machine


def _captions(words):
    """(start, end, text) of the lines to show: up to LINE words each, a new one after every pause."""
    captions, first = [], 0
    for i in range(len(words)):
        last = i + 1 == len(words)
        if last or i + 1 - first == LINE or words.start[i + 1] - words.end[i] > PAUSE:
            end = words.end[i] + PAUSE if last else min(words.end[i] + PAUSE, words.start[i + 1])
            captions.append((words.start[first], end, " ".join(words.text[first : i + 1])))
            first = i + 1
    return captions


def _sampled(clip, times):
    """Positions, head rotation and expression of a clip at `times` (seconds), between frames interpolated.

    Frame i of a clip stands for the time i / fps; before the first and after the last the motion holds still.
    """
    at = np.clip(times * clip.fps, 0, clip.frames - 1)
    low = np.minimum(at.astype(int), max(clip.frames - 2, 0))
    share = (at - low).astype(np.float32)
    high = np.minimum(low + 1, clip.frames - 1)

    def between(array):
        part = share.reshape(-1, *[1] * (array.ndim - 1))
        return array[low] * (1 - part) + array[high] * part

    rotation = None
    if clip.rotation is not None:
        start, stop = Rotation.from_rotvec(clip.rotation[low]), Rotation.from_rotvec(clip.rotation[high])
        rotation = (start * Rotation.from_rotvec((start.inv() * stop).as_rotvec() * share[:, None])).as_rotvec()
    return between(clip.positions), rotation, None if clip.expression is None else between(clip.expression)


# ---------------------------------------------------------------------------------------------------------- encoding


def _sound(audio):
    """(samples, rate) of whatever `render_video` takes as audio, or None."""
    if audio is None or isinstance(audio, tuple):
        return audio
    from cospeech.speech import load_audio

    return load_audio(audio)


def _encode(path, pictures, size, fps, sound, count):
    """Write `count` pictures and the sound into one mp4 whose index stands first, so that it plays while it loads."""
    import av

    options = {"movflags": "+faststart", "fflags": "+bitexact"}
    with av.open(str(path), "w", format="mp4", container_options=options) as film:
        # One thread: the picture then does not depend on the machine's number of cores.
        options = {"preset": "veryfast", "x264-params": "subme=1", "crf": "21", "threads": "1"}
        video = film.add_stream("libx264", rate=fps, options=options)
        video.width, video.height, video.pix_fmt = *size, "yuv420p"
        video.codec_context.time_base = 1 / fps
        video.codec_context.gop_size = round(2 * fps)  # a key frame every two seconds makes seeking quick
        voice = film.add_stream("aac", rate=SOUND_RATE, layout="mono") if sound is not None else None
        if voice:
            voice.bit_rate = 96000
        for i, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), format="yuv420p")
            frame.pts, frame.time_base = i, 1 / fps
            film.mux(video.encode(frame))
        film.mux(video.encode(None))
        if voice:
            _encode_sound(film, voice, sound, count / fps)


def _encode_sound(film, voice, sound, duration):
    """Encode the sound, resampled, and cut or filled with silence to `duration` seconds (a Fraction)."""
    import av
    import soxr

    samples, rate = sound
    samples = np.asarray(samples, np.float32)
    if rate != SOUND_RATE:
        samples = soxr.resample(samples, rate, SOUND_RATE)
    length = round(duration * SOUND_RATE)
    samples = np.pad(samples[:length], (0, max(length - len(samples), 0)))
    for start in range(0, length, 1024):
        block = np.ascontiguousarray(np.clip(samples[start : start + 1024], -1, 1)[None])
        frame = av.AudioFrame.from_ndarray(block, format="fltp", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = SOUND_RATE, start, Fraction(1, SOUND_RATE)
        film.mux(voice.encode(frame))
    film.mux(voice.encode(None))
