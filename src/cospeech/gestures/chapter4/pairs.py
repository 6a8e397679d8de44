"""Speech and motion of the training part, as the chapter 4 networks meet them: windows, channels, statistics."""

import numpy as np
import torch
from torch import nn

from cospeech.gestures.chapter4.vectors import motion_to_vectors
from cospeech.learning.training import device
from cospeech.learning.windows import Windows

PARTS = ("face", "body", "hands")


class Pairs:
    """Windows of `frames` frames of clips: `features` and the vectors of `motion_to_vectors` that every clip has.

    further : {name: list of (T, C), one a clip}, what else belongs to the frames.

    Attributes: windows; channels {name: C}; statistics {name: (mean (C,), deviation (C,))}; changes {name: deviation
    (C,) of the change from frame to frame}; parts, those of `PARTS` that there are; fps; face_model, "" without a face.
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
        self.changes = {name: _deviation_of_changes([s[name] for s in sequences]) for name in names}
        self.parts = [part for part in PARTS if part in names]
        self.fps = clips[0].fps
        self.face_model = clips[0].face_model if "face" in names else ""

    def sample(self, rng, count):
        """`count` random windows, {name: (count, C, frames) float32 tensor on the training device}."""
        batch = self.windows.sample(rng, count)
        return {name: torch.from_numpy(array).to(device()).transpose(1, 2) for name, array in batch.items()}


def _deviation_of_changes(arrays, floor=1e-6):
    """(C,) over all frames of a list of (T, C); deviations under `floor` become 1 (constant channels)."""
    deviation = np.concatenate([np.diff(array, axis=0) for array in arrays]).std(axis=0)
    return np.where(deviation > floor, deviation, 1.0).astype(np.float32)


class MotionNetwork(nn.Module):
    """Base of networks that hear z-scored features and answer in metres and radians.

    What a subclass predicts are deviations from the training mean in units of the training deviation, so that outputs
    and losses have units while the layers work on numbers around one.
    """

    def __init__(self, pairs):
        super().__init__()
        self.parts = pairs.parts
        for name, (mean, deviation) in pairs.statistics.items():
            self.register_buffer(f"{name}_mean", torch.as_tensor(mean)[:, None])
            self.register_buffer(f"{name}_deviation", torch.as_tensor(deviation)[:, None])

    def standardized(self, name, x):
        """(x - mean) / deviation of the training part; x (B, C, T)."""
        return (x - getattr(self, f"{name}_mean")) / getattr(self, f"{name}_deviation")

    def measured(self, name, x):
        """Inverse of `standardized`."""
        return x * getattr(self, f"{name}_deviation") + getattr(self, f"{name}_mean")
