"""What every generator is compared with: motion of the speaker's own that has nothing to do with the speech."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from cospeech.clip import Clip, Motion, speaker_build
from cospeech.errors import CospeechError
from cospeech.gestures.generator import Speech
from cospeech.split import Split


def training_part(folder):
    """The clips of the training part of the subject whose results lie in `folder`, cut to it."""
    ranges = Split.read(Path(folder) / "split.h5").of("train")
    return [Clip.read(Path(folder) / "clips" / f"{take}.h5").section(start, stop) for take, start, stop in ranges]


def mismatched(clips):
    """{clip id: Clip} -> {clip id: Clip}: each clip's speech with the motion of the next by name, as long as both are.

    Raises CospeechError for fewer than two clips.
    """
    names = sorted(clips)
    if len(names) < 2:
        raise CospeechError(f"mismatched: one take, {', '.join(names)}; mismatching needs two takes")
    return {a: _with_motion(clips[a], clips[b]) for a, b in zip(names, names[1:] + names[:1], strict=True)}


def _with_motion(clip, other):
    frames = min(clip.frames, other.frames)
    speech, moved = clip.section(0, frames), other.section(0, frames)
    motion = {name: getattr(moved, name) for name in ("positions", "rotation", "expression", "face_model", "root")}
    known = {"confidence": moved.confidence, "face_confidence": moved.face_confidence}
    return replace(speech, generator="mismatched", valid=speech.valid & moved.valid, **motion, **known)


class Stretches:
    """The valid stretches of the training part; rotation and expression where every clip has them."""

    def __init__(self, clips):
        cut = [_valid_stretches(clip) for clip in clips]
        self.motions = [motion for motions in cut for motion in motions]
        if not self.motions:
            raise CospeechError("training part: no valid frame to take motion from; change 'split:' or the takes")
        models = {clip.face_model for clip in clips}
        self.face_model = models.pop() if len(models) == 1 else ""
        self.names = ["positions"] + [
            name
            for name in ("rotation", "expression")
            if all(getattr(motion, name) is not None for motion in self.motions)
            and (name != "expression" or self.face_model)
        ]

    @classmethod
    def load(cls, name, folder, threads=None):
        """From the training part of the subject whose results lie in `folder`."""
        del name, threads
        return cls(training_part(folder))

    def joined(self, parts):
        """Motion of [(number of a stretch, first frame, frame after the last)] one after the other."""
        arrays = {
            name: np.concatenate([getattr(self.motions[i], name)[start:stop] for i, start, stop in parts])
            for name in self.names
        }
        return Motion(**arrays, face_model=self.face_model if "expression" in arrays else "")


def _valid_stretches(clip):
    edges = np.flatnonzero(np.diff(np.concatenate([[0], clip.valid, [0]])))
    return [clip.section(start, stop).motion for start, stop in edges.reshape(-1, 2)]


class MeanPose(Stretches):
    """`mean_pose`: the training part's mean, held."""

    def __init__(self, clips):
        super().__init__(clips)
        self.build = speaker_build(clips)

    def generate(self, speech, *, seed=0):
        """Speech -> Motion of T frames, all the same; `seed` changes nothing."""
        del seed
        frames = len(Speech.of(speech))
        whole = self.joined([(i, 0, len(motion)) for i, motion in enumerate(self.motions)])
        held = {
            name: np.repeat(getattr(whole, name).mean(axis=0, dtype=np.float64)[None], frames, axis=0)
            for name in self.names
        }
        held = {name: array.astype(np.float32) for name, array in held.items()}
        return replace(whole, **held, build=self.build)


class RandomTake(Stretches):
    """`random`: a random stretch of a training take; where none is long enough, several one after the other."""

    def generate(self, speech, *, seed=0):
        """Speech -> Motion of T frames; another `seed`, another stretch."""
        rng, lengths = np.random.default_rng(seed), np.array([len(motion) for motion in self.motions])
        missing, parts = len(Speech.of(speech)), []
        while missing:
            long = lengths >= missing
            among = np.flatnonzero(long) if long.any() else np.arange(len(lengths))
            chosen = int(rng.choice(among, p=lengths[among] / lengths[among].sum()))
            count = min(missing, int(lengths[chosen]))
            start = int(rng.integers(lengths[chosen] - count + 1))
            parts.append((chosen, start, start + count))
            missing -= count
        return self.joined(parts)
