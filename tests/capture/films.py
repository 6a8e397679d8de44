"""Small films for tests, written by PyAV: numbered pictures, any times, rotation, sizes and sound tracks."""

from fractions import Fraction

import av
import numpy as np

TICKS = 60000  # a second; a codec of the tests takes no finer ones


def write_film(
    path, pictures, fps=25, times=None, rotation=0, codec="libx264", pixels="yuv444p", sounds=0, aspect=None
):
    """Write (F, H, W, 3) uint8 pictures; `times` (seconds) makes the rate vary, `rotation` sets the display's turn."""
    times = np.arange(len(pictures)) / fps if times is None else np.asarray(times)
    with av.open(path, "w") as container:
        stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001))
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt, stream.codec_context.time_base = pixels, Fraction(1, TICKS)
        if codec == "libx264":
            stream.options = {"crf": "8", "g": "10", "bf": "2"}
        if aspect:
            stream.codec_context.sample_aspect_ratio = Fraction(aspect)
        if rotation:
            stream.set_display_rotation(rotation)
        tracks = [container.add_stream("aac", rate=16000) for _ in range(sounds)]
        for picture, time in zip(pictures, times, strict=True):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "rgb24")
            frame.pts, frame.time_base = round(time * TICKS), Fraction(1, TICKS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
        for number, track in enumerate(tracks):
            _write_tone(container, track, 220.0 * (number + 1), len(pictures) / fps)
    return path


def write_live(path, pictures, times, rate, codec="libvpx"):
    """A webm as browsers record it: no length, no index, clock of a millisecond, and `rate` in its head is not true."""
    with av.open(path, "w", format="webm", options={"live": "1"}) as container:
        stream = container.add_stream(codec, rate=rate)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, 1000)
        stream.bit_rate, stream.options = 20_000_000, {"deadline": "good", "cpu-used": "4", "qmin": "0", "qmax": "2"}
        for picture, time in zip(pictures, times, strict=True):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "rgb24")
            frame.pts, frame.time_base = round(time * 1000), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def _write_tone(container, track, hertz, seconds):
    samples = 0.3 * np.sin(2 * np.pi * hertz * np.arange(round(seconds * 16000)) / 16000)
    for start in range(0, len(samples), 1024):
        block = samples[None, start : start + 1024].astype(np.float32)
        frame = av.AudioFrame.from_ndarray(block, "fltp", "mono")
        frame.sample_rate, frame.pts = 16000, start
        container.mux(track.encode(frame))
    container.mux(track.encode())


def numbered(count, height=48, width=64, step=4):
    """`count` grey pictures whose level is `step` times their number, with a white mark in the upper left corner."""
    pictures = np.repeat((np.arange(count) * step).astype(np.uint8), height * width * 3)
    pictures = pictures.reshape(count, height, width, 3)
    pictures[:, : height // 4, : width // 4] = 255
    return pictures


def numbers(pictures, step=4):
    """The numbers of pictures made by `numbered`, read from their middle."""
    return [round(float(p.rgb[p.rgb.shape[0] // 2, p.rgb.shape[1] // 2].mean()) / step) for p in pictures]


def textured(seed, count, height=96, width=128):
    """A shot: one random texture that moves by a pixel from picture to picture."""
    room = np.random.default_rng(seed).integers(0, 256, (height // 8, (width + 64) // 8, 3)).repeat(8, 0).repeat(8, 1)
    return [room[:, shift : shift + width].astype(np.uint8) for shift in range(count)]
