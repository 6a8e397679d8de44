"""A track and its sound become a clip and a judgement of its quality (docs/cleanup.md)."""

from pathlib import Path

import numpy as np

from cospeech.capture.cleanup.assemble import HANDS, assemble, in_metres
from cospeech.capture.cleanup.clean import RATE, Cleanup, clean
from cospeech.capture.cleanup.quality import quality_of
from cospeech.capture.cleanup.stretch import Face
from cospeech.capture.fit_face import fit_track
from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError, notice
from cospeech.face.model import EMBEDDED, embedded
from cospeech.skeleton import UPPER55

SILENCE = 16000  # Hz of the silence that stands in for a film without sound


def annotate(
    track,
    audio=None,
    *,
    subject,
    clip,
    fps=RATE,
    audio_start=0.0,
    audio_path="",
    bones=None,
    face_model=None,
    words=None,
    settings=None,
    name="track",
):
    """One take as (`Clip`, `Quality`).

    track : a `Track`. audio : its sound, any file with sound, or None for a film without; at `audio_start` seconds of
    it the track begins. T = round(seconds * fps) of the shorter of both. bones (55,) : the speaker's, from
    `clean.speaker_bones` over all takes. face_model : a `FaceModel`, by default the embedded one. words : `Words`, or
    those in a file beside the sound. audio_path becomes `clip.audio`. Raises CospeechError for takes that are refused:
    no person, too small a face, mostly hidden, no depth.
    """
    settings = settings or Cleanup()
    if track.refused:
        raise CospeechError(track.refused)
    observed = in_metres(assemble(track, name), bones)
    _refuse(track, observed, settings, name)
    seconds = _seconds(track, audio, audio_start, fps, name)
    frames = round(seconds * fps)
    if not frames:
        raise CospeechError(f"{name}: {seconds:.3f} s is less than one frame at {fps:g} fps")
    face, model, licence = _face(track, face_model, name)
    cleaned = clean(
        observed, track.fps, frames, face=face, cuts=track.cuts, bones=bones, settings=settings, rate=fps, name=name
    )
    if not cleaned.valid.any():
        notice(f"{name}: no frame is valid for training: body, face or both hands are unseen for too long")
    quality = quality_of(
        cleaned, observed, track.fps, fps, subject=subject, clip=clip, backend=track.backend, licence_note=licence
    )
    del observed  # an hour of it and an hour of sound are a gigabyte
    head = {
        "subject": subject,
        "clip": clip,
        "fps": float(fps),
        "audio": audio_path,
        "face_model": model,
        "words": _words(audio, words, audio_start, seconds),
        "source": track.source,
        "source_sha256": track.source_sha256,
        "extra": {"tracker": track.backend, "licence_note": licence},
    }
    return _clip(cleaned, *_sound(audio, audio_start, seconds), fps, head).validate(name), quality


def _clip(cleaned, samples, sample_rate, fps, head):
    """The `Clip` of cleaned motion and its sound; `head`: the clip's other fields."""
    from cospeech.speech import integrated_loudness, speech_features

    single = lambda array: None if array is None else array.astype(np.float32)
    face = cleaned.face or Face(None, None)
    expression = single(face.expression)
    if expression is not None and head["face_model"] == EMBEDDED:
        expression = np.clip(expression, 0, 1)  # a cubic through the gaps may leave the coefficients' range
    return Clip(
        positions=single(cleaned.positions),
        features=speech_features(samples, sample_rate, fps=fps, frames=len(cleaned.positions)),
        valid=cleaned.valid,
        confidence=single(cleaned.confidence),
        expression=expression,
        rotation=single(face.rotation),
        face_confidence=single(face.score),
        sample_rate=int(sample_rate),
        loudness_lufs=float(integrated_loudness(samples, sample_rate)),
        **head,
    )


def _refuse(track, observed, settings, name):
    """CospeechError, with the reason, for a take that cannot become a clip; notices for hands and faces never seen."""
    share = float(track.body.observed.mean())
    if not share:
        raise CospeechError(f"{name}: no person was seen in any of its {track.frames} frames; the take is refused")
    if share < settings.least_body:
        raise CospeechError(
            f"{name}: mostly hidden: a body was seen in {share:.0%} of the frames, at least {settings.least_body:.0%} "
            "are needed; the take is refused"
        )
    height = face_height(track, observed)
    if height is not None and height < settings.least_face:
        raise CospeechError(
            f"{name}: low resolution: the face is {height:.0f} pixels high, at least {settings.least_face:.0f} are "
            "needed; the take is refused"
        )
    for part in HANDS:
        points = getattr(track, part)
        if points is None or not points.observed.any():
            notice(f"{name}: the {part.replace('_', ' ')} was never seen; a resting hand stands in, with confidence 0")


def face_height(track, observed):
    """Median height of the face in pixels: of its landmarks, or from neck to crown where it has none; None for what
    was never in a picture (a body from another program that is known in space alone)."""
    points = track.face_landmarks
    if points is not None and points.xy[points.observed].any():
        return float(np.median(np.ptp(points.xy[points.observed][..., 1], axis=1)))
    neck, top = UPPER55.joints("neck", "head_top")
    seen = observed.seen[:, top]
    if not observed.pixels[seen].any():
        return None
    return float(np.median(np.linalg.norm(observed.pixels[seen, top] - observed.pixels[seen, neck], axis=1)))


def _face(track, face_model, name):
    """(`Face` or None, name of the face model, licence note of all): coefficients of the tracker's, or a fit to its
    landmarks."""
    licence = track.licence_note
    if track.face is not None:
        seen = track.face.score > 0
        face, model = Face(track.face.rotation, track.face.score, track.face.expression), track.face.model
    elif track.face_landmarks is not None:
        chosen = face_model or embedded()
        fit, model = fit_track(track, chosen, name=name), chosen.name
        licence = "; ".join(filter(None, [licence, chosen.licence_note]))
        seen = track.face_landmarks.observed
        face = Face(fit.rotation, fit.score, fit.expression)
    else:
        return None, "", licence
    if not seen.any():
        notice(f"{name}: no face was seen in any frame; its confidence is 0")
    return face, model, licence


def _seconds(track, audio, audio_start, fps, name):
    """How long picture and sound both last."""
    from cospeech.speech import audio_duration

    moving = track.frames / track.fps
    if audio is None:
        notice(f"{name}: no sound; the clip's speech features are those of silence")
        return moving
    sounding = audio_duration(audio) - audio_start
    if sounding <= 0:
        raise CospeechError(f"{audio}: ends before the track begins in it, at {audio_start:g} s")
    if abs(moving - sounding) > 1 / fps and not (sounding > moving and audio_start):
        notice(f"{name} lasts {moving:.3f} s, {audio} {sounding:.3f} s; what both have is used")
    return min(moving, sounding)


def _sound(audio, start, seconds):
    """The samples (N,) of the take's sound, and their rate."""
    from cospeech.speech import load_audio

    if audio is None:
        return np.zeros(round(seconds * SILENCE), np.float32), SILENCE
    return load_audio(audio, start=start, end=start + seconds)


def _words(audio, words, start, seconds):
    """The words of the take, in its own time."""
    from cospeech.speech import audio_duration, cut_words, find_words

    if words is None:
        words = find_words(Path(audio), audio_duration(audio)) if audio is not None else None
    if words is None or not len(words):
        return Words.none()
    return cut_words(words, start, start + seconds)
