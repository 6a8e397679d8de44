"""Takes that cannot be used: each stays behind as a stand-in that says why, so that no bad take stops the others.

A refused track has no parts, a refused clip has no valid frame; nothing trains on it or is judged by it.
"""

import math
import traceback
import warnings

import numpy as np

from cospeech.capture.cleanup.assemble import PARTS
from cospeech.capture.cleanup.clean import completed
from cospeech.capture.cleanup.quality import SCALARS, SHARES, Quality
from cospeech.capture.cleanup.stretch import stand
from cospeech.clip import Clip
from cospeech.errors import CospeechError, notice
from cospeech.formats.mapping import load_mapping
from cospeech.formats.result_table import ABSENT, number, write_table
from cospeech.formats.smplx_motion import smplx_table
from cospeech.skeleton import bone_lengths
from cospeech.track import Track

SILENCE = np.zeros(16000, np.float32), 16000  # stands in for the sound of a film that cannot be read
HEADINGS = (
    "subject",
    "take",
    "refused",
    "valid [%]",
    "body seen [%]",
    "hands seen [%]",
    "face seen [%]",
    "bone deviation [%]",
    "jitter, tracked [m/s^2]",
    "jitter, cleaned [m/s^2]",
)
NOTHING = [ABSENT] * 7  # of the numbers of a take that was refused


def why(error):
    """The reason in one line for which a take is refused: a CospeechError's own, or what went wrong without our having
    foreseen it; the traceback of that is a warning of its own, which the workflow writes into the rule's log."""
    if isinstance(error, CospeechError):
        return str(error)
    warnings.warn("".join(traceback.format_exception(error)), RuntimeWarning, stacklevel=3)
    text = " ".join(str(error).split())[:200]
    return f"unforeseen {type(error).__name__}: {text} (its traceback is in the take's log; please report it)"


def track_or_refusal(run, name):
    """The `Track` that run() returns; where it fails, for whatever reason, a notice, and a refused track that keeps
    why."""
    try:
        return run().validate(name)
    except Exception as error:  # one bad take never stops the others
        reason = why(error)
        notice(f"{name}: refused: {reason}")
        return Track(15.0, 1, 1, 1, refused=reason)


def sound_or_silence(listen, name):
    """(samples, rate) that listen() returns; where it fails, a notice, and a second of silence."""
    try:
        return listen()
    except Exception as error:
        notice(f"{name}: {why(error)}; silence stands in")
        return SILENCE


def clip_or_refusal(make, listen, *, subject, clip, fps, bones=None, audio_path=""):
    """(`Clip`, `Quality`) of one take: what make() returns, which may be the clip alone; where it fails, for whatever
    reason, a notice and `refused_take` with the sound of listen(). bones (55,): the speaker's (default: an adult's)."""
    try:
        made = make()
        return made if isinstance(made, tuple) else (made, quality_of(made))
    except Exception as error:  # one bad take never stops the others
        reason = why(error)
        notice(f"{subject}/{clip}: refused: {reason}")
        sound = sound_or_silence(listen, f"{subject}/{clip}")
        bones = adult_bones() if bones is None else bones
        return refused_take(reason, *sound, bones=bones, subject=subject, clip=clip, fps=fps, audio_path=audio_path)


def adult_bones():
    """(55,) metres: bone lengths of the default SMPL-X skeleton."""
    rest = smplx_table()["rest"]
    points = load_mapping("smplx").bind(tuple(rest), "the default skeleton")
    placed = points.positions(np.array(list(rest.values()))[None], np.zeros((1, len(rest), 4)), 1.0)
    return bone_lengths(placed)


def quality_of(clip):
    """`Quality` of a `Clip` that no capture made: what was recorded, by its confidences, and why it is refused."""
    seen = {part: float((clip.confidence[:, joints] > 0).mean()) for part, joints in PARTS.items()}
    if clip.face_confidence is not None:
        seen["face"] = float((clip.face_confidence > 0).mean())
    lacking = {part: 1 - share for part, share in seen.items()}
    unknown = dict.fromkeys(SCALARS, math.nan) | {"valid": float(clip.valid.mean())}
    return Quality(
        clip.subject,
        clip.clip,
        clip.fps,
        clip.frames,
        "",
        observed=seen,
        interpolated=dict.fromkeys(seen, 0.0),
        excluded=lacking,
        refused=clip.extra.get("refused", ""),
        **unknown,
    )


def refused_take(reason, samples, sample_rate, *, bones, subject, clip, fps, audio_path=""):
    """(Clip, Quality) of a take that is refused for `reason`: somebody with the speaker's bones (55,) who stands still
    for as long as the sound, with confidence 0 and no valid frame; `clip.extra["refused"]` is the reason."""
    from cospeech.speech import integrated_loudness, speech_features

    frames = max(round(len(samples) / sample_rate * fps), 1)
    positions = np.repeat(stand(completed(bones))[None], frames, axis=0).astype(np.float32)
    made = Clip(
        subject,
        clip,
        float(fps),
        positions,
        speech_features(samples, sample_rate, fps=fps, frames=frames),
        valid=np.zeros(frames, bool),
        confidence=np.zeros(positions.shape[:2], np.float32),
        audio=audio_path,
        sample_rate=int(sample_rate),
        loudness_lufs=float(integrated_loudness(samples, sample_rate)),
        extra={"refused": reason},
    )
    none, all_ = (dict.fromkeys(PARTS, share) for share in (0.0, 1.0))
    shares = {key: all_ if key == "excluded" else none for key in SHARES}
    empty = dict.fromkeys(SCALARS, 0.0)
    return made.validate(), Quality(subject, clip, float(fps), frames, "", **shares, **empty, refused=reason)


def write_takes(path, qualities, absent=()):
    """One line a take as CSV: why it was refused, or how good its annotation is. absent : [(subject, take, reason)] of
    those that were left out before anything was made of them."""
    lines = [[q.subject, q.clip, q.refused, *(_numbers(q) if not q.refused else NOTHING)] for q in qualities]
    write_table(path, HEADINGS, lines + [[*one, *NOTHING] for one in absent])


def _numbers(quality):
    """The cells of a take that was annotated: shares in percent, bones, and jitter before and after the clean-up."""
    seen = [quality.observed.get(part, math.nan) for part in ("body", "face")]
    hands = [quality.observed[part] for part in ("right_hand", "left_hand") if part in quality.observed]
    shares = [quality.valid, seen[0], np.mean(hands) if hands else math.nan, seen[1], quality.bone_deviation]
    return [number(100 * share, 4) for share in shares] + [
        number(x, 3) for x in (quality.jitter_raw, quality.jitter_clean)
    ]
