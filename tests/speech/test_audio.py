"""Sound files: every container gives the same samples, and every damaged one a line of its own."""

import warnings
from fractions import Fraction

import av
import numpy as np
import pytest
from scipy.io import wavfile

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.speech import audio_duration, load_audio, write_wav

RATE = 44100
FORMATS = {  # file name -> codec, sample format, encoder's tolerance (lossy ones differ from the source)
    "a.wav": ("pcm_s16le", "s16", 1e-4),
    "a24.wav": ("pcm_s24le", "s32", 1e-6),
    "float.wav": ("pcm_f32le", "flt", 1e-6),
    "a.flac": ("flac", "s16", 1e-4),
    "a.mp3": ("libmp3lame", "fltp", 0.03),
    "a.m4a": ("aac", "fltp", 0.03),
}


@pytest.fixture(autouse=True)
def quiet_is_failure():
    """A notice that no test asked for is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", CospeechNotice)
        yield


def tone(seconds, rate=RATE, frequency=440.0, amplitude=0.3):
    """A tone that grows, so that a shift in time shows as well."""
    time = np.arange(round(seconds * rate)) / rate
    return (amplitude * np.sin(2 * np.pi * frequency * time) * np.linspace(0.2, 1, len(time))).astype(np.float32)


def encode(
    path, channels, rate=RATE, codec="pcm_s16le", sample_format="s16", begin=0.0, video=False, picture=0, **options
):
    """Write `channels` (C, N) with PyAV, after `begin` seconds beside a film when `video` is set, whose first picture
    comes `picture` frames late."""
    layout = {1: "mono", 2: "stereo", 6: "5.1"}[len(channels)]
    with av.open(path, "w", options=options) as container:
        stream = container.add_stream(codec, rate=rate, layout=layout, format=sample_format)
        if video:
            pictures = container.add_stream("mpeg4", rate=25, width=64, height=64, pix_fmt="yuv420p")
            for i in range(25):
                shown = av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8))
                shown.pts = i + picture
                container.mux(pictures.encode(shown))
            container.mux(pictures.encode())
        frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(channels, np.float32), "fltp", layout)
        frame.sample_rate = rate
        fifo = av.AudioFifo()
        for part in av.AudioResampler(format=sample_format).resample(frame):
            part.pts = None
            fifo.write(part)
        position = round(begin * rate)
        while (part := fifo.read(1024) or fifo.read()) is not None:
            part.pts, part.time_base = position, Fraction(1, rate)
            position += part.samples
            container.mux(stream.encode(part))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_source(tmp_path, name):
    codec, sample_format, tolerance = FORMATS[name]
    source = tone(2.5)
    path = encode(tmp_path / name, source[None], codec=codec, sample_format=sample_format)
    samples, rate = load_audio(path)
    assert rate == RATE and samples.dtype == np.float32
    assert 0 <= len(samples) - len(source) <= (1024 if name == "a.m4a" else 0)  # AAC ends with a whole frame
    assert np.abs(samples[: len(source)] - source)[2048:-2048].max() < tolerance


@pytest.mark.parametrize("name", FORMATS)
def test_duration_is_what_loading_gives(tmp_path, name):
    codec, sample_format, _ = FORMATS[name]
    path = encode(tmp_path / name, tone(3.21)[None], codec=codec, sample_format=sample_format)
    samples, rate = load_audio(path)
    assert audio_duration(path) == pytest.approx(len(samples) / rate, abs=1e-9)


def test_channels_are_averaged(tmp_path):
    left = tone(1.0)
    stereo, _ = load_audio(encode(tmp_path / "s.flac", np.stack([left, 0 * left]), codec="flac"))
    assert np.allclose(stereo, left / 2, atol=1e-4)


@pytest.mark.parametrize("channel, weight", enumerate([0.7071, 0.7071, 1.0, 0.0, 0.5, 0.5]))
def test_surround_is_mixed_as_broadcasters_do(tmp_path, channel, weight):
    """ITU-R BS.775, 3/2 to 1/0, without the low-frequency channel; the weights sum to 1 here."""
    channels = np.zeros((6, RATE), np.float32)
    channels[channel] = tone(1.0)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*the sound is silent")
        surround, _ = load_audio(encode(tmp_path / "six.wav", channels))
    assert np.allclose(surround, weight / 3.4142 * tone(1.0), atol=1e-4)


@pytest.mark.parametrize("rate", [8000, 11025, 16000, 22050, 48000])
def test_resampling_keeps_pitch_length_and_time(tmp_path, rate):
    path = encode(tmp_path / "a.wav", tone(2.0)[None])
    samples, got = load_audio(path, rate=rate)
    assert got == rate and len(samples) == 2 * rate
    assert np.abs(samples - tone(2.0, rate))[200:-200].max() < 1e-3


def test_eight_kilohertz_and_eight_bits(tmp_path):
    source = tone(1.0, 8000)
    samples, rate = load_audio(encode(tmp_path / "a.wav", source[None], 8000, "pcm_u8", "u8"))
    assert rate == 8000 and np.abs(samples - source).max() < 0.01


def test_mp3_named_wav(tmp_path):
    mp3 = encode(tmp_path / "a.mp3", tone(1.0)[None], codec="libmp3lame", sample_format="fltp")
    expected, _ = load_audio(mp3)
    samples, _ = load_audio(mp3.rename(tmp_path / "a.wav"))
    assert np.array_equal(samples, expected)


def test_stretch_is_a_slice_of_the_whole(tmp_path):
    path = encode(tmp_path / "a.flac", tone(3.0)[None], codec="flac")
    whole, rate = load_audio(path)
    part, _ = load_audio(path, start=0.731, end=2.2)
    assert np.array_equal(part, whole[round(0.731 * rate) : round(2.2 * rate)])
    tail, _ = load_audio(path, start=2.5, end=3.05)  # a cut list's rounding
    assert np.array_equal(tail, whole[round(2.5 * rate) :])


@pytest.mark.parametrize("start, end", [(-1, None), (2, 1), (1, 1), (3.5, None), (0, 4), (2.9, 9)])
def test_stretch_outside_the_sound(tmp_path, start, end):
    path = encode(tmp_path / "a.wav", tone(3.0)[None])
    with pytest.raises(CospeechError, match=r"a\.wav: (start|end) "):
        load_audio(path, start=start, end=end)


def test_sound_of_a_film_is_on_the_pictures_clock(tmp_path):
    source = tone(0.4)
    film = encode(tmp_path / "film.mkv", source[None], begin=0.5, video=True)
    samples, rate = load_audio(film)
    assert np.abs(samples[: rate // 2 - 50]).max() == 0
    assert np.abs(samples[rate // 2 :][: len(source)] - source[: len(samples) - rate // 2]).max() < 0.02
    assert audio_duration(film) == pytest.approx(len(samples) / rate)


@pytest.mark.parametrize(("suffix", "late"), [("mp4", 12), ("mp4", 60), ("mkv", 12)])  # pictures of 25 a second
def test_a_picture_that_begins_late_damages_no_sound(tmp_path, suffix, late):
    """Sound before the first picture is not asked for; its absence is no damage (`quiet_is_failure`)."""
    source = tone(4.5, 48000)
    film = encode(tmp_path / f"film.{suffix}", source[None], 48000, "aac", "fltp", video=True, picture=late)
    samples, rate = load_audio(film)
    begin = late * rate // 25
    count = min(len(samples), len(source) - begin) - rate // 10
    assert count > 0.9 * (len(source) - begin) - rate // 10
    assert np.abs(samples[:count] - source[begin:][:count]).mean() < 0.005
    assert audio_duration(film) == pytest.approx(len(samples) / rate)
    truncated = tmp_path / f"cut.{suffix}"
    encode(truncated, source[None], 48000, "aac", "fltp", video=True, picture=late, movflags="faststart")
    truncated.write_bytes(truncated.read_bytes()[: truncated.stat().st_size * 6 // 10])
    if suffix == "mp4":  # whose head tells how long it was
        with pytest.warns(CospeechNotice, match="truncated"):
            load_audio(truncated)


def not_sound(folder):
    """Every way of being no sound file, with the words that its line must hold."""
    (folder / "empty.wav").write_bytes(b"")
    (folder / "text.wav").write_text("this is no sound\n" * 99)
    (folder / "noise.mp3").write_bytes(np.random.default_rng(0).bytes(20000))
    (folder / "folder.wav").mkdir()
    wavfile.write(folder / "head.wav", RATE, np.zeros(0, np.int16))
    with av.open(folder / "mute.mp4", "w") as container:
        stream = container.add_stream("mpeg4", rate=25, width=64, height=64, pix_fmt="yuv420p")
        container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8))))
        container.mux(stream.encode())
    whole = encode(folder / "whole.m4a", tone(2.0)[None], codec="aac", sample_format="fltp").read_bytes()
    (folder / "cut.m4a").write_bytes(whole[: len(whole) // 2])  # its index stood at the end
    return {
        "missing.wav": "no such file",
        "folder.wav": "no such file",
        "empty.wav": "empty",
        "text.wav": "not a sound file",
        "noise.mp3": "not a sound file",
        "head.wav": "no sound",
        "mute.mp4": "no audio stream",
        "cut.m4a": "truncated",
    }


def test_what_is_no_sound_gets_one_line(tmp_path):
    for name, words in not_sound(tmp_path).items():
        for read in (load_audio, audio_duration):
            with pytest.raises(CospeechError, match=words) as caught:
                read(tmp_path / name)
            assert str(caught.value).startswith(str(tmp_path / name)) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name, codec, sample_format",
    [
        ("a.wav", "pcm_s16le", "s16"),
        ("a.flac", "flac", "s16"),
        ("a.m4a", "aac", "fltp"),
        ("a.mp3", "libmp3lame", "fltp"),
    ],
)
def test_truncated_files_give_their_beginning(tmp_path, name, codec, sample_format):
    options = {"movflags": "faststart"} if name == "a.m4a" else {}
    source = (np.random.default_rng(1).normal(size=4 * RATE) * 0.05).astype(np.float32)
    path = encode(tmp_path / name, source[None], codec=codec, sample_format=sample_format, **options)
    whole, _ = load_audio(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10 + 1])
    with pytest.warns(CospeechNotice, match="truncated"):
        samples, rate = load_audio(path)
    assert 0.5 * len(whole) < len(samples) < 0.65 * len(whole)
    assert np.array_equal(samples[:-4096], whole[: len(samples) - 4096])
    assert audio_duration(path) == pytest.approx(len(samples) / rate)


def test_damage_in_the_middle_leaves_the_rest_in_its_place(tmp_path):
    source = (np.random.default_rng(1).normal(size=4 * RATE) * 0.05).astype(np.float32)
    path = encode(tmp_path / "a.flac", source[None], codec="flac")
    whole, _ = load_audio(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 9000] = bytes(9000)
    path.write_bytes(data)
    with pytest.warns(CospeechNotice, match="damaged"):
        samples, rate = load_audio(path)
    assert len(samples) == len(whole)
    assert np.array_equal(samples[: rate // 2], whole[: rate // 2]) and np.array_equal(samples[-rate:], whole[-rate:])


@pytest.mark.parametrize("channels, dtype", [(3, np.int16), (1, np.int32), (2, np.float64), (7, np.float32)])
def test_unusual_wav_files(tmp_path, channels, dtype):
    scale = np.iinfo(dtype).max if np.issubdtype(dtype, np.integer) else 1
    wavfile.write(tmp_path / "a.wav", RATE, np.stack([tone(0.5) * scale] * channels, axis=1).astype(dtype))
    samples, _ = load_audio(tmp_path / "a.wav")
    assert np.abs(samples - tone(0.5)).max() < 1e-4


def test_nan_is_refused(tmp_path):
    samples = tone(1.0)
    samples[22050] = np.nan
    wavfile.write(tmp_path / "a.wav", RATE, samples)
    with pytest.raises(CospeechError, match=r"NaN .* first at 0\.50 s"):
        load_audio(tmp_path / "a.wav")


def test_silence_is_noticed(tmp_path):
    path = encode(tmp_path / "a.wav", np.zeros((1, RATE)))
    with pytest.warns(CospeechNotice, match="silent"):
        samples, _ = load_audio(path)
    assert len(samples) == RATE and not samples.any()


def test_clipping_is_noticed_with_its_share(tmp_path):
    loud = np.clip(8 * tone(1.0), -1, 1)
    share = 100 * np.mean(np.abs(loud) == 1)
    path = encode(tmp_path / "a.wav", np.stack([loud, 0 * loud]))  # on one channel: the average is not at full scale
    with pytest.warns(CospeechNotice, match="clipped") as caught:
        load_audio(path)
    assert float(str(caught[0].message).split("clipped, ")[1].split("%")[0]) == pytest.approx(share / 2, rel=0.05)


def test_full_scale_alone_is_not_clipping(tmp_path):
    path = encode(tmp_path / "a.wav", np.sin(2 * np.pi * 441 * np.arange(RATE) / RATE)[None])
    samples, _ = load_audio(path)  # a notice would be an error here
    assert samples.max() > 0.999


def test_write_wav_is_read_back_bit_by_bit(tmp_path):
    pcm = np.random.default_rng(0).integers(-32768, 32768, 5000).astype(np.int16)
    write_wav(tmp_path / "a.wav", pcm / np.float32(32768), 16000)
    rate, read = wavfile.read(tmp_path / "a.wav")
    assert rate == 16000 and np.array_equal(read, pcm)
    samples, _ = load_audio(tmp_path / "a.wav")
    write_wav(tmp_path / "b.wav", samples, 16000)
    assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes()


def test_write_wav_clips_with_a_notice_and_refuses_nan(tmp_path):
    with pytest.warns(CospeechNotice, match="exceed full scale"):
        write_wav(tmp_path / "a.wav", np.array([0.0, 2.0, -2.0]), 8000)
    assert wavfile.read(tmp_path / "a.wav")[1].tolist() == [0, 32767, -32768]
    with pytest.raises(CospeechError, match="NaN"):
        write_wav(tmp_path / "b.wav", np.array([0.0, np.nan]), 8000)
    assert not (tmp_path / "b.wav").exists()


def test_real_recordings(recordings):
    for path in sorted(recordings.glob("speech*/*/*.wav")) + sorted(recordings.glob("video/presenter/*.mp4")):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CospeechNotice)
            samples, rate = load_audio(path)
        assert audio_duration(path) == pytest.approx(len(samples) / rate, abs=1e-9)
        if path.suffix == ".wav":  # the second reader
            scipy_rate, expected = wavfile.read(path)
            assert rate == scipy_rate and np.array_equal(samples, expected / np.float32(32768))
