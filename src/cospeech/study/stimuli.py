"""Which clips a study shows: excerpts of test takes, of every method; from a run's results or from a list of one's own.

A condition is what is judged (a method), a track is what is heard (an excerpt of a take); each condition moves to each
track.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cospeech.clip import Clip
from cospeech.errors import CospeechError, notice
from cospeech.files import read_yaml

TRUTH, MISMATCHED = "ground_truth", "mismatched"
OWN, NONE = "own", "none"  # faces; any other word is the method whose face all wear
VALID = 0.9  # least share of an excerpt's frames that must have been tracked well
FADE = 0.02  # seconds in which the sound of an excerpt comes and goes
MANIFEST_KEYS = {"condition", "track", "motion", "audio", "face", "start", "audio_start"}


@dataclass(frozen=True)
class Stimulus:
    """`seconds` of the clip file `motion` from `start`, heard with `audio` from `audio_start`.

    face : clip file whose expression and head rotation are shown, from `audio_start` on; "own": the motion's, "none".
    """

    condition: str
    track: str
    motion: Path
    start: float
    audio: Path
    audio_start: float
    seconds: float
    face: Path | str = OWN


def cut(stimulus):
    """(Clip, (samples, rate)) of a Stimulus, as long as it says, its words left out."""
    from cospeech.speech import load_audio

    clip = _section(stimulus.motion, stimulus.start, stimulus.seconds)
    if stimulus.face == NONE:
        clip = replace(clip, expression=None, rotation=None)
    elif stimulus.face != OWN:
        face = _section(stimulus.face, stimulus.audio_start, stimulus.seconds)
        if face.expression is None:
            raise CospeechError(f"{stimulus.face}: has no face for the others to wear; choose face 'own' or 'none'")
        clip = replace(clip, expression=face.expression, rotation=face.rotation, face_model=face.face_model)
    end = stimulus.audio_start + stimulus.seconds
    samples, rate = load_audio(stimulus.audio, start=stimulus.audio_start, end=end)
    ramp = np.linspace(0, 1, max(round(FADE * rate), 1), dtype=np.float32)[: len(samples) // 2]
    samples = samples.copy()
    samples[: len(ramp)] *= ramp
    samples[len(samples) - len(ramp) :] *= ramp[::-1]
    return clip, (samples, rate)


def _section(path, start, seconds):
    clip = Clip.read(path)
    first = round(start * clip.fps)
    stop = first + round(seconds * clip.fps)
    if stop > clip.frames:
        raise CospeechError(
            f"{path}: {seconds:g} s from {start:g} s on reach beyond its {clip.duration:.2f} s; choose shorter stimuli"
        )
    return clip.section(first, stop)


# --------------------------------------------------------------------------------------------------- from the results


def from_results(results, subjects, methods, seconds=12.0, excerpts=6, face=TRUTH):
    """List of Stimulus, every method on every track, from a folder of results (results/<subject>/synthesis/...).

    Parameters
    ----------
    subjects : whose test takes. methods : folders under synthesis/, `ground_truth` and `mismatched` (the truth of the
        next excerpt that is from another take) among them.
    excerpts : how many tracks a subject gives; takes are long enough for one or more, and take turns.
    face : "own", "none", or the method whose face all conditions wear (as in thesis Table 4.2 and section 5.4).

    Raises CospeechError for a missing file, for takes shorter than `seconds`, and for `mismatched` of a single take.
    """
    if len(set(methods)) != len(methods) or len(methods) < 2:
        raise CospeechError(f"study: methods {', '.join(methods)}; give two or more different ones")
    stimuli = []
    for subject in subjects:
        folder = Path(results) / subject / "synthesis"
        tracks = _tracks(folder, seconds)
        for i, (take, start) in enumerate(tracks[:excerpts]):
            truth = folder / TRUTH / f"{take}.h5"
            wear = face if face in (OWN, NONE) else _there(folder / face / f"{take}.h5")
            heard = {"audio": _there(truth.with_suffix(".wav")), "audio_start": start, "seconds": seconds, "face": wear}
            for method in methods:
                motion, begin = folder / method / f"{take}.h5", start
                if method == MISMATCHED:
                    other, begin = _other(tracks, i, subject)
                    motion = truth.with_name(f"{other}.h5")
                track = f"{subject}/{take}@{start:.2f}"
                stimuli.append(Stimulus(method, track, _there(motion), begin, **heard))
    return stimuli


def _there(path):
    if not path.is_file():
        raise CospeechError(f"{path}: no such file; run the workflow first, or choose other methods")
    return path


def _other(tracks, i, subject):
    """The next track of another take than track `i`."""
    around = tracks[i + 1 :] + tracks[:i]
    found = next((track for track in around if track[0] != tracks[i][0]), None)
    if found is None:
        raise CospeechError(f"subject {subject!r}: one test take cannot be mismatched; two or more are needed")
    return found


def _tracks(folder, seconds):
    """[(take, start in seconds)]: the first excerpts of all takes, then the second ones...; CospeechError if none."""
    takes = sorted((folder / TRUTH).glob("*.h5"))
    if not takes:
        raise CospeechError(f"{folder / TRUTH}: no test takes; run the workflow first")
    found, longest = [], 0.0
    for path in takes:
        clip = Clip.read(path)
        starts = [start for start in excerpt_starts(clip, seconds) if _tracked(clip, start, seconds)]
        longest = max(longest, clip.duration)
        if not starts:
            notice(f"{path}: gives no stretch of {seconds:g} s that was tracked well ({clip.duration:.2f} s long)")
        found += [(i, path.stem, start) for i, start in enumerate(starts)]
    if not found:
        raise CospeechError(
            f"{folder / TRUTH}: no take has a good stretch of {seconds:g} s (the longest is {longest:.2f} s); "
            "choose shorter stimuli"
        )
    return [(take, start) for _, take, start in sorted(found)]


def excerpt_starts(clip, seconds):
    """Starts in seconds of as many excerpts as fit without overlap, each moved into the longest pause within reach."""
    count = int((clip.duration + 1e-6) / seconds)
    spare = (clip.duration - count * seconds) / max(count, 1)
    ends, nexts = clip.words.end[:-1], clip.words.start[1:]
    starts = []
    for i in range(count):
        first = i * (seconds + spare)
        middle = (ends + nexts) / 2
        near = np.flatnonzero((middle >= first) & (middle <= first + spare))
        start = middle[near[np.argmax((nexts - ends)[near])]] if len(near) else first
        starts.append(float(int(start * clip.fps) / clip.fps))
    return starts


def _tracked(clip, start, seconds):
    first = round(start * clip.fps)
    return clip.valid[first : first + round(seconds * clip.fps)].mean() >= VALID


# ---------------------------------------------------------------------------------------------------- from a manifest


def from_manifest(path, seconds=12.0):
    """(list of Stimulus, {title, instructions, consent, questions}) of a YAML file of one's own (docs/study.md)."""
    path = Path(path)
    told = read_yaml(path)
    listed = told.get("stimuli") if isinstance(told, dict) else None
    if not isinstance(listed, list) or not listed:
        raise CospeechError(f"{path}: expected a key `stimuli` with a list of clips (docs/study.md)")
    texts = {key: value for key, value in told.items() if key != "stimuli"}
    for key in texts.keys() - {"title", "instructions", "consent", "questions"}:
        raise CospeechError(f"{path}: unknown key {key!r}; known: title, instructions, consent, questions, stimuli")
    return [_listed(path, i, entry, seconds) for i, entry in enumerate(listed, 1)], texts


def _listed(path, number, entry, seconds):
    where = f"{path}: stimulus {number}"
    if not isinstance(entry, dict) or entry.keys() - MANIFEST_KEYS or {"condition", "track", "motion"} - entry.keys():
        raise CospeechError(
            f"{where}: expected condition, track, motion and, if wanted, audio, face, start, audio_start"
        )
    start, audio_start = entry.get("start", 0), entry.get("audio_start", entry.get("start", 0))
    if any(isinstance(s, bool) or not isinstance(s, (int, float)) or not s >= 0 for s in (start, audio_start)):
        raise CospeechError(f"{where}: start and audio_start are seconds, 0 or more")
    motion, face = path.parent / str(entry["motion"]), str(entry.get("face", OWN))
    audio = path.parent / str(entry["audio"]) if "audio" in entry else motion.parent / Clip.read(motion).audio
    if not audio.is_file():
        raise CospeechError(f"{where}: no sound at {audio}; give `audio`")
    wear = face if face in (OWN, NONE) else path.parent / face
    return Stimulus(
        str(entry["condition"]), str(entry["track"]), motion, float(start), audio, float(audio_start), seconds, wear
    )
