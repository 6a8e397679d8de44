"""Which takes and windows are good to learn from: HA2G's filters, each counted (its released data scripts).

Those of its filters that need the film (people in the picture, shoulder width in pixels, facing away or sideways) are
of capture, which knows the film; a clip's axes are the speaker's own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cospeech.body.anatomy import UP
from cospeech.gestures.ha2g.dataset.bones import PLACES, positions_from_vectors
from cospeech.skeleton import UPPER55


@dataclass(frozen=True)
class Filters:
    """The released thresholds.

    frames : a take's least length, 5 s at 15 Hz. visible : least share of joints that were seen (confidence over
    `seen`). words : that must begin in a window, in takes that have words. difference : a window's least mean distance
    from the mean pose. spine_most, spine_mean : degrees between spine and vertical, of a window. wrist : least variance
    of one wrist's position in a window. Distances are those of a figure with the released bone lengths, metres.
    """

    frames: int = 75
    visible: float = 0.5
    seen: float = 0.3
    words: int = 2
    difference: float = 0.02
    spine_most: float = 30.0
    spine_mean: float = 20.0
    wrist: float = 0.0014

    def refuse_take(self, clip, table):
        """Why a take is of no use, "short" or "unseen", or None."""
        if clip.frames < self.frames:
            return "short"
        joints = [PLACES[place] for place in table.places if place in UPPER55.index]
        return "unseen" if np.mean(clip.confidence[:, joints] > self.seen) < self.visible else None

    def windows(self, starts, frames, valid, words, vectors, table, mean_pose):
        """Which windows of a take are kept, and how many each filter dropped.

        starts (N,) first frames; valid (T,) bool; words (T,) numbers; vectors (T, V, 3); mean_pose (J, 3) joints of
        the mean pose, see `mean_pose`. A window is counted under the first filter that it fails. Returns
        (kept (N,) bool, {filter name: dropped}).
        """
        over = lambda per_frame: sliding_window_view(per_frame, frames, axis=0)[starts]
        joints = positions_from_vectors(vectors, table.lengths, table)
        spine = np.degrees(np.arccos(np.clip(vectors[:, 0] @ UP, -1, 1)))
        wrists = [table.joints.index(name) for name in ("left_wrist", "right_wrist")]
        moved = over(joints[:, wrists]).var(axis=-1).sum(axis=-1)
        checks = {
            "invalid": over(valid).all(axis=-1),
            "few words": (over(words) > 0).sum(axis=-1) >= (self.words if words.any() else 0),
            "mean pose": over(np.abs(joints - mean_pose).mean(axis=(1, 2))).mean(axis=-1) >= self.difference,
            "bent spine": (over(spine).max(axis=-1) <= self.spine_most)
            & (over(spine).mean(axis=-1) <= self.spine_mean),
            "still wrists": (moved >= self.wrist).any(axis=-1),
        }
        kept, dropped = np.ones(len(starts), bool), {}
        for name, passed in checks.items():
            dropped[name] = int(np.sum(kept & ~passed))
            kept &= passed
        return kept, dropped


def mean_pose(vectors, table):
    """(F, V, 3) -> (J, 3): the mean of all poses, with the released bone lengths."""
    return positions_from_vectors(vectors, table.lengths, table).mean(axis=0)
