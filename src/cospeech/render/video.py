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
from cospeech.render.character.figure import BACKGROUND, FADE, Character, framing
from cospeech.render.character.head import face_of
from cospeech.render.character.triangles import Painter, fade_out

BATCH = 64  # frames posed at once: enough to amortise numpy's overhead, little memory
INK, FAINT = (62, 52, 46), (214, 210, 206)
LEAST_FPS = 24  # a clip below is shown at the smallest multiple of its rate that reaches this
SOUND_RATE = 48000
# Beyond the quickest preset: what makes calm pictures small at hardly any cost.
X264 = "cabac=1:bframes=3:b-adapt=0:deblock=1,0,0:8x8dct=1:partitions=i8x8,i4x4"
LINE, PAUSE = 7, 0.6  # subtitles: words a line, and the seconds of silence that end one


def render_video(path, panels, audio=None, size=(960, 540), fps=None, subtitles=True, **character):
    """Write an mp4 that shows clips side by side, with sound.

    Parameters
    ----------
    path : the film, `.mp4`.
    panels : list of (title, Clip), drawn left to right; more than three go into two rows. All share one camera.
    audio : (samples (N,) float32 mono, rate), the path of a sound file, or None for a silent film.
    size : (width, height) in even pixels of the whole picture.
    fps : frames per second; by default the first clip's rate times the smallest whole number that reaches 24.
    subtitles : whether the words of the first clip that has any are shown.
    character : `posture` of the legs, which clips do not have: "standing", "sitting" or "none"; `whole`, whether they
        are shown down to the floor (by default only sitting), or the upper body larger; `face`, a FaceModel or the file
        of one, whose coefficients the clips have (by default the embedded one).

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
    pictures = _pictures(Stage(panels, size, **character), np.arange(count) / float(fps), subtitles)
    with writing(path) as temporary:
        _encode(temporary, pictures, size, fps, sound, count)


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


def still(path, clip, time=0.0, size=(960, 540), title=None, **character):
    """Write one picture (`.png`) of a Clip at `time` seconds, framed as in its film; `character` as there."""
    panels = [(f"{clip.subject} · {clip.clip}" if title is None else title, clip)]
    path = Path(path)
    _check(path, panels, size, suffix=".png")
    if not 0 <= time <= clip.duration:
        raise CospeechError(f"{path}: no frame at {time} s; the clip lasts {clip.duration:.2f} s")
    picture = next(_pictures(Stage(panels, size, **character), np.array([time]), subtitles=True))
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


class Stage:
    """The characters of clips side by side, in one picture of size (width, height), through one camera.

    panels : list of (title, Clip); more than three go into two rows. posture, whole, face : as of `render_video`.
    """

    def __init__(self, panels, size, posture="standing", whole=None, face=None):
        columns = len(panels) if len(panels) <= 3 else -(-len(panels) // 2)
        self.width, self.height = size[0] // columns, size[1] // -(-len(panels) // columns)
        self.whole = posture == "sitting" if whole is None else whole
        self.clips, faces = [clip for _, clip in panels], [face_of(clip, face) for _, clip in panels]
        self.expressions = [expression for _, expression in faces]
        self.figures = [
            Character(clip.positions, each, posture) for clip, (each, _) in zip(self.clips, faces, strict=True)
        ]
        self.corners = [(i % columns * self.width, i // columns * self.height) for i in range(len(panels))]
        motions = [clip.positions for clip in self.clips]
        self.painter = Painter(framing(self.figures, motions, self.width, self.height, self.whole))
        titles = [title for title, _ in panels]
        self.empty = _empty_picture(titles, self.corners, size, self.width, self.height)

    def areas(self, picture):
        """[(area, Character, Clip, expression)]: each panel's part of a picture (H, W, 3), and whom it shows."""
        parts = [picture[top : top + self.height, left : left + self.width] for left, top in self.corners]
        return list(zip(parts, self.figures, self.clips, self.expressions, strict=True))

    def fade(self, area):
        """Let the legs of a character that is not shown whole fade away, in place."""
        if not self.whole:
            fade_out(area, round(FADE * self.height), BACKGROUND)


def _pictures(stage, times, subtitles):
    """Yield a (height, width, 3) uint8 BGR picture for each of `times` (seconds, ascending). The array is reused."""
    words = next((clip.words for clip in stage.clips if len(clip.words)), Words.none())
    captions = _captions(words) if subtitles else []
    picture = np.empty_like(stage.empty)
    height, width = picture.shape[:2]
    areas = stage.areas(picture)
    for first in range(0, len(times), BATCH):
        batch = times[first : first + BATCH]
        posed = [figure.pose(*_sampled(clip, batch, expression)) for _, figure, clip, expression in areas]
        for i, time in enumerate(batch):
            picture[:] = stage.empty
            for (area, figure, *_), (points, bright) in zip(areas, posed, strict=True):
                stage.painter.draw(area, points[i], bright[i], figure.triangles, figure.colors)
                stage.fade(area)
            spoken = next((text for start, end, text in captions if start <= time < end), "")
            _text(picture, spoken, width / 2, height * 0.965, height / 24, 500)
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


def _sampled(clip, times, expression=None):
    """Positions, head rotation and `expression` (T, E) of a clip at `times` (seconds), between frames interpolated.

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
    return between(clip.positions), rotation, None if expression is None else between(expression)


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
        options = {"preset": "ultrafast", "x264-params": X264, "crf": "27", "threads": "1"}
        video = film.add_stream("libx264", rate=fps, options=options)
        video.width, video.height, video.pix_fmt = *size, "yuv420p"
        video.codec_context.time_base = 1 / fps
        video.codec_context.gop_size = round(2 * fps)  # a key frame every two seconds makes seeking quick
        quick = {"aac_coder": "fast"}
        voice = film.add_stream("aac", rate=SOUND_RATE, layout="mono", options=quick) if sound is not None else None
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
