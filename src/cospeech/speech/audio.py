"""Sound files in and out: whatever PyAV decodes becomes one channel of float32 samples."""

import struct
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.files import writing

FULL_SCALE = 0.9999  # 32767/32768 is 0.99997; lossy decoders overshoot 1 where the source was clipped
CLIPPED_RUN = 3  # a clean peak touches full scale for a sample or two, a clipped one stays there
CLIPPED_SHARE = 1e-4
SILENT_PEAK = 10 ** (-70 / 20)
END_TOLERANCE = 0.1  # seconds that `end` may lie beyond the sound: rounding in somebody's cut list
BATCH = 1 << 16
GAP = 0.02  # seconds; smaller deviations of a frame's time stamp are rounding of the container
SEEKABLE = {"wav", "flac", "mov,mp4,m4a,3gp,3g2,mj2"}  # their time stamps are exact to the sample


@dataclass
class _Sound:
    """An opened file's audio stream, and what was noticed while it was decoded."""

    path: Path
    container: object
    stream: object
    decoded: int = 0  # samples so far, from the origin
    values: int = 0  # samples times channels that were looked at
    clipped: int = 0
    damaged: bool = False

    @property
    def rate(self):
        return self.stream.rate

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
        return channels[0] if len(channels) == 1 else channels.mean(axis=0, dtype=np.float32)


def load_audio(path, rate=None, start=0.0, end=None):
    """Decode a sound file, or the sound of a film, into one channel.

    Returns `(samples (N,) float32, rate)`: several channels are averaged, full scale is 1, and `rate` (Hz) resamples
    with soxr HQ; without it the file's own rate stays. `start` and `end` are seconds; time 0 is the first sample, in a
    film its first picture. N = round(duration * rate). Notices tell of silence, clipping and damaged or truncated
    files; CospeechError of files that hold no sound, NaN samples, and a `start` or `end` outside the sound.
    """
    path = Path(path)
    if start < 0 or (end is not None and end <= start):
        raise CospeechError(f"{path}: start {start} s, end {end} s: expected 0 <= start < end")
    if rate is not None and not rate > 0:
        raise CospeechError(f"{path}: a sample rate of {rate} Hz was asked for, expected a positive number")
    with _opened(path) as sound:
        first, last = round(start * sound.rate), None if end is None else round(end * sound.rate)
        samples = _resampled(_cut(sound, first, last), sound.rate, rate or sound.rate)
        _check(sound, samples, start, end, whole=last is None)
    return samples, int(rate or sound.rate)


def audio_duration(path):
    """Seconds of sound that `load_audio` returns for the whole file.

    Where time stamps are exact to the sample (wav, flac, mp4) only the file's last second is decoded, else all of it.
    """
    with _opened(Path(path)) as sound:
        origin, stream = sound.origin or 0.0, sound.stream
        if sound.container.format.name in SEEKABLE and stream.duration:
            sound.container.seek(max(0, stream.duration - round(1 / stream.time_base)), stream=stream)
            for last in deque(sound.frames(), maxlen=1):
                return (round((last.time - origin) * sound.rate) + last.samples) / sound.rate
            sound.container.seek(0)
        deque(sound.blocks(), maxlen=0)
        if not sound.decoded:
            raise CospeechError(f"{path}: its audio stream holds no sound")
        return sound.decoded / sound.rate


def write_wav(path, samples, rate):
    """Write `samples` (N,) or (N, channels), floats in [-1, 1], as 16 bit PCM.

    Values beyond are clipped, with a notice. What `load_audio` read from 16 bit PCM is written back bit by bit.
    """
    from scipy.io import wavfile

    samples = np.asarray(samples)
    if not np.isfinite(samples).all():
        raise CospeechError(f"{path}: the samples to be written hold NaN or infinity")
    if samples.size and np.abs(samples).max() > 1:
        notice(f"{path}: {np.mean(np.abs(samples) > 1):.2%} of the samples exceed full scale and are clipped")
    pcm = np.clip(np.round(samples * 32768.0), -32768, 32767).astype(np.int16)
    with writing(path) as temporary:
        wavfile.write(temporary, int(rate), pcm)


@contextmanager
def _opened(path):
    """Yield a `_Sound`; every way in which a file can fail to be one is a line of its own."""
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
        yield _Sound(path, container, stream, damaged=_riff_is_short(path))


def _riff_is_short(path):
    """Whether a wav file ends before its header says so (FFmpeg goes by the file's size and does not tell)."""
    with open(path, "rb") as file:
        head = file.read(8)
    if len(head) < 8 or head[:4] != b"RIFF":
        return False
    size = struct.unpack("<I", head[4:])[0]
    return size < 0xFFFFFF00 and size + 8 > path.stat().st_size + 1  # streamed files write the largest size


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


def _cut(sound, first, last):
    """The blocks of samples `first` to `last` (or the end), decoding no further than needed."""
    position = 0
    for block in sound.blocks():
        yield block[max(0, first - position) : None if last is None else max(0, last - position)]
        position += len(block)
        if last is not None and position >= last:
            return


def _resampled(blocks, own, rate):
    """Concatenate, at another rate if asked: block by block, so that only the result is held."""
    import soxr

    if own == rate:
        return np.concatenate([np.zeros(0, np.float32), *blocks])
    stream, count, out = soxr.ResampleStream(own, rate, 1, dtype="float32", quality="HQ"), 0, [np.zeros(0, np.float32)]
    for block in blocks:
        count += len(block)
        out.append(stream.resample_chunk(block))
    out.append(stream.resample_chunk(np.zeros(0, np.float32), last=True))
    samples, length = np.concatenate(out), round(count * rate / own)
    return samples[:length] if len(samples) >= length else np.pad(samples, (0, length - len(samples)))


def _check(sound, samples, start, end, whole):
    """Raise for a stretch outside the sound, and tell what was unusual."""
    path, duration = sound.path, sound.decoded / sound.rate
    if not sound.decoded:
        raise CospeechError(f"{path}: its audio stream holds no sound (damaged or truncated)")
    if not len(samples):
        raise CospeechError(f"{path}: start {start} s lies outside the sound, which lasts {duration:.3f} s")
    if end is not None and duration < end - END_TOLERANCE:
        raise CospeechError(f"{path}: end {end} s lies outside the sound, which lasts {duration:.3f} s")
    declared = _declared(sound)
    if sound.damaged or (whole and declared and duration < declared - END_TOLERANCE):
        notice(f"{path}: damaged or truncated; the {duration:.2f} s that could be decoded are used")
    if np.abs(samples).max() < SILENT_PEAK:
        notice(f"{path}: the sound is silent (no sample reaches -70 dB of full scale)")
    share = sound.clipped / max(sound.values, 1)
    if share > CLIPPED_SHARE:
        notice(f"{path}: clipped, {share:.2%} of the samples lie in runs at full scale")


def _declared(sound):
    """Seconds from time 0 on that the container declares, or None where it only guesses from the bit rate (mp3 without
    its header)."""
    stream, name = sound.stream, sound.container.format.name
    if name == "aac" or (name == "mp3" and not stream.start_time) or stream.duration is None:
        return None
    end = float((stream.start_time or 0) + stream.duration) * float(stream.time_base)
    return end - (sound.origin or 0.0)  # what sounds before a film's first picture is not asked for
