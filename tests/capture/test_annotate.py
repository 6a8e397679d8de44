"""From a track and its sound to a clip: by function and by command, refusals, and whatever sound there is."""

import warnings

import numpy as np
import pytest
from person import head, make_track, positions

from cospeech.capture.annotate import annotate
from cospeech.capture.cleanup.quality import Quality
from cospeech.cli import main
from cospeech.clip import Clip
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.skeleton import LEFT_HAND, RIGHT_HAND
from cospeech.speech import speech_features, write_wav

quiet = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")
RATE = 16000


def sound(folder, seconds, name="take.wav"):
    samples = 0.1 * np.random.default_rng(0).normal(size=round(seconds * RATE)).astype(np.float32)
    write_wav(folder / name, samples, RATE)
    return folder / name


def notices(function, *arguments, **options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = function(*arguments, **options)
    return result, [str(w.message) for w in caught if issubclass(w.category, CospeechNotice)]


def test_a_track_becomes_the_clip_of_the_truth(tmp_path):
    track, wav = make_track(seconds=6.0, noise=0.003), sound(tmp_path, 6.0)
    (clip, quality), told = notices(annotate, track, wav, subject="s", clip="c", audio_path="c.wav")
    assert clip.frames == 90 and not told
    clear, _ = annotate(make_track(seconds=6.0), wav, subject="s", clip="c")
    assert np.median(np.linalg.norm(clip.positions - clear.positions, axis=-1)) < 0.006
    rotation, expression = head(6.0, 15)
    assert np.degrees(np.abs(clip.rotation - rotation)[5:-5]).mean() < 4  # smoothed by 0.1 s and facing forward
    shown = np.flatnonzero(expression.any(axis=0))
    assert min(np.corrcoef(clip.expression[:, j], expression[:, j])[0, 1] for j in shown) > 0.9
    samples = 0.1 * np.random.default_rng(0).normal(size=6 * RATE).astype(np.float32)
    assert np.allclose(clip.features, speech_features(samples, RATE, 15, frames=90), atol=0.1)
    assert clip.face_model == "cospeech64" and clip.valid.all() and clip.extra["licence_note"] == "no terms"
    assert (clip.face_confidence == 1).all() and quality.observed["face"] == 1
    clip.write(tmp_path / "c.h5")
    assert Clip.read(tmp_path / "c.h5").extra["tracker"] == "truth"


def test_hands_sit_on_the_arms_of_a_clip_in_its_own_axes(tmp_path):
    track, wav = make_track(seconds=3.0), sound(tmp_path, 3.0)
    clip, _ = annotate(track, wav, subject="s", clip="c")
    truth = positions(3.0, 15)
    assert np.allclose(clip.positions[:, 4], clip.positions[:, RIGHT_HAND.start], atol=1e-6)
    middle = clip.positions[10:-10].mean(axis=0) - truth[10:-10].mean(axis=0)
    assert np.abs(middle).max() < 0.03  # x left, y up, z forward, as the truth


@quiet
@pytest.mark.parametrize(("seconds", "frames"), [(5.0, 60), (4.02, 60), (2.0, 30)])
def test_the_shorter_of_picture_and_sound_counts(seconds, frames, tmp_path):
    (clip, _), told = notices(annotate, make_track(seconds=4.0), sound(tmp_path, seconds), subject="s", clip="c")
    assert clip.frames == frames and len(clip.features) == frames
    assert bool(told) == (abs(seconds - 4.0) > 1 / 15)


def test_the_track_may_begin_later_in_the_sound(tmp_path):
    wav = sound(tmp_path, 10.0)
    whole, _ = annotate(make_track(seconds=10.0), wav, subject="s", clip="c")
    (part, _), told = notices(annotate, make_track(seconds=4.0), wav, subject="s", clip="c", audio_start=2.0)
    assert part.frames == 60 and not told
    assert np.corrcoef(part.features[5:-5, 0], whole.features[35:85, 0])[0, 1] > 0.99
    with pytest.raises(CospeechError, match="ends before"):
        annotate(make_track(seconds=4.0), wav, subject="s", clip="c", audio_start=11.0)


def test_a_film_without_sound_gives_a_clip_of_silence():
    (clip, _), told = notices(annotate, make_track(seconds=2.0), subject="s", clip="c")
    assert clip.frames == 30 and np.isfinite(clip.features).all() and "no sound" in told[0]


def test_what_is_never_seen_is_told_and_stands_in_without_confidence():
    track = make_track(seconds=2.0)
    track.left_hand.observed[:] = False
    track.face_landmarks.observed[:] = False
    (clip, quality), told = notices(annotate, track, subject="s", clip="c")
    assert any("left hand was never seen" in text for text in told) and any("no face" in text for text in told)
    assert (clip.confidence[:, LEFT_HAND] == 0).all() and not clip.valid.any()
    assert (clip.face_confidence == 0).all() and quality.excluded["face"] == 1


def refused(change, says):
    track = make_track(seconds=2.0)
    change(track)
    with pytest.raises(CospeechError, match=says) as error:
        annotate(track, subject="s", clip="c", name="film")
    assert str(error.value).startswith("film: ") and "\n" not in str(error.value)


@quiet
@pytest.mark.parametrize("parts", [("body", "left_hand", "right_hand", "face_landmarks"), ("body",), ("left_hand",)])
def test_bodies_without_pixels_are_not_judged_by_pixels(parts):
    """As SMPL-X files have them, all of the person or a part: the same clip as with pixels."""
    track, seen = make_track(seconds=3.0), make_track(seconds=3.0)
    for part in parts:
        getattr(track, part).xy[:] = 0
    (clip, quality), _ = notices(annotate, track, subject="s", clip="c")
    (plain, _), _ = notices(annotate, seen, subject="s", clip="c")
    np.testing.assert_allclose(clip.positions, plain.positions, atol=1e-3)
    assert clip.valid.all() and quality.observed["left_hand"] == 1


def test_takes_that_cannot_become_clips_are_refused_with_the_reason():
    refused(lambda track: track.body.observed.fill(False), "no person was seen")
    refused(lambda track: track.body.observed[10:].fill(False), "mostly hidden: a body was seen in 17%")
    refused(lambda track: track.face_landmarks.xy.__imul__(0.2), "low resolution: the face is \\d+ pixels high")
    refused(lambda track: setattr(track, "body", None), "no body in this track")
    refused(lambda track: setattr(track.body, "xyz", None), "two dimensions only")


def test_the_command_writes_clip_and_quality(tmp_path, capsys):
    make_track(seconds=3.0, noise=0.003).write(tmp_path / "t.h5")
    wav = sound(tmp_path, 3.0)
    out, quality = tmp_path / "c.h5", tmp_path / "q.h5"
    asked = ["annotate", str(tmp_path / "t.h5"), "--audio", str(wav), "--out", str(out), "--quality", str(quality)]
    assert main(asked) == 0
    clip = Clip.read(out)
    assert clip.frames == 45 and clip.clip == "c" and (out.parent / clip.audio).samefile(wav)
    assert Quality.read(quality).frames == 45 and "observed" in capsys.readouterr().out
    assert "<html" in quality.with_suffix(".html").read_text()


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (["none.h5", "--out", "c.h5"], "no such file"),
        (["t.h5", "--out", "c.bvh"], "written as .h5"),
        (["t.h5", "--out", "c.h5", "--audio", "none.wav"], "none.wav"),
        (["t.h5", "--out", "c.h5", "--face-model", "none.npz"], "no such face model"),
        (["clip.h5", "--out", "c.h5"], "schema"),
    ],
)
def test_mistakes_at_the_command_are_one_line(asked, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    make_track(seconds=1.0).write("t.h5")
    Quality("s", "c", 15.0, 1, "", {}, {}, {}, 0, 0, 0, 0, 0).write("clip.h5")
    assert main(["annotate", *asked]) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert len(errors) == 1 and says in errors[0]
