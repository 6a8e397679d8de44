"""An opened sound file: its samples block by block on the clock of its film, and what was noticed on the way."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError
from cospeech.speech.mono import Downmix

FULL_SCALE = 0.9999  # 32767/32768 is 0.99997; lossy decoders overshoot 1 where the source was clipped
CLIPPED_RUN = 3  # a clean peak touches full scale for a sample or two, a clipped one stays there
BATCH = 1 << 16
GAP = 0.02  # seconds; smaller deviations of a frame's time stamp are rounding of the container
STREAMED = 2**31 - 2**17  # bytes: who cannot go back to fill in the size writes one about this large, or larger


@dataclass
class Sound:
    """An opened file's audio stream, and what was noticed while it was decoded."""

    path: Path
    container: object
    stream: object
    decoded: int = 0  # samples so far, from the origin
    values: int = 0  # samples times channels that were looked at
    clipped: int = 0
    loudest: float = 0.0  # of any channel
    low: float = 0.0  # of the downmix
    high: float = 0.0
    damaged: bool = False
    downmix: Downmix = field(default_factory=Downmix)

    def __post_init__(self):
        """What is asked after the file was closed."""
        tracks, told = self.container.streams.audio, self.stream.metadata
        self.rate, self.codec, self.tracks = self.stream.rate, self.stream.codec_context.name, len(tracks)
        self.track = next(i for i, track in enumerate(tracks, 1) if track.index == self.stream.index)
        self.label = " ".join(filter(None, (told.get("language"), told.get("title")))) or self.codec
        self.declared = self._declared()

    def _declared(self):
        """Seconds from time 0 on that the container declares, or None where it guesses from the bit rate (mp3 without
        its header) or nobody knew the size while it was written."""
        stream, name = self.stream, self.container.format.name
        if stream.duration is None or name == "aac" or (name == "mp3" and not stream.start_time):
            return None
        seconds = float(stream.duration * stream.time_base)
        if self.codec.startswith("pcm_") and seconds * (stream.codec_context.bit_rate or 0) / 8 >= STREAMED:
            return None
        begins = float((stream.start_time or 0) * stream.time_base)
        return begins + seconds - (self.origin or 0.0)  # what sounds before a film's first picture is not asked for

    @property
    def origin(self):
        """Seconds on the container's clock that are time 0: the first picture of a film, else the first sample."""
        from av.stream import Disposition

        for video in self.container.streams.video:
            if video.start_time is not None and not video.disposition & Disposition.attached_pic:
                return float(video.start_time * video.time_base)
        return None if self.stream.start_time is None else float(self.stream.start_time * self.stream.time_base)

    def frames(self) -> Iterator:
        """Decode packet by packet; a damaged packet costs its own sound only."""
        import av

        for packet in self.container.demux(self.stream):
            try:
                yield from packet.decode()
            except av.error.FFmpegError:
                self.damaged = True

    def runs(self) -> Iterator[list]:
        """Frames of one layout that follow each other without a gap, up to about BATCH samples: numpy likes it so."""
        run, count = [], 0
        for frame in self.frames():
            if run:
                timed = frame.time is not None and run[0].time is not None  # some have no time stamp after damage
                gap = frame.time - run[0].time - count / self.rate if timed else 0
                if count >= BATCH or gap > GAP or _kind(frame) != _kind(run[0]):
                    yield run
                    run, count = [], 0
            run.append(frame)
            count += frame.samples
        if run:
            yield run

    def blocks(self) -> Iterator[np.ndarray]:
        """Mono float32 blocks that follow each other without gaps: time stamps that jump are filled with silence."""
        origin = self.origin
        for run in self.runs():
            block, time = self._mono(run), run[0].time
            if time is not None:
                origin = time if origin is None else origin
                gap = round((time - origin) * self.rate) - self.decoded
                if gap > GAP * self.rate:
                    self.damaged |= self.decoded > 0
                    self.decoded += gap
                    yield np.zeros(gap, np.float32)
                elif gap < 0 and self.decoded == 0:
                    block = block[-gap:]
            self.decoded += len(block)
            yield block

    def _mono(self, run):
        if any(frame.sample_rate != self.rate for frame in run):
            raise CospeechError(f"{self.path}: its sample rate changes midway; convert it to a wav file first")
        channels = _channels(run)
        finite = np.isfinite(channels).all(axis=0)
        if not finite.all():
            seconds = (self.decoded + int(np.argmin(finite))) / self.rate
            raise CospeechError(
                f"{self.path}: holds NaN or infinite samples, first at {seconds:.2f} s; export it again"
            )
        self.values += channels.size
        self.clipped += _clipped(channels)
        self.loudest = max(self.loudest, float(np.abs(channels).max(initial=0.0)))
        mono = self.downmix(channels, [channel.name for channel in run[0].layout.channels])
        self.low, self.high = (
            float(f([x, f(mono, initial=0.0)])) for f, x in ((np.min, self.low), (np.max, self.high))
        )
        return mono


@contextmanager
def opened(path):
    """Yield a `Sound`; every way in which a file can fail to be one is a line of its own."""
    import av

    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise CospeechError(f"{path}: the file is empty (0 bytes)")
    try:
        container = av.open(path)
    except OSError as error:  # permissions and the like; PyAV's own errors of content are ValueErrors
        raise CospeechError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (av.error.FFmpegError, ValueError) as error:
        raise CospeechError(f"{path}: not a sound file that can be decoded (truncated, or another format)") from error
    with container:
        stream = container.streams.best("audio")
        if stream is None or stream.codec_context is None or not stream.rate:
            raise CospeechError(f"{path}: has no audio stream that can be decoded; give the sound as a file of its own")
        yield Sound(path, container, stream, damaged=_riff_is_short(path))


def _riff_is_short(path):
    """Whether a wav file ends before its header says so (FFmpeg goes by the file's size and does not tell)."""
    with open(path, "rb") as file:
        head = file.read(8)
    if len(head) < 8 or head[:4] != b"RIFF":
        return False
    size = struct.unpack("<I", head[4:])[0]
    return size < STREAMED and size + 8 > path.stat().st_size + 1


def _kind(frame):
    return frame.format.name, frame.layout.name, frame.time is None


def _channels(run):
    """(channels, samples) float32 of decoded frames of one layout, full scale 1."""
    values = np.concatenate([frame.to_ndarray() for frame in run], axis=1)
    if not run[0].format.is_planar:
        values = values.reshape(-1, run[0].layout.nb_channels).T
    if values.dtype == np.uint8:
        return (values.astype(np.float32) - 128) / 128
    scale = -np.iinfo(values.dtype).min if values.dtype.kind == "i" else 1
    return (values / scale).astype(np.float32)


def _clipped(channels):
    """Number of values in runs of at least CLIPPED_RUN at full scale (one that crosses a block's end is cut there)."""
    full = np.abs(channels) >= FULL_SCALE
    if np.count_nonzero(full) < CLIPPED_RUN:
        return 0
    starts = full[:, :-2] & full[:, 1:-1] & full[:, 2:]
    in_run = np.zeros_like(full)
    for shift in range(CLIPPED_RUN):
        in_run[:, shift : shift + starts.shape[1]] |= starts
    return np.count_nonzero(in_run)
