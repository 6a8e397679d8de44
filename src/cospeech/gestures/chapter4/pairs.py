"""Speech and motion of the training part, as the chapter 4 networks meet them: windows, channels, statistics."""

import numpy as np
import torch

from cospeech.clip import speaker_build
from cospeech.gestures.chapter4.vectors import motion_to_vectors
from cospeech.learning.training import device
from cospeech.learning.unet1d import ZScored
from cospeech.learning.windows import Windows, divisor, moments

PARTS = ("face", "body", "hands")


class Pairs:
    """Windows of `frames` frames of clips: `features` and the vectors of `motion_to_vectors` that every clip has.

    further : {name: list of (T, C), one a clip}, what else belongs to the frames.

    Attributes: windows; channels {name: C}; statistics {name: (mean (C,), deviation (C,))}; changes {name: deviation
    (C,) of the change from frame to frame}; parts, those of `PARTS` that there are; fps; face_model, "" without a face;
    build, the speaker's.
    """

    def __init__(self, clips, frames, further=None):
        sequences = [{"features": clip.features, **motion_to_vectors(clip.motion)} for clip in clips]
        for name, arrays in (further or {}).items():
            for sequence, array in zip(sequences, arrays, strict=True):
                sequence[name] = array.astype("f4")
        names = sorted(set.intersection(*(set(sequence) for sequence in sequences)))
        sequences = [{name: sequence[name] for name in names} for sequence in sequences]
        self.windows = Windows(sequences, [clip.valid for clip in clips], frames)
        self.channels = {name: array.shape[1] for name, array in sequences[0].items()}
        self.statistics = {name: self.windows.statistics(name) for name in names}
        self.changes = {name: _deviation_of_changes([s[name] for s in sequences], clips) for name in names}
        self.parts = [part for part in PARTS if part in names]
        self.fps = clips[0].fps
        self.face_model = clips[0].face_model if "face" in names else ""
        self.build = speaker_build(clips)

    def sample(self, rng, count):
        """`count` random windows, {name: (count, C, frames) float32 tensor on the training device}."""
        batch = self.windows.sample(rng, count)
        return {name: torch.from_numpy(array).to(device()).transpose(1, 2) for name, array in batch.items()}


def _deviation_of_changes(arrays, clips):
    """(C,) over the changes between valid frames of a list of (T, C); 1 for a constant channel."""
    both = [clip.valid[1:] & clip.valid[:-1] for clip in clips]
    changes = [np.diff(array, axis=0)[valid] for array, valid in zip(arrays, both, strict=True)]
    return divisor(moments([np.concatenate(changes)], constant=1e-6)[1])


class MotionNetwork(ZScored):
    """Base of networks that hear z-scored features and answer in metres and radians.

    What a subclass predicts are deviations from the training mean in units of the training deviation, so that outputs
    and losses have units while the layers work on numbers around one.
    """

    def __init__(self, pairs):
        super().__init__(pairs.statistics)
        self.parts = pairs.parts
