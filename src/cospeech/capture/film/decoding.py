"""Films in: decoded by PyAV into upright RGB pictures at a constant rate, in memory that stays flat."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cospeech.capture.film.prefetch import prefetch
from cospeech.capture.film.shots import ShotDetector
from cospeech.errors import CospeechError, notice

FASTEST = 30.5  # Hz; faster films are tracked at every second, fourth... picture: twice the clip's 15 Hz is plenty
TRACKED_SIZE = 1280  # pixels of the longer side that trackers see: their networks take crops of 256 or so
END_TOLERANCE = 0.1  # seconds that a take may end after its film: rounding in somebody's cut list
FASTEST_FILM = 240.0  # Hz; a header that says more is measured: live recordings (webm) name their clock instead
BREAK = 0.5  # seconds without a picture at the end, after which a file counts as broken off
PREFETCH = 8  # pictures decoded ahead of the tracker


@dataclass(frozen=True)
class Film:
    """A stretch of a video file, as trackers see it.

    width, height are pixels of the upright picture, with square pixels; rate is the file's own frames per second
    (the average where it varies), fps that of `pictures`; start and end are seconds, 0 is the file's first picture.
    """

    path: Path
    width: int
    height: int
    rate: float
    fps: float
    start: float
    end: float
    turns: int  # quarter turns, counterclockwise, that put the stored picture upright

    @property
    def frames(self):
        """T = round((end - start) * fps), unless the file turns out to be shorter than it says."""
        return round((self.end - self.start) * self.fps)

    def size(self, longest=TRACKED_SIZE):
        """(width, height) of the pictures when the longer side has at most `longest` pixels."""
        shrink = min(1.0, longest / max(self.width, self.height))
        return max(round(self.width * shrink), 1), max(round(self.height * shrink), 1)

    def pictures(self, longest=TRACKED_SIZE) -> Iterator:
        """Yield a `Picture` for every frame; decoding runs ahead in a thread of its own, by at most 8 pictures."""
        with closing(prefetch(_resampled(self, self.size(longest)), PREFETCH)) as pictures:
            yield from pictures

    def picture_times(self):
        """(N,) seconds at which each picture of the whole file is shown, in order; its rate may vary."""
        with _opened(self.path) as (container, stream):
            times = _packet_times(container, stream)
            return times - float((stream.start_time or 0) * stream.time_base)


@dataclass
class Picture:
    """One frame: rgb (height, width, 3) uint8; `cut` is whether it is the first of a new shot."""

    index: int
    rgb: np.ndarray
    cut: bool


def open_film(path, start=0.0, end=None, fps=None):
    """Look at a video file and return the `Film` of its seconds `start` to `end` (its own end by default).

    Without `fps` it is the file's own rate, halved until it is at most 30. Raises CospeechError for files that hold no
    picture that can be decoded, and for stretches outside of them.
    """
    path = Path(path)
    if start < 0 or (end is not None and end <= start):
        raise CospeechError(f"{path}: start {start:g} s and end {end} s; expected 0 <= start < end")
    with _opened(path) as (container, stream):
        first = next(_decoded(container, stream, path, quiet=True), None)
        if first is None:
            raise CospeechError(f"{path}: no picture in it can be decoded (truncated, or damaged)")
        rate = _rate(container, stream, path)
        width, height = _square_pixels(first, stream)
        duration = _duration(container, stream, rate)
    turns = round(first.rotation / 90) % 4
    if turns % 2:
        width, height = height, width
    if start >= duration or (end or 0) > duration + max(END_TOLERANCE, 1 / rate):
        span = f"from {start:g} s on" if end is None else f"from {start:g} s to {end:g} s"
        raise CospeechError(f"{path}: the take {span} lies outside the video, which lasts {duration:.2f} s")
    chosen = fps or _halved(rate)
    return Film(path, width, height, rate, chosen, start, duration if end is None else min(end, duration), turns)


def _halved(rate):
    while rate > FASTEST:
        rate /= 2
    return rate


def _rate(container, stream, path):
    """Frames per second: the average, or where that is missing, absurd or of a file that knows no length (recorded
    live), what the pictures' own times say, or what the container suggests."""
    ended = stream.duration or container.duration
    if ended and stream.average_rate and 1 <= stream.average_rate <= FASTEST_FILM:
        return float(stream.average_rate)
    with _opened(path) as (container, packets):
        times = _packet_times(container, packets)
    measured = (len(times) - 1) / np.ptp(times) if len(times) > 1 and np.ptp(times) else None
    rates = (measured, stream.average_rate, stream.guessed_rate, stream.base_rate)
    return next((float(rate) for rate in rates if rate and 1 <= rate <= 1000), 25.0)


def _packet_times(container, stream):
    """(N,) seconds on the container's clock of the stream's pictures, in order; nothing is decoded."""
    import av

    stamps = []
    try:
        for packet in container.demux(stream):
            stamp = packet.dts if packet.pts is None else packet.pts
            if stamp is not None and packet.size and not packet.is_discard:
                stamps.append(stamp)
    except av.error.FFmpegError:  # the container breaks off
        pass
    return np.sort(stamps) * float(stream.time_base) if stamps else np.zeros(0)


def _square_pixels(frame, stream):
    aspect = stream.sample_aspect_ratio
    return round(frame.width * float(aspect)) if aspect else frame.width, frame.height


def _duration(container, stream, rate):
    """Seconds from the first picture to the end of the last, as the container says, else from its packets' times."""
    if stream.duration:
        return float(stream.duration * stream.time_base)
    if container.duration:
        return container.duration / 1e6 - max(0.0, float((stream.start_time or 0) * stream.time_base))
    container.seek(0)
    times = _packet_times(container, stream)
    return float(np.ptp(times)) + 1 / rate if len(times) else 0.0


@contextmanager
def _opened(path):
    """Yield (container, video stream); every way in which a file can fail to be a film is a line of its own."""
    import av
    from av.stream import Disposition

    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise CospeechError(f"{path}: the file is empty (0 bytes)")
    try:
        container = av.open(path)
    except OSError as error:  # permissions and the like; PyAV's own errors of content are ValueErrors
        raise CospeechError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (av.error.FFmpegError, ValueError) as error:
        raise CospeechError(f"{path}: not a video that can be decoded (truncated, or another format)") from error
    with container:
        films = [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]
        stream = next((s for s in films if s.codec_context is not None), None)
        if stream is None:
            raise CospeechError(f"{path}: has no video stream that can be decoded; give a film")
        stream.thread_type = "AUTO"
        yield container, stream


def _decoded(container, stream, path, quiet=False):
    """Decode packet by packet; a damaged packet costs its own pictures only, with one notice in the end."""
    import av

    damaged = False
    try:
        for packet in container.demux(stream):
            try:
                yield from packet.decode()
            except av.error.FFmpegError:
                damaged = True
    except av.error.FFmpegError:  # the container itself breaks off
        damaged = True
    if damaged and not quiet:
        notice(f"{path}: parts of it are damaged; pictures that could not be decoded show the one before")


def _timed(film):
    """Yield (seconds from the film's start, frame) in order, beginning with the last picture before `start`."""
    with _opened(film.path) as (container, stream):
        origin = float((stream.start_time or 0) * stream.time_base)
        if film.start > 1:
            container.seek(int((origin + film.start) / stream.time_base), stream=stream)  # the key frame before it
        clock = None
        for frame in _decoded(container, stream, film.path):
            time = (
                clock + 1 / film.rate if frame.time is None and clock is not None else (frame.time or origin) - origin
            )
            if clock is None or time > clock:  # damaged files repeat themselves
                clock = time
                yield time - film.start, frame


def _resampled(film, size):
    """Yield the `Picture` of each i / fps, upright, of this (width, height); shots are told apart on the way."""
    shots, shown, rgb, cut = ShotDetector(), None, None, False
    stored = size if film.turns % 2 == 0 else size[::-1]
    for index, frame in enumerate(_nearest(film)):
        if frame is not shown:
            rgb = frame.reformat(*stored, "rgb24", interpolation="AREA").to_ndarray()
            rgb = np.ascontiguousarray(np.rot90(rgb, film.turns))
        cut = frame is not shown and shots.is_cut(rgb)
        shown = frame
        yield Picture(index, rgb, cut)


def _nearest(film):
    """Yield, for each i / fps, the frame that is nearest in time; the same object again while it is held."""
    index, held = 0, None
    for time, frame in _timed(film):
        while held is not None and index < film.frames and index / film.fps < (held[0] + time) / 2:
            yield held[1]
            index += 1
        if index >= film.frames:
            return
        held = time, frame
    if held is None or held[0] < -1:
        raise CospeechError(f"{film.path}: no picture from {film.start:g} s on can be decoded")
    last, end = film.frames, held[0] + 1 / film.rate
    if film.end - film.start - held[0] > max(BREAK, 2 / film.rate):
        last = round(end * film.fps)
        notice(f"{film.path}: breaks off at {film.start + end:.2f} s of {film.end:.2f} s; the track ends there")
    while index < last:
        yield held[1]
        index += 1
