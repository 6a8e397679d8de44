"""A database that grows, and the control signals that it keeps."""

import argparse
import sys

import h5py
import numpy as np
import pytest

from cospeech.clip import Clip, Words
from cospeech.commands import database as command
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.matching import KNN, Database, Matcher
from cospeech.matching.control.signals import SIGNALS, ControlSignals, load_plugins, signal
from cospeech.matching.database.motion_database import extend

LENGTHS = {"a": 300, "b": 129, "c": 64, "d": 207}


@pytest.fixture(scope="module")
def clips(random_takes):
    """Four takes: words in two, an invalid frame, tails of different lengths, head rotations."""
    rng = np.random.default_rng(4)
    positions, features = random_takes(rng, LENGTHS.values())
    made = []
    for name, p, f in zip(LENGTHS, positions, features, strict=True):
        words = Words(np.array([1.0, 2.0]), np.array([1.5, 2.2]), ["so", name]) if name in "ad" else Words.none()
        rotation = rng.normal(size=(len(p), 3)).astype(np.float32)
        made.append(Clip("someone", name, 15.0, p, f, rotation=rotation, words=words))
    made[0].valid[100] = False
    return made


@pytest.fixture
def signals():
    """Takes back what a test adds to the known signals."""
    before = dict(SIGNALS)
    yield SIGNALS
    SIGNALS.clear()
    SIGNALS.update(before)


@pytest.mark.parametrize("first", [1, 2, 3])
def test_extended_is_built_from_all_to_the_last_byte(clips, tmp_path, first):
    starts = [0.0, 12.0, 3.0, 0.5]
    Database.from_clips(clips, starts).save(tmp_path / "all.h5")
    Database.from_clips(clips[:first], starts[:first]).save(tmp_path / "grown.h5")
    extend(tmp_path / "grown.h5", clips[first:], starts=starts[first:])
    assert (tmp_path / "grown.h5").read_bytes() == (tmp_path / "all.h5").read_bytes()


def test_extended_clip_by_clip_and_in_memory(clips):
    whole, grown = Database.from_clips(clips), Database.from_clips(clips[:1])
    for clip in clips[1:]:
        grown = grown.extend([clip])
    for name in ("pose", "audio", "positions", "rotation", "eligible", "real", "take", "start", "word_take"):
        assert np.array_equal(getattr(grown, name), getattr(whole, name)), name
    assert grown.takes == list("abcd") and grown.words.text == whole.words.text == ["so", "a", "so", "d"]
    speech = np.random.default_rng(0).normal(size=(60, 28))
    assert np.array_equal(Matcher(grown).search(speech).positions, Matcher(whole).search(speech).positions)
    for name, stored in whole.signals.items():
        assert np.array_equal(stored.values, grown.signals[name].values)
        assert stored.percentiles == grown.signals[name].percentiles


def test_what_cannot_be_added(clips):
    database = Database.from_clips(clips[:2])
    with pytest.raises(CospeechError, match="take 'b' is in it already; a take can be added once"):
        database.extend([clips[2], clips[1]])
    with pytest.raises(CospeechError, match="take 'c' is in it already"):
        database.extend([clips[2], clips[2]])
    other = Clip("someone", "e", 30.0, clips[3].positions, clips[3].features)
    with pytest.raises(CospeechError, match="made for 15 fps, but clip 'e' has 30"):
        database.extend([other])
    short = Clip("someone", "e", 15.0, clips[3].positions[:40], clips[3].features[:40])
    with pytest.raises(CospeechError, match="the longest has 40 frames, one needs 64"):
        database.extend([short])
    with pytest.warns(CospeechNotice, match="shorter than one clip of 64 frames: e"):
        assert len(database.extend([short, clips[3]])) == len(database) + 3
    other = Clip("x", "f", 15.0, clips[3].positions.copy(), clips[3].features)
    assert database.extend([other]).rotation is None
    other.positions[70] = np.nan
    with pytest.raises(CospeechError, match="take 'f': positions holds NaN or infinity, first in frame 70"):
        database.extend([other])


def test_a_file_keeps_signals_as_their_functions_give_them(clips, tmp_path):
    database = Database.from_clips(clips)
    database.save(tmp_path / "d.h5")
    with h5py.File(tmp_path / "d.h5") as file:
        height = file["signals/left_wrist_height"]
        assert height.shape == (10, 64) and height.dtype == np.float32 and height.attrs["unit"] == "m"
        assert (height.attrs["lower"], height.attrs["upper"]) == ("low", "high") and "left wrist" in height.attrs[
            "about"
        ]
        assert np.array_equal(height[()], database.positions[:, :, 7, 1])
        covered = np.zeros((10, 64), bool)
        for clip, frame in np.argwhere(database.eligible):
            covered[clip, frame : frame + 8] = True
        for percentile, value in height.attrs["percentiles"]:
            assert value == np.percentile(height[()][covered], percentile)
        speed = file["signals/left_wrist_speed"][()]
    moved = np.linalg.norm(np.diff(clips[1].positions[:128, 7], axis=0), axis=1) * 15
    assert np.allclose(speed[4:6].reshape(-1)[1:], moved, rtol=1e-5)  # across the border of take b's two clips
    loaded = Database.load(tmp_path / "d.h5")
    assert set(loaded.signals) == set(SIGNALS)
    assert isinstance(loaded.signals["reach"].values.base, np.memmap)


def test_a_signal_of_a_database_needs_no_function(clips, signals, tmp_path):
    def head_height(positions, fps):
        """height of the head"""
        return positions[:, 12, 1]

    database = Database.from_clips(clips)
    database.add_signal(head_height, "m", "bowed", "up")
    database.save(tmp_path / "d.h5")
    del signals["head_height"]
    knn = KNN(Database.load(tmp_path / "d.h5"))
    match = knn.match(np.zeros((40, 28)), controls=["head_height=up"])
    threshold = ControlSignals(database).percentile("head_height", 85)
    assert (match.positions[::8, 12, 1] >= np.float32(threshold)).all()
    assert knn.signals.percentile("head_height", 33) == ControlSignals(database).percentile("head_height", 33)
    with pytest.raises(CospeechError, match="its function is not installed here"):
        signals["head_height"](clips[0].positions, 15.0)
    with pytest.warns(CospeechNotice, match="signal head_height is left out"):
        assert "head_height" not in Database.load(tmp_path / "d.h5").extend([_renamed(clips[3])]).signals
    with pytest.raises(CospeechError, match="head_height: its function must give one finite number per frame"):
        head_height = lambda positions, fps: positions[:3, 0, 0]
        head_height.__name__ = "head_height"
        database.add_signal(head_height, "m")


def _renamed(clip):
    return Clip("someone", "z", 15.0, clip.positions, clip.features)


def test_a_signal_registered_in_python_is_kept_at_the_build(clips, signals):
    @signal("m/s", "calm", "busy")
    def head_speed(positions, fps):
        """how fast the head moves"""
        moved = np.linalg.norm(np.diff(positions[:, 12], axis=0), axis=1) * fps
        return np.concatenate([moved[:1], moved])

    kept = Database.from_clips(clips).signals["head_speed"]
    assert (kept.unit, kept.lower, kept.upper, kept.about) == ("m/s", "calm", "busy", "how fast the head moves")
    assert np.allclose(kept.values[0], head_speed(clips[0].positions[:256], 15.0)[:64])


def test_an_installed_package_adds_signals(signals, tmp_path, monkeypatch):
    """A package as pip leaves it: a module, and the entry points that its metadata names."""
    (tmp_path / "nods.py").write_text(
        "def nod(positions, fps):\n    'how low the head is'\n    return -positions[:, 12, 1]\n"
    )
    metadata = tmp_path / "nods-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: nods\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[cospeech.signals]\nnod = nods:nod\n")
    monkeypatch.syspath_prepend(tmp_path)
    load_plugins()
    assert (signals["nod"].unit, signals["nod"].about) == ("m", "how low the head is")
    (metadata / "entry_points.txt").write_text("[cospeech.signals]\nnod = nods:shake\n")
    sys.modules.pop("nods")
    with pytest.raises(CospeechError, match=r"control signal 'nod' of 'nods:shake': .*reinstall it"):
        load_plugins()


def test_the_command_extends_and_tells(clips, tmp_path, capsys):
    for clip in clips:
        clip.write(tmp_path / f"{clip.clip}.h5")
    Database.from_clips(clips[:2]).save(tmp_path / "small.h5")
    Database.from_clips(clips).save(tmp_path / "all.h5")
    parser = argparse.ArgumentParser()
    command.add(parser.add_subparsers())

    def run(*words):
        options = parser.parse_args(["database", *map(str, words)])
        options.run(options)
        return capsys.readouterr().out

    grown = tmp_path / "grown.h5"
    assert "grown.h5: 10 clips of 4 takes" in run(
        "extend", tmp_path / "small.h5", *_files(tmp_path, "cd"), "--out", grown
    )
    assert grown.read_bytes() == (tmp_path / "all.h5").read_bytes()
    told = run("info", grown)
    assert "10 clips of 64 frames at 15 fps, 42.7 s" in told and "4 a, 2 b, 1 c, 3 d" in told and "4 words" in told
    assert all(name in told for name in SIGNALS)
    with pytest.raises(CospeechError, match="take 'c' is in it already"):
        run("extend", grown, *_files(tmp_path, "c"))


def _files(folder, names):
    return [folder / f"{name}.h5" for name in names]
