"""What of a body keeps its size and shape, whatever the motion: bones, and palms as wholes."""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError
from cospeech.rotation import rotations_between
from cospeech.skeleton import BASES, CHAINS, FINGER_JOINTS, HAND_ROOTS, bone_lengths, with_bone_lengths


@dataclass(frozen=True)
class Build:
    """What of a body keeps its size and shape: the speaker's, whatever the motion.

    bone_lengths (55,) metres. palms (2, 5, 3) metres: where the bases of the right and the left hand's fingers lie from
    the hand root, in the palm's own axes (towards the middle finger, across, out of the palm), which do not matter.
    """

    bone_lengths: np.ndarray
    palms: np.ndarray

    @classmethod
    def measure(cls, positions):
        """Medians over the frames of a motion (T, 55, 3)."""
        offsets = positions[:, BASES] - positions[:, HAND_ROOTS, None]
        axes = _palm_axes(offsets)
        return cls(bone_lengths(positions), np.median(np.einsum("thab,thpb->thpa", axes, offsets), axis=0))

    @classmethod
    def median(cls, builds):
        """Of several builds, number by number, in float32."""
        lengths, palms = zip(*((build.bone_lengths, build.palms) for build in builds), strict=True)
        return cls(np.median(lengths, axis=0).astype(np.float32), np.median(palms, axis=0).astype(np.float32))

    @classmethod
    def of(cls, description):
        """From what `lists` made, among other entries of a network's description; CospeechError where that is older."""
        if "palms" not in description:
            raise CospeechError(
                f"{description.get('model')}: its file does not know the speaker's build; train it again"
            )
        return cls(*(np.array(description[name], np.float32) for name in ("bone_lengths", "palms")))

    def lists(self):
        """As JSON-able lists by name."""
        return {"bone_lengths": self.bone_lengths.tolist(), "palms": self.palms.tolist()}

    def restored(self, positions):
        """Motion (T, 55, 3) of this build: bones keep their direction, palms turn as wholes, hand roots are wrists."""
        whole = with_bone_lengths(positions, self.bone_lengths)
        offsets = whole[:, BASES] - whole[:, HAND_ROOTS, None]
        norms = np.linalg.norm(self.palms, axis=-1, keepdims=True)
        shape = self.palms * (self.bone_lengths[BASES][..., None] / np.where(norms > 1e-9, norms, 1.0))
        moved = np.einsum("thab,hpb->thpa", rotations_between(shape, offsets), shape) - offsets
        for finger in range(FINGER_JOINTS):
            whole[:, CHAINS[..., finger]] += moved
        return whole


def _palm_axes(offsets):
    """(..., 3, 3) whose rows are the palm's axes, from its bases (..., 5, 3) in the order of `FINGERS`."""
    index, along, little = (offsets[..., i, :] for i in range(3))
    out = np.cross(along, index - little)
    rows = np.stack([along, np.cross(out, along), out], axis=-2)
    norms = np.linalg.norm(rows, axis=-1, keepdims=True)
    return np.divide(rows, norms, out=np.zeros_like(rows), where=norms > 1e-12)
