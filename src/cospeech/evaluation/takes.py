"""A motion and the speech that it is judged against."""

from dataclasses import dataclass, field, replace

import numpy as np

from cospeech.evaluation.metrics.fgd import FRAMES
from cospeech.evaluation.metrics.gesture_metrics import low_pass
from cospeech.evaluation.metrics.wholeness import window_borders


@dataclass
class Sound:
    """Samples (N,) and their rate, with the onsets that a window of 34 frames has when it is heard alone."""

    samples: np.ndarray
    rate: int
    found: dict = field(default_factory=dict, repr=False)

    @property
    def onsets(self):
        """Of the whole, (K,) ascending seconds."""
        from cospeech.speech import speech_onsets

        return speech_onsets(self.samples, self.rate)

    def window_onsets(self, start, fps):
        """Of the window that begins with frame `start`, in seconds from there."""
        if start not in self.found:
            self.found[start] = self.cut(start, start + FRAMES, fps).onsets
        return self.found[start]

    def cut(self, start, stop, fps):
        """Frames start..stop as a Sound of its own."""
        return Sound(self.samples[round(start / fps * self.rate) : round(stop / fps * self.rate)], self.rate)


@dataclass
class Take:
    """A motion (T, 55, 3), low-passed, and its speech; `onsets` None: no sound at hand.

    rotation : the head's, (T, 3) or None. recorded : (T, 55, 3), the motion that was recorded with this speech.
    sound : Sound or None. speaker : whose motion it is. smoothing : sigma in frames of what low-passed it.
    borders : (T,) bool, see `wholeness.window_borders`.
    """

    positions: np.ndarray
    features: np.ndarray
    valid: np.ndarray
    onsets: np.ndarray | None
    fps: float
    rotation: np.ndarray | None = None
    recorded: np.ndarray | None = None
    sound: Sound | None = None
    speaker: str = ""
    smoothing: float = 0.0
    borders: np.ndarray | None = None

    @classmethod
    def of(cls, clip, sigma=0.0, sound=None):
        """A recorded clip's motion, low-passed, under its own speech; sound : (samples, rate), if at hand."""
        sound = None if sound is None else Sound(*sound)
        done = float(clip.extra.get("smoothing", 0.0))
        onsets = None if sound is None else sound.onsets
        speech = clip.features, clip.valid, onsets, clip.fps
        take = cls(clip.positions, *speech, clip.rotation, None, sound, clip.subject, done).low_passed(sigma)
        return replace(take, recorded=take.positions, borders=window_borders(clip.frames))

    def showing(self, positions, rotation=None, smoothing=None):
        """Another motion under this speech."""
        smoothing = self.smoothing if smoothing is None else smoothing
        return replace(self, positions=positions, rotation=rotation, smoothing=smoothing)

    def low_passed(self, sigma):
        """Joints and head rotation after a Gaussian of `sigma` frames in all.

        Variances add: of what its generator did already, only the rest is done.
        """
        rest = np.sqrt(max(sigma**2 - self.smoothing**2, 0.0))
        rotation = None if self.rotation is None else low_pass(self.rotation, rest)
        return self.showing(low_pass(self.positions, rest), rotation, max(sigma, self.smoothing))

    def cut(self, start, stop):
        """Frames start..stop as a Take of its own."""
        onsets = self.onsets
        if onsets is not None:
            inside = (onsets >= start / self.fps) & (onsets < stop / self.fps)
            onsets = onsets[inside] - start / self.fps
        part = lambda x: None if x is None else x[start:stop]
        return replace(
            self,
            positions=part(self.positions),
            features=part(self.features),
            valid=part(self.valid),
            onsets=onsets,
            rotation=part(self.rotation),
            recorded=part(self.recorded),
            borders=part(self.borders),
            sound=None if self.sound is None else self.sound.cut(start, stop, self.fps),
        )

    def with_speech_of(self, other):
        """This motion under another take's speech, as long as the shorter of the two."""
        frames = min(len(self.positions), len(other.positions))
        own, speech = self.cut(0, frames), other.cut(0, frames)
        return replace(
            own,
            features=speech.features,
            onsets=speech.onsets,
            valid=own.valid & speech.valid,
            recorded=speech.recorded,
            sound=other.sound,
        )

    def pieces(self):
        """Its `stretches` as Takes."""
        return [self.cut(start, stop) for start, stop in stretches(self.valid)]


def stretches(valid):
    """(start, stop) of the runs of at least 34 valid frames, or of the longest where all are shorter; [] if none is."""
    runs = np.flatnonzero(np.diff(np.concatenate([[0], valid, [0]]))).reshape(-1, 2)
    longest = runs[np.argsort(runs[:, 0] - runs[:, 1])][:1]
    return [run for run in runs if run[1] - run[0] >= FRAMES] or list(longest)
