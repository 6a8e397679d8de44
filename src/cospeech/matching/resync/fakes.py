"""k-NN motion for the training part's own speech: what the resynchroniser learns to refine (thesis 5.3.3)."""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError
from cospeech.matching.database.descriptors import WINDOW
from cospeech.matching.database.motion_database import Database
from cospeech.matching.search.matcher import Matcher

BEST_SHARE = 0.5  # of the sequences that take the best candidate
OTHER_RANKS = (2, 15)  # the rest take one k for all their windows, uniform in this closed range
CHUNK = 4096  # sequences that are searched at once


@dataclass(frozen=True)
class FakePairs:
    """The motions of n sequences of T frames, kept as places in the database: clip, frame (n, W) int32.

    Indexed like an array (n, T, 55, 3) by an int, a slice or an array; only what is asked for is gathered. The
    published training part would fill 5 GB.
    """

    database: Database
    clip: np.ndarray
    frame: np.ndarray
    frames: int

    def __len__(self):
        return len(self.clip)

    @property
    def shape(self):
        """(n, T, 55, 3)."""
        return len(self), self.frames, *self.database.positions.shape[2:]

    def __getitem__(self, which):
        """(T, 55, 3) or (b, T, 55, 3) float32 metres."""
        motion = self.database.gestures(self.clip[which], self.frame[which])
        return motion[..., : self.frames, :, :]


def fake_pairs(database, features, takes, starts=None, *, seed=0, variant="pose", placement="published"):
    """k-NN motions for speech of the training part -> FakePairs.

    Each sequence starts at a random pose; half of them take the best candidate, the others one k of 2..15. Nothing is
    taken from the sequence's own take or, if the database has no other, from the sequence's own stretch of it.

    Parameters
    ----------
    features : (n, T, 28) speech features of n sequences.
    takes : n take names. starts : (n,) seconds of the sequences' first frames in their takes; needed for one take only.
    placement : where windows may start, see `Database.placed`.
    """
    rng = np.random.default_rng(seed)
    count, frames = features.shape[:2]
    ranks = rng.integers(OTHER_RANKS[0], OTHER_RANKS[1] + 1, size=count)
    ranks[rng.random(count) < BEST_SHARE] = 1
    seeds = rng.integers(2**63, size=count)
    excluded = _exclusions(database, takes, starts, frames / database.fps)
    matcher = Matcher(database, placement=placement)
    clip, frame = np.empty((2, count, -(-frames // WINDOW)), np.int32)
    for i in range(0, count, CHUNK):
        part = slice(i, i + CHUNK)
        options = {"initial": "random", "seed": seeds[part], "variant": variant, "exclude_take": excluded[part]}
        for j, match in enumerate(matcher.search_batch(features[part], ranks[part], **options), start=i):
            clip[j], frame[j] = match.clip, match.frame
    return FakePairs(database, clip, frame, frames)


def _exclusions(database, takes, starts, seconds):
    if len(database.takes) > 1:
        return [str(take) for take in takes]
    if starts is None:
        raise CospeechError(
            f"database: its only take is {database.takes[0]!r}; give the sequences' starts to leave them out"
        )
    return [(str(take), start, start + seconds) for take, start in zip(takes, starts, strict=True)]
