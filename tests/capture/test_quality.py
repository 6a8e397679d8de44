"""The judgement of a take: shares, bone deviation and jitter against closed forms, and the file's names."""

import h5py
import numpy as np
import pytest
from person import J, make_track, positions

from cospeech.capture.cleanup.assemble import assemble
from cospeech.capture.cleanup.clean import Cleanup, clean
from cospeech.capture.cleanup.gates import robust_bones
from cospeech.capture.cleanup.quality import Quality, bone_deviation, jitter, quality_of
from cospeech.errors import CospeechError
from cospeech.skeleton import LEFT_HAND

SEEN = np.ones((300, 55), bool)


def test_jitter_is_the_mean_acceleration_of_what_was_seen():
    t = np.arange(300) / 30
    motion = np.zeros((300, 55, 3))
    motion[:, J["neck"], 1] = 0.1 * np.cos(2 * np.pi * 2 * t)
    seen = np.zeros_like(SEEN)
    seen[:, [J["neck"], J["pelvis"]]] = True
    expected = 0.1 * (2 * np.pi * 2) ** 2 * 2 / np.pi  # mean of |A w^2 cos|
    assert jitter(motion, seen, 30) == pytest.approx(expected, rel=0.02)
    assert jitter(motion, seen & (np.arange(300) % 3 > 0)[:, None], 30) == 0  # never three frames running
    motion[:] += np.sin(t)[:, None, None]  # the whole person: no joint moves against its root
    assert jitter(motion, seen, 30) == pytest.approx(expected, rel=0.02)


def test_hands_shake_relative_to_their_wrist():
    motion = np.zeros((300, 55, 3))
    motion[:, LEFT_HAND] = np.random.default_rng(0).normal(size=(300, 1, 3))
    seen = np.zeros_like(SEEN)
    seen[:, LEFT_HAND] = True
    assert jitter(motion, seen, 30) == 0


def test_bone_deviation_is_the_mean_share():
    truth = positions(10.0, 30)
    bones = robust_bones([truth], [SEEN])
    assert bone_deviation(truth, SEEN, bones) < 1e-9
    only = np.zeros_like(SEEN)
    only[:, [J["left_elbow"], J["left_wrist"]]] = True
    assert bone_deviation(truth, only, bones * 1.25) == pytest.approx(0.2)


def test_a_take_is_judged_and_read_back_with_the_promised_names(tmp_path):
    track = make_track(seconds=6.0, noise=0.01)
    track.left_hand.observed[60:70] = False
    track.left_hand.observed[100:130] = False
    observed = assemble(track)
    cleaned = clean(observed, 30.0, 90, settings=Cleanup())
    quality = quality_of(cleaned, observed, 30.0, 15.0, subject="s", clip="c", backend="truth", licence_note="n")
    for part in ("body", "left_hand", "right_hand"):
        shares = quality.observed[part] + quality.interpolated[part] + quality.excluded[part]
        assert shares == pytest.approx(1.0)
    assert quality.interpolated["left_hand"] == pytest.approx(5 / 90, abs=0.02)
    assert quality.excluded["left_hand"] == pytest.approx(15 / 90, abs=0.02)
    assert quality.bone_deviation < 1e-6 < quality.bone_deviation_raw
    assert quality.jitter_raw > 5 * quality.jitter_clean > 0
    quality.write(tmp_path / "c.h5")
    with h5py.File(tmp_path / "c.h5") as file:
        assert file["observed/left_hand"][()] == quality.observed["left_hand"]
        for name in ("bone_deviation", "jitter_raw", "jitter_clean"):
            assert file[name].shape == () and file[name][()] == getattr(quality, name)
    again = Quality.read(tmp_path / "c.h5")
    assert again.excluded == quality.excluded and again.licence_note == "n" and again.frames == 90
    assert again.timeline["left_hand"].shape == (90,) and again.timeline["left_hand"][55] == 0
    with pytest.raises(CospeechError, match="schema"):
        Quality.read(_other(tmp_path))


def _other(folder):
    make_track(seconds=1.0).write(folder / "track.h5")
    return folder / "track.h5"
