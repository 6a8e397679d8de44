"""A take of the virtual speaker: its files, its sound and its words."""

import time

import h5py
import numpy as np
import pytest
from scipy.io import wavfile

from cospeech.clip import Clip
from cospeech.demo import read_take, write_take
from cospeech.demo.lexicon import speaker_parameters
from cospeech.demo.script import monologue, texts
from cospeech.demo.voice import speak
from cospeech.errors import CospeechError

SECONDS = 45.0


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    """make(speaker, take, ...) -> (truth path, wav path), each made once."""
    folder, made = tmp_path_factory.mktemp("takes"), {}

    def make(speaker, take=0, seconds=SECONDS, seed=0, copy=0):
        key = (speaker, take, seconds, seed, copy)
        if key not in made:
            stem = folder / "_".join(map(str, key))
            made[key] = stem.with_suffix(".h5"), stem.with_suffix(".wav")
            write_take(speaker, take, seconds=seconds, seed=seed, wav=made[key][1], truth=made[key][0])
        return made[key]

    return make


@pytest.fixture(scope="module", params=["calm", "lively"])
def take(request, make):
    """Everything in one speaker's truth file, and the samples beside it."""
    truth, wav = make(request.param)
    content = {}
    with h5py.File(truth) as file:
        content.update({f"{group}/{name}": item[()] for group in file for name, item in file[group].items()})
    content["rate"], content["samples"] = wavfile.read(wav)
    return content


def test_the_same_take_is_the_same_bytes(make, tmp_path):
    truth, wav = make("lively", seconds=10.0)
    again = tmp_path / truth.name, tmp_path / wav.name
    time.sleep(1.1)  # espeak-ng's noise would follow the clock, in whole seconds
    write_take("lively", 0, seconds=10.0, seed=0, wav=again[1], truth=again[0])
    assert again[0].read_bytes() == truth.read_bytes()
    assert again[1].read_bytes() == wav.read_bytes()


@pytest.mark.parametrize("change", [{"take": 1}, {"seed": 1}, {"speaker": "calm"}])
def test_takes_seeds_and_speakers_differ(make, change):
    one = {"speaker": "lively", "seconds": 10.0}
    assert make(**one)[1].read_bytes() != make(**(one | change))[1].read_bytes()


def test_the_length_is_exact(take):
    assert len(take["samples"]) == round(SECONDS * take["rate"]) and take["rate"] == 22050
    assert len(take["motion/positions"]) == len(take["face/expression"]) == SECONDS * 60


def test_words_ascend_within_the_take(take):
    start, end = take["words/start"], take["words/end"]
    assert len(start) > 60
    assert (np.diff(start) > 0).all() and (end > start).all() and (end[:-1] <= start[1:] + 1e-9).all()
    assert start[0] >= 0 and end[-1] <= SECONDS
    assert end[-1] > SECONDS - 12  # the take is filled with speech


def test_phonemes_lie_where_the_sound_is(take):
    """Vowels are loud, pauses are silent: the synthesizer's times agree with the samples' energy."""
    energy = np.cumsum(np.insert((take["samples"] / 32768.0) ** 2, 0, 0))
    ipa = np.array([p.decode() for p in take["phonemes/ipa"]])
    a, b = ((take[f"phonemes/{side}"] * take["rate"]).round().astype(int) for side in ("start", "end"))
    level = 10 * np.log10((energy[b] - energy[a]) / np.maximum(b - a, 1) + 1e-12)
    stressed_vowel, pause = (take["phonemes/stress"] == 2), (ipa == "") & (b - a > 1000)
    assert np.median(level[stressed_vowel]) > -25
    assert (level[stressed_vowel] > -40).mean() > 0.98
    assert np.median(level[pause]) < np.median(level[stressed_vowel]) - 20
    assert (take["phonemes/word"][ipa != ""] >= 0).all()


def test_the_sound_is_silent_between_the_words(take):
    quiet = np.ones(len(take["samples"]), bool)
    for start, end in zip(take["words/start"], take["words/end"], strict=True):
        quiet[int((start - 0.05) * take["rate"]) : int((end + 0.15) * take["rate"])] = False
    loud = np.abs(take["samples"]).max()
    assert quiet.sum() > take["rate"] and np.abs(take["samples"][quiet]).max() < 0.05 * loud
    assert loud < 32767  # not clipped


def test_the_two_speakers_sound_different(make):
    pitch, rate = {}, {}
    for speaker in ("calm", "lively"):
        with h5py.File(make(speaker)[0]) as file:
            hertz = file["prosody/pitch_hz"][()]
            pitch[speaker] = np.median(hertz[hertz > 0])
            spoken = file["words/end"][()] - file["words/start"][()]
            rate[speaker] = len(spoken) / spoken.sum()
    assert pitch["lively"] > 1.7 * pitch["calm"]
    assert rate["lively"] > 1.15 * rate["calm"]


@pytest.mark.parametrize("fps", [15.0, 25.0, 60.0, 120.0])
def test_a_clip_at_any_rate_shows_the_truth_at_its_times(make, fps):
    truth, wav = make("calm")
    clip = read_take(truth, wav, fps=fps, subject="calm", clip="take_000", audio_path="../media/take_000.wav")
    clip.validate()
    assert len(clip) == round(SECONDS * fps) and clip.features.shape == (len(clip), 28)
    with h5py.File(truth) as file:
        positions = file["motion/positions"][()]
    at = np.minimum(np.arange(len(clip)) / fps, (len(positions) - 1) / 60)
    expected = np.stack([np.interp(at, np.arange(len(positions)) / 60, positions[:, 7, i]) for i in range(3)], axis=1)
    error = np.linalg.norm(clip.positions[:, 7] - expected, axis=1)
    assert np.median(error) < 0.002 and error.max() < 0.08  # the fastest strokes hold more than 15 frames a second can


def test_a_movement_too_fast_for_the_rate_does_not_come_back_as_a_slow_one(make, tmp_path):
    """13 Hz sampled 15 times a second would show as 2 Hz."""
    truth, wav = make("calm", seconds=10.0)
    shaken = tmp_path / "shaken.h5"
    shaken.write_bytes(truth.read_bytes())
    with h5py.File(shaken, "r+") as file:
        rotation = file["face/rotation"]
        rotation[:, 1] = np.sin(2 * np.pi * 13 * np.arange(len(rotation)) / 60)
    clip = read_take(shaken, wav, subject="calm", clip="x")
    assert np.abs(clip.rotation[15:-15, 1]).max() < 0.02


def test_a_clip_survives_writing(make, tmp_path):
    truth, wav = make("lively", seconds=10.0)
    clip = read_take(truth, wav, subject="someone", clip="take_000")
    clip.write(tmp_path / "clip.h5")
    read = Clip.read(tmp_path / "clip.h5")
    assert read.subject == "someone" and read.words.text == clip.words.text and read.face_model == "cospeech64"
    assert read.source == truth.name and np.array_equal(read.positions, clip.positions)


def test_the_wrong_sound_is_refused(make):
    with pytest.raises(CospeechError, match="not the sound that belongs to"):
        read_take(make("calm")[0], make("lively")[1], subject="calm", clip="x")


@pytest.mark.parametrize(
    ("speaker", "seconds", "message"),
    [
        ("nobody", 10.0, "there are calm, lively"),
        ("calm", 2.0, "needs 5 s or more"),
        ("calm", float("nan"), "5 s or more"),
    ],
)
def test_mistakes_are_told_in_one_line(tmp_path, speaker, seconds, message):
    with pytest.raises(CospeechError, match=message) as raised:
        write_take(speaker, 0, seconds=seconds, seed=0, wav=tmp_path / "a.wav", truth=tmp_path / "a.h5")
    assert "\n" not in str(raised.value) and not list(tmp_path.iterdir())


def test_an_unknown_voice_is_told():
    sentence = {"text": "Hello there.", "rate": 150, "pitch": 40, "range": 40, "volume": 60, "pause": 0.2}
    with pytest.raises(CospeechError, match="cannot speak with voice no-such-voice"):
        speak([sentence], "no-such-voice", 5.0)


def test_every_word_of_a_sentence_is_found():
    """Contractions, hyphens, quotes, ampersands, and pairs that espeak-ng speaks as one word."""
    text = "In the end *we* don't say \"of the\" & it is twenty-three; isn't it?"
    sentence = {"text": text, "rate": 150, "pitch": 40, "range": 40, "volume": 60, "pause": 0.25}
    speech = speak([sentence], speaker_parameters("calm")["voice"]["name"], 8.0)
    heard = ["In", "the", "end", "we", "don't", "say", "of", "the", "&", "it", "is", "twenty-three", "isn't", "it"]
    assert speech.words.text == heard
    assert speech.words.start[0] == pytest.approx(0.25, abs=0.06)
    assert [w for w, e in zip(speech.words.text, speech.emphasized, strict=True) if e] == ["we"]


def test_the_texts_are_long_and_never_loop():
    written = [s for name, text in texts().items() if name != "phrases" for p in text for s in p]
    assert sum(len(s.split()) for s in written) > 2500
    hour = [s for s, _ in monologue(9000, np.random.default_rng(0))]
    assert sum(len(s.split()) for s in hour) >= 9000 and not any(mark in "".join(hour) for mark in "{}|#")
    followed = list(zip(hour[:-3], hour[1:-2], hour[2:-1], hour[3:], strict=True))
    assert len(set(followed)) > 0.85 * len(followed)
