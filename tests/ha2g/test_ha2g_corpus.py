"""The corpus: windows against what they are cut from, filters by hand, and no way from one part into another."""

import librosa
import numpy as np
import pytest

from cospeech.clip import Words
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.gestures.ha2g.dataset.bones import bone_vectors, positions_from_vectors
from cospeech.gestures.ha2g.dataset.collect import Take, collect
from cospeech.gestures.ha2g.dataset.corpus import Corpus
from cospeech.gestures.ha2g.dataset.filters import Filters
from cospeech.gestures.ha2g.dataset.levels import included_angles, level_table
from cospeech.speech.mel import log_mel, log_mel_s2g
from cospeech.split import split_clips
from tests.conftest import make_clip

ANYTHING = Filters(words=0, difference=0.0, spine_most=360.0, spine_mean=360.0, wrist=0.0)
pytestmark = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")


def make_take(seed, subject="one", frames=150):
    """A toy clip, noise for its sound, and a word every 0.4 s."""
    clip = make_clip(seed, frames, subject)
    start = np.arange(0.1, frames / 15 - 0.3, 0.4)
    clip.words = Words(start, start + 0.2, [f"word{i % 7}" for i in range(len(start))])
    samples = np.random.default_rng(seed).normal(0, 0.1, round(frames / 15 * 16000)).astype(np.float32)
    return Take(clip, samples)


@pytest.fixture(scope="module")
def takes():
    return {"one": [make_take(0), make_take(1, frames=200)], "two": [make_take(2, "two")]}


@pytest.fixture(scope="module")
def corpus(takes):
    return collect(takes, filters=ANYTHING)


def test_windows_are_cut_from_their_takes(takes, corpus):
    """Every window on every clock, against the take's own arrays."""
    listed = [take for of_one in takes.values() for take in of_one]
    assert len(corpus) == sum((take.clip.frames - 34) // 10 + 1 for take in listed)
    whole = corpus.windows(slice(None))
    for i, (which, first) in enumerate(zip(corpus.window_take, corpus.window_frame, strict=True)):
        clip, samples = listed[which].clip, np.pad(listed[which].samples, (0, 4000))
        vectors = bone_vectors(clip.positions, clip.rotation, corpus.levels)[first : first + 34].reshape(34, -1)
        np.testing.assert_allclose(whole["poses"][i] + corpus.mean, vectors, atol=1e-6)
        begin = round(first / 15 * 16000)
        np.testing.assert_allclose(whole["wave"][i], samples[begin : begin + 36267], atol=1 / 32768)
        number = corpus.vocabulary.frames(clip.words, clip.frames, 15.0)[first : first + 34]
        np.testing.assert_array_equal(whole["words"][i], number)
        assert corpus.speakers[whole["speaker"][i]] == clip.subject


def test_spectrogram_windows_hear_what_the_wave_windows_hear(corpus):
    """A window's columns are those of its own samples but for the edges and the level that 0 dB is."""
    whole = corpus.windows(slice(0, 20, 7), ("mel", "wave", "s2g_mel"))
    for mel, wave, s2g in zip(whole["mel"], whole["wave"], whole["s2g_mel"], strict=True):
        own = log_mel(wave)[:, :70]
        difference = (mel - own)[:, 3:-3]
        assert np.median(np.abs(difference - np.median(difference))) < 1.5  # half a hop of 512 samples apart at most
        assert np.corrcoef(mel[:, 3:-3].ravel(), own[:, 3:-3].ravel())[0, 1] > 0.7
        np.testing.assert_allclose(np.median(s2g - log_mel_s2g(wave).T), 0, atol=0.15)


def test_log_mel_is_librosas():
    samples = np.random.default_rng(0).normal(0, 0.1, 36267).astype(np.float32)
    power = np.abs(librosa.stft(samples, n_fft=1024, hop_length=512)) ** 2
    expected = librosa.power_to_db(librosa.filters.mel(sr=16000, n_fft=1024, n_mels=128) @ power, ref=np.max)
    np.testing.assert_allclose(log_mel(samples), expected, atol=1e-3)
    assert (log_mel(np.zeros(16000)) == -80).all(), "silence is not loud"


def test_a_tone_lights_its_own_band():
    tone = np.sin(2 * np.pi * 1000 * np.arange(36267) / 16000).astype(np.float32)
    centres = librosa.mel_frequencies(66, fmin=125, fmax=7500, htk=True)[1:-1]
    assert abs(centres[log_mel_s2g(tone)[:, 100].argmax()] - 1000) < 60
    assert log_mel_s2g(tone).shape == (64, 225)


def test_sampling_is_of_the_seed_alone_and_gives_what_is_asked(corpus):
    one, two = (corpus.sample(np.random.default_rng(3), 5, ("poses", "speaker")) for _ in range(2))
    assert set(one) == {"poses", "speaker"} and one["poses"].shape == (5, 34, 126)
    np.testing.assert_array_equal(one["poses"], two["poses"])


def test_a_file_brings_everything_back(corpus, tmp_path):
    corpus.write(tmp_path / "corpus.h5")
    back = Corpus.read(tmp_path / "corpus.h5")
    for key, array in corpus.windows([0, 3, 9]).items():
        np.testing.assert_array_equal(back.windows([0, 3, 9])[key], array)
    assert (back.speakers, back.counts, back.vocabulary.words) == (
        corpus.speakers,
        corpus.counts,
        corpus.vocabulary.words,
    )
    np.testing.assert_array_equal(back.figures["two"].rest, corpus.figures["two"].rest)
    assert back.digest() == corpus.digest()


def test_angle_statistics_are_those_of_all_frames(takes, corpus):
    table = level_table("expressive43")
    angles = np.concatenate(
        [
            included_angles(bone_vectors(t.clip.positions, t.clip.rotation, table), table)
            for of_one in takes.values()
            for t in of_one
        ]
    )
    mean, variance = corpus.angle_statistics()
    np.testing.assert_allclose(mean, angles.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(variance, angles.var(axis=0), atol=1e-6)


@pytest.mark.parametrize("reason", ["invalid", "few words", "mean pose", "bent spine", "still wrists", None])
def test_each_filter_drops_what_it_is_named_for(reason):
    """A figure that waves its left arm passes; each change fails one filter and is counted there."""
    table = level_table("ted10")
    vectors = np.tile(np.array([0.0, 1.0, 0.0]), (34, 9, 1))
    swing = np.linspace(0, 1, 34)
    vectors[:, 5] = np.stack([np.cos(swing), np.sin(swing), 0 * swing], axis=1)
    mean, valid, words = np.zeros((10, 3)), np.ones(34, bool), np.ones(34, int)
    if reason == "invalid":
        valid[20] = False
    elif reason == "few words":
        words[1:] = 0
    elif reason == "bent spine":
        vectors[5, 0] = [np.sin(np.radians(31)), np.cos(np.radians(31)), 0]
    elif reason == "still wrists":
        vectors[:, 5] = vectors[0, 5]
    elif reason == "mean pose":
        mean = positions_from_vectors(vectors, table.lengths, table).mean(axis=0)
        vectors[:, 5] = vectors[17, 5] + 0.01 * vectors[:, 5]
    kept, dropped = Filters().windows(np.array([0]), 34, valid, words, vectors, table, mean)
    assert {name for name, count in dropped.items() if count} == ({reason} if reason else set())
    assert kept.tolist() == [reason is None]


def test_wrist_variance_and_spine_are_at_the_published_thresholds():
    """Closed forms: a wrist that alternates by 2a has variance a^2; 0.0014 is a = 3.74 cm."""
    table, base = level_table("ted10"), np.tile(np.array([0.0, 1.0, 0.0]), (34, 9, 1))
    sign = np.where(np.arange(34) % 2, 1.0, -1.0)
    for variance, still in ((0.00135, True), (0.00145, False)):
        angle = np.arcsin(np.sqrt(variance) / table.lengths[5])
        vectors = base.copy()
        vectors[:, 5] = np.stack([sign * np.sin(angle), np.full(34, np.cos(angle)), np.zeros(34)], axis=1)
        _, dropped = Filters().windows(
            np.array([0]), 34, np.ones(34, bool), np.ones(34, int), vectors, table, np.zeros((10, 3))
        )
        assert bool(dropped["still wrists"]) is still
    assert (Filters().spine_most, Filters().spine_mean, Filters().difference, Filters().words) == (30, 20, 0.02, 2)


def test_short_and_unseen_takes_are_counted(takes):
    short, unseen = make_take(5, frames=74), make_take(6)
    unseen.clip.confidence = np.zeros((150, 55))
    counts = collect({"one": [*takes["one"], short, unseen]}, filters=ANYTHING).counts
    assert (counts["takes"], counts["short"], counts["unseen"]) == (2, 1, 1)


def test_dropped_and_kept_windows_are_all_there_are(takes):
    listed = [take for of_one in takes.values() for take in of_one]
    filters = Filters(words=2, difference=0.0, spine_most=360.0, spine_mean=360.0, wrist=0.14)
    listed[0].clip.valid[:60] = False
    counts = collect(takes, filters=filters).counts
    listed[0].clip.valid[:] = True
    assert counts["invalid"] == 6 and counts["still wrists"] > 0
    names = ("windows", "invalid", "few words", "mean pose", "bent spine", "still wrists")
    assert sum(counts[name] for name in names) == sum((t.clip.frames - 34) // 10 + 1 for t in listed)


def fingerprints(vectors):
    """Frames of unit vectors (T, V, 3) as hashable numbers."""
    rows = np.round(vectors.reshape(len(vectors), -1), 3) + np.float32(0)  # and no -0
    return {row.tobytes() for row in rows.astype(np.float32)}


@pytest.mark.parametrize("by", ["take", "time"])
def test_training_windows_hold_no_frame_of_another_part(by):
    """Every frame's pose is one of a kind here, so a leak would be found by looking for the poses."""
    takes = {f"take{i}": make_take(10 + i, frames=240) for i in range(4)}
    split = split_clips(dict.fromkeys(takes, 240), {}, {"train": 0.6, "val": 0.2, "test": 0.2}, by=by, seed=0)
    parts = {part: [takes[n].clip.section(a, b) for n, a, b in split.of(part)] for part in ("train", "val", "test")}
    sounds = [takes[n].samples[round(a / 15 * 16000) : round(b / 15 * 16000)] for n, a, b in split.of("train")]
    corpus = collect({"one": list(map(Take, parts["train"], sounds))}, filters=ANYTHING)
    seen = fingerprints((corpus.poses + corpus.mean).reshape(-1, 42, 3))
    shared = {
        part: [len(seen & fingerprints(bone_vectors(c.positions, c.rotation, corpus.levels))) for c in clips]
        for part, clips in parts.items()
    }
    assert min(shared["train"]) > 20 and not any(shared["val"] + shared["test"])


def test_bad_input_is_one_line():
    with pytest.raises(CospeechError, match=r"one: no training take of 5 s or more"):
        collect({"one": [make_take(0, frames=60)]}, filters=ANYTHING)
    with pytest.raises(CospeechError, match="no window of 34 frames is left by the filters"):
        collect({"one": [make_take(0)]}, filters=Filters(wrist=1e9))
    loud = make_take(0)
    loud.samples = loud.samples[:50000]
    with pytest.raises(CospeechError, match=r"one/take00: 3\.12 s of sound for 10\.00 s of motion"):
        collect({"one": [loud]}, filters=ANYTHING)
    with pytest.raises(CospeechError, match="for 15 fps, not 30"):
        fast = make_take(0, frames=300)
        fast.clip.fps = 30.0
        collect({"one": [fast]}, filters=ANYTHING)


def test_one_speaker_and_no_words_are_noticed(takes):
    with pytest.warns(CospeechNotice, match="one is the only speaker"):
        collect({"one": takes["one"]}, filters=ANYTHING)
    silent = make_take(0)
    silent.clip.words = Words.none()
    with pytest.warns(CospeechNotice, match="no take has words"):
        assert len(collect({"one": [silent]}, filters=Filters(**vars(ANYTHING) | {"words": 2})))
