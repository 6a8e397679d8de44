"""One bad take never stops the others, whatever the reason: it stays behind as a stand-in that says why."""

import csv
import warnings

import numpy as np
import pytest

from cospeech.capture.refusal import (
    adult_bones,
    clip_or_refusal,
    quality_of,
    sound_or_silence,
    track_or_refusal,
    write_takes,
)
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.skeleton import UPPER55, bone_lengths
from cospeech.track import Points, Track
from tests.conftest import make_clip

SOUND = np.full(32000, 0.1, np.float32), 16000
FAILURES = [CospeechError("a.bvh: cut off"), np.linalg.LinAlgError("7th leading minor"), MemoryError()]
FAILURES += [OSError(5, "I/O"), RecursionError("deep"), KeyError("poses"), AssertionError()]


def failing(error):
    def fail(*_):
        raise error

    return fail


def told(function, *arguments, **options):
    """What it returns, its notices, and its other warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = function(*arguments, **options)
    notices = [str(w.message) for w in caught if issubclass(w.category, CospeechNotice)]
    return result, notices, [str(w.message) for w in caught if not issubclass(w.category, CospeechNotice)]


@pytest.mark.parametrize("error", FAILURES, ids=lambda error: type(error).__name__)
def test_whatever_fails_refuses_its_take_alone(error):
    about = {"subject": "s", "clip": "c", "fps": 15.0, "audio_path": "c.wav"}
    (clip, quality), notices, others = told(clip_or_refusal, failing(error), lambda: SOUND, **about)
    track, more, _ = told(track_or_refusal, failing(error), "c")
    assert clip.frames == 30 and not clip.valid.any() and not clip.confidence.any()
    assert clip.extra["refused"] == quality.refused == track.refused
    assert len(notices) == len(more) == 1 and "\n" not in notices[0] and clip.extra["refused"] in notices[0]
    if isinstance(error, CospeechError):
        assert clip.extra["refused"] == "a.bvh: cut off" and not others
    else:
        assert type(error).__name__ in clip.extra["refused"] and "log" in clip.extra["refused"]
        assert "Traceback" in others[0] and "in fail" in others[0]  # the workflow writes these into the rule's log


def test_a_sound_that_fails_too_is_silence():
    (clip, _), notices, _ = told(
        clip_or_refusal, failing(CospeechError("no motion")), failing(ValueError("x")), subject="s", clip="c", fps=15.0
    )
    assert clip.frames == 15 and clip.extra["refused"] == "no motion" and "silence stands in" in notices[1]
    (samples, rate), _, _ = told(sound_or_silence, failing(ValueError("x")), "c")
    assert not samples.any() and rate == 16000


def test_a_track_that_cannot_be_written_is_refused():
    body = Points.empty("upper13", 4)
    body.xy[2] = np.nan
    track, notices, _ = told(track_or_refusal, lambda: Track(15.0, 4, 8, 8, body=body), "c")
    assert "NaN" in track.refused and len(notices) == 1


def test_the_table_has_takes_of_every_kind(tmp_path):
    good = make_clip(frames=100)
    good.confidence[:25] = 0
    good.valid[:50] = False
    (refused, quality), _, _ = told(
        clip_or_refusal, failing(CospeechError("cut off")), lambda: SOUND, subject="toy", clip="bad", fps=15.0
    )
    (same, own), _, _ = told(clip_or_refusal, lambda: good, lambda: SOUND, subject="toy", clip="take00", fps=15.0)
    assert same is good
    write_takes(tmp_path / "takes.csv", [own, quality, quality_of(refused)])
    with open(tmp_path / "takes.csv", newline="", encoding="utf-8") as file:
        first, *others = csv.DictReader(file)
    assert (first["refused"], first["valid [%]"], first["body seen [%]"]) == ("", "50", "75")
    assert first["bone deviation [%]"] == "n/a"
    assert all(row["refused"] == "cut off" and row["valid [%]"] == "n/a" for row in others)


def test_a_stand_in_without_a_speakers_bones_is_an_adult():
    bones = adult_bones()
    forearm, head = UPPER55.joints("left_wrist", "head_top")
    assert bones[forearm] == pytest.approx(0.25) and 0.1 < bones[head] < 0.3
    (clip, _), _, _ = told(clip_or_refusal, failing(KeyError("x")), lambda: SOUND, subject="s", clip="c", fps=15.0)
    np.testing.assert_allclose(bone_lengths(clip.positions)[: len(UPPER55.names[:13])], bones[:13], atol=1e-5)
