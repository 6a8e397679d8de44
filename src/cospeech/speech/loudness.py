"""Loudness after EBU R128, as FFmpeg measures it, and its normalization by a pure gain."""

from fractions import Fraction

import numpy as np

TARGET = -23.0  # LUFS, EBU R128
GATE = -70.0  # LUFS, the standard's absolute gate: what lies below is silence
BLOCK = 0.4  # seconds, the standard's gating block


def integrated_loudness(samples, rate):
    """Integrated loudness in LUFS of `samples` (N,) or (N, 2), floats; -inf for silence (below -70 LUFS).

    Measured by FFmpeg's `ebur128` filter (ITU-R BS.1770, EBU R128; steps of 0.001 LU). Sound shorter than the 0.4 s of
    a gating block is measured as one block of its own length.
    """
    samples = np.asarray(samples, np.float32)
    samples = samples[:, None] if samples.ndim == 1 else samples
    peak = float(max(samples.max(initial=0.0), -samples.min(initial=0.0)))
    if peak == 0.0:
        return -np.inf
    # FFmpeg's scale ends at +10 LUFS: floats on the integers' scale are measured at full scale instead.
    scale = peak if peak > 2 else 1.0
    short = max(0, int(np.ceil(BLOCK * rate)) - len(samples))
    diluted = 10 * np.log10(1 + short / len(samples))
    measured = _ebur128(np.pad(samples, ((0, short), (0, 0))) if short else samples, rate, scale)
    return -np.inf if measured <= GATE else float(measured + diluted + 20 * np.log10(scale))


def normalize_loudness(samples, rate, target=TARGET):
    """`samples` times the one gain that brings them to `target` LUFS; silence stays as it is.

    Never dynamic, never limited: peaks may exceed 1 afterwards. The result is for analysis; `write_wav` would clip it.
    """
    samples = np.asarray(samples, np.float32)
    loudness = integrated_loudness(samples, rate)
    return samples if np.isinf(loudness) else samples * np.float32(10 ** ((target - loudness) / 20))


def _ebur128(samples, rate, scale):
    """LUFS of (N, channels) `samples / scale` after the filter's last 0.1 s; block by block, to hold no second copy."""
    import av

    layout = {1: "mono", 2: "stereo"}[samples.shape[1]]
    graph, clock = av.filter.Graph(), Fraction(1, rate)
    source = graph.add_abuffer(sample_rate=rate, format="fltp", layout=layout, time_base=clock)
    measurable = rate if rate % 10 == 0 else 48000  # the filter steps by whole samples of 0.1 s
    meter = [graph.add("aresample", str(measurable)), graph.add("ebur128", "metadata=1"), graph.add("abuffersink")]
    graph.link_nodes(source, *meter).configure()
    loudness = GATE
    for start in range(0, len(samples), rate):
        block = np.ascontiguousarray(samples[start : start + rate].T / np.float32(scale))
        frame = av.AudioFrame.from_ndarray(block, format="fltp", layout=layout)
        frame.sample_rate, frame.time_base, frame.pts = rate, clock, start
        graph.push(frame)
        loudness = _last_reading(graph, loudness)
    graph.push(None)
    return _last_reading(graph, loudness)


def _last_reading(graph, loudness):
    import av

    while True:
        try:
            loudness = float(graph.pull().metadata.get("lavfi.r128.I", loudness))
        except (av.error.BlockingIOError, av.error.EOFError):  # all that there is so far
            return loudness
