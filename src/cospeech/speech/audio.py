"""Sound files in and out: whatever PyAV decodes becomes one channel of float32 samples."""

from collections import deque
from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.files import writing
from cospeech.speech.mono import Downmix, offset_of
from cospeech.speech.sound_file import opened

CLIPPED_SHARE = 1e-4
SILENT_PEAK = 10 ** (-70 / 20)
END_TOLERANCE = 0.1  # seconds that `end` may lie beyond the sound: rounding in somebody's cut list
SEEKABLE = {"wav", "flac", "mov,mp4,m4a,3gp,3g2,mj2"}  # their time stamps are exact to the sample


def load_audio(path, rate=None, start=0.0, end=None):
    """Decode a sound file, or the sound of a film, into one channel.

    Returns `(samples (N,) float32, rate)`: stereo is averaged, more channels are mixed as ITU-R BS.775 does, full scale
    is 1, and `rate` (Hz) resamples with soxr HQ; without it the file's own rate stays. `start` and `end` are seconds;
    time 0 is the first sample, in a film its first picture. N = round(duration * rate). With a notice: a channel of
    opposite phase is turned, a constant offset removed, sound beyond full scale scaled to it. Notices tell of silence,
    clipping, further sound tracks and damaged or truncated files; CospeechError of files that hold no sound, NaN
    samples, and a `start` or `end` outside the sound.
    """
    path = Path(path)
    if start < 0 or (end is not None and end <= start):
        raise CospeechError(f"{path}: start {start} s, end {end} s: expected 0 <= start < end")
    if rate is not None and not rate > 0:
        raise CospeechError(f"{path}: a sample rate of {rate} Hz was asked for, expected a positive number")
    sound, samples = _decoded(path, rate, start, end)
    if opposite := sound.downmix.opposite():
        signs, likeness = opposite
        turned = ", ".join(str(i + 1) for i in np.flatnonzero(signs < 0))
        notice(f"{path}: channel {turned} has the opposite phase (correlation {likeness:.2f}) and is turned")
        sound, samples = _decoded(path, rate, start, end, Downmix(signs))
    samples = _levelled(sound, samples, rate or sound.rate)
    _tell(sound, samples, whole=end is None)
    return samples, int(rate or sound.rate)


def audio_duration(path):
    """Seconds of sound that `load_audio` returns for the whole file.

    Where time stamps are exact to the sample (PCM in wav, flac, mp4) only the file's last second is decoded, else all.
    """
    with opened(Path(path)) as sound:
        origin, stream = sound.origin or 0.0, sound.stream
        exact = sound.container.format.name != "wav" or stream.codec_context.name.startswith("pcm_")
        if exact and sound.container.format.name in SEEKABLE and stream.duration:
            sound.container.seek(max(0, stream.duration - round(1 / stream.time_base)), stream=stream)
            last = next(iter(deque(sound.frames(), maxlen=1)), None)
            if last is not None and last.time is not None:
                return (round((last.time - origin) * sound.rate) + last.samples) / sound.rate
    with opened(Path(path)) as sound:
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


def _decoded(path, rate, start, end, downmix=None):
    """(`Sound`, samples (N,)) of a stretch that lies in the sound."""
    with opened(path) as sound:
        sound.downmix = downmix or sound.downmix
        first, last = round(start * sound.rate), None if end is None else round(end * sound.rate)
        samples = _resampled(_cut(sound, first, last), sound.rate, rate or sound.rate)
    duration = sound.decoded / sound.rate
    if not sound.decoded:
        raise CospeechError(f"{path}: its audio stream holds no sound (damaged or truncated)")
    if not len(samples):
        raise CospeechError(f"{path}: start {start} s lies outside the sound, which lasts {duration:.3f} s")
    if end is not None and duration < end - END_TOLERANCE:
        raise CospeechError(f"{path}: end {end} s lies outside the sound, which lasts {duration:.3f} s")
    return sound, samples


def _levelled(sound, samples, rate):
    """Without a constant offset, and scaled where the source, not the resampling, goes beyond full scale."""
    offset = offset_of(samples, rate, scale=max(1.0, sound.loudest))
    if offset:
        notice(f"{sound.path}: a constant offset of {offset:+.4f} of full scale is removed")
        samples = samples - np.float32(offset)
    peak = max(sound.high - offset, offset - sound.low)
    if sound.loudest > 1 and peak > 1:
        decibel = 20 * np.log10(peak)
        notice(f"{sound.path}: its peak is {peak:.4g} times full scale ({decibel:+.1f} dB); it is scaled to full scale")
    return samples / np.float32(peak) if peak > 1 else samples


def _tell(sound, samples, whole):
    """Notices of what was unusual."""
    path, duration, declared = sound.path, sound.decoded / sound.rate, sound.declared
    if sound.damaged or (whole and declared and duration < declared - END_TOLERANCE):
        notice(f"{path}: damaged or truncated; the {duration:.2f} s that could be decoded are used")
    if np.abs(samples).max() < SILENT_PEAK:
        notice(f"{path}: the sound is silent (no sample reaches -70 dB of full scale)")
    share = sound.clipped / max(sound.values, 1)
    beyond = sound.loudest > 1 and sound.codec.startswith("pcm_f")  # floats are not cut off at full scale
    if share > CLIPPED_SHARE and not beyond:
        notice(f"{path}: clipped, {share:.2%} of the samples lie in runs at full scale")
    if sound.tracks > 1:
        notice(
            f"{path}: has {sound.tracks} sound tracks; number {sound.track} ({sound.label}) is read; for another one: "
            f"ffmpeg -i {path.name} -map 0:a:N other.wav (N from 0)"
        )
