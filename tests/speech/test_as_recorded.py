"""Sound as people record it: opposite channels, offsets, floats beyond full scale, odd headers and codecs."""

import warnings

import av
import numpy as np
import pytest
from scipy.io import wavfile

from cospeech.errors import CospeechNotice
from cospeech.speech import audio_duration, load_audio, speech_features, write_wav
from tests.speech.test_audio import encode, quiet_is_failure, tone  # noqa: F401


def voice(seconds=3.0, rate=16000):
    """Something like syllables, with pauses that are nearly silent."""
    time, noise = np.arange(round(seconds * rate)) / rate, np.random.default_rng(3).normal(size=round(seconds * rate))
    return (0.3 * np.sin(2 * np.pi * 180 * time) * (np.sin(2 * np.pi * 1.5 * time) > 0) + 2e-5 * noise).astype(
        np.float32
    )


def alike(path, plain):
    """Correlation of the energy columns of a file's sound and of `plain`, and the file's samples."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CospeechNotice)
        samples, rate = load_audio(path)
    energy = [speech_features(x, rate)[:, 13] for x in (samples, plain)]
    return np.corrcoef(*energy)[0, 1], samples


@pytest.mark.parametrize("size", [0x7FFFF024, 0x7FFFFFFF, 0x80000024, 0xFFFFFFFF])
def test_a_streamed_header_is_no_damage(tmp_path, size):
    """Who writes into a pipe cannot know the size: sox, ffmpeg, arecord."""
    path = encode(tmp_path / "a.wav", tone(1.0)[None])
    data = bytearray(path.read_bytes())
    at = data.index(b"data") + 4
    data[4:8], data[at : at + 4] = size.to_bytes(4, "little"), (size - 36 & 0xFFFFFFFF).to_bytes(4, "little")
    path.write_bytes(data)
    samples, rate = load_audio(path)  # a notice would be an error here
    assert len(samples) == rate and audio_duration(path) == 1.0


def test_a_film_whose_picture_begins_late_is_whole(tmp_path):
    """Sound before the first picture is left out, and not missed."""
    with av.open(tmp_path / "a.mkv", "w") as container:
        sound = container.add_stream("pcm_s16le", rate=16000, layout="mono")
        film = container.add_stream("mpeg4", rate=25, width=64, height=64, pix_fmt="yuv420p")
        for i in range(25):
            picture = av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8))
            picture.pts = i + 13
            container.mux(film.encode(picture))
        container.mux(film.encode())
        frame = av.AudioFrame.from_ndarray((voice(2.0)[None] * 32768).astype(np.int16), "s16", "mono")
        frame.sample_rate, frame.pts = 16000, 0
        container.mux(sound.encode(frame))
    samples, rate = load_audio(tmp_path / "a.mkv")
    assert len(samples) / rate == pytest.approx(2.0 - 13 / 25, abs=0.01)


@pytest.mark.parametrize("gain, offset", [(-1.0, 0.0), (-0.6, 0.0), (-1.0, 0.2)])
def test_opposite_channels_do_not_cancel(tmp_path, gain, offset):
    plain = voice()
    write_wav(tmp_path / "a.wav", np.stack([plain + offset, gain * plain + offset], axis=1), 16000)
    with pytest.warns(CospeechNotice, match=r"channel 2 has the opposite phase .* is turned"):
        load_audio(tmp_path / "a.wav")
    likeness, samples = alike(tmp_path / "a.wav", plain)
    assert likeness > 0.99 and np.abs(samples - plain * (1 - gain) / 2).max() < 1e-3


def test_wide_stereo_is_left_as_it_is(tmp_path):
    random = np.random.default_rng(0).normal(size=(2, 16000)) * 0.1
    left, right = random[0], 0.95 * random[1] - 0.3 * random[0]  # correlation -0.3
    write_wav(tmp_path / "a.wav", np.stack([left, right], axis=1), 16000)
    samples, _ = load_audio(tmp_path / "a.wav")
    assert np.abs(samples - (left + right) / 2).max() < 1e-4


@pytest.mark.parametrize("offset", [0.3, -0.02, 0.001])
def test_a_constant_offset_is_removed(tmp_path, offset):
    plain = voice()
    wavfile.write(tmp_path / "a.wav", 16000, plain + np.float32(offset))
    with pytest.warns(CospeechNotice, match="constant offset"):
        load_audio(tmp_path / "a.wav")
    likeness, samples = alike(tmp_path / "a.wav", plain)
    assert likeness > 0.99 and np.abs(samples - plain).max() < 1e-4


def test_one_sided_pulses_are_no_offset(tmp_path):
    """A voice's mean is not zero where its pulses are one-sided; its pauses are."""
    pulses = np.maximum(voice(), 0)
    assert pulses.mean() > 0.01
    wavfile.write(tmp_path / "a.wav", 16000, pulses)
    samples, _ = load_audio(tmp_path / "a.wav")  # a notice would be an error here
    assert np.array_equal(samples, pulses)


@pytest.mark.parametrize("gain", [8.0, 32768.0])
def test_floats_beyond_full_scale_are_scaled_and_not_cut(tmp_path, gain):
    plain = voice()
    wavfile.write(tmp_path / "a.wav", 16000, plain * np.float32(gain))
    with pytest.warns(CospeechNotice, match="its peak is .* times full scale") as caught:
        samples, rate = load_audio(tmp_path / "a.wav")
    peak = float(str(caught[0].message).split("its peak is ")[1].split()[0])
    assert len(caught) == 1 and peak == pytest.approx(np.abs(plain).max() * gain, rel=1e-3)
    assert np.abs(samples).max() == pytest.approx(1) and np.allclose(samples, plain / np.abs(plain).max(), atol=1e-5)
    write_wav(tmp_path / "written.wav", samples, rate)  # and so is what lies under media/
    written, _ = load_audio(tmp_path / "written.wav")
    assert np.corrcoef(written, plain)[0, 1] > 0.999999


@pytest.mark.parametrize(
    "codec, sample_format, rate",
    [
        ("adpcm_ima_wav", "s16p", 44100),
        ("adpcm_ms", "s16", 22050),
        ("pcm_mulaw", "s16", 8000),
        ("pcm_alaw", "s16", 8000),
    ],
)
@pytest.mark.parametrize("seconds", [0.9, 5.04])
def test_telephone_codecs_last_as_long_as_what_is_loaded(tmp_path, codec, sample_format, rate, seconds):
    path = encode(tmp_path / "a.wav", tone(seconds, rate)[None], rate, codec, sample_format)
    samples, got = load_audio(path)
    assert got == rate and audio_duration(path) == len(samples) / rate
    assert 0 <= len(samples) / rate - seconds < 0.1  # ADPCM comes in blocks


def test_a_second_sound_track_is_told(tmp_path):
    with av.open(tmp_path / "a.mkv", "w") as container:
        streams = [container.add_stream("pcm_s16le", rate=16000, layout="mono") for _ in range(2)]
        for stream in streams:
            frame = av.AudioFrame.from_ndarray((voice(1.0)[None] * 32768).astype(np.int16), "s16", "mono")
            frame.sample_rate, frame.pts = 16000, 0
            container.mux(stream.encode(frame))
    with pytest.warns(CospeechNotice, match=r"has 2 sound tracks; number 1 .* is read"):
        load_audio(tmp_path / "a.mkv")
