"""The k-NN generator of thesis chapter 5, and its motions as the resynchroniser's training input."""

import numpy as np

from cospeech.clip import Motion
from cospeech.errors import CospeechError
from cospeech.matching import controls as controlled
from cospeech.matching.search import Matcher
from cospeech.matching.signals import ControlSignals

BEST_SHARE = 0.5  # of the training fakes that take the best candidate
OTHER_RANKS = (2, 15)  # the rest take one k for all their windows, uniform in this closed range
CHUNK = 4096  # sequences searched before their motions are gathered


class KNN:
    """`knn`: Algorithm 1 as a generator, frames of the database unchanged."""

    def __init__(self, database):
        self.matcher = Matcher(database)
        self.signals = ControlSignals(database)

    def match(
        self, features, *, seed=0, k=1, initial="random", mask=None, exclude_take=None, variant="pose", controls=(),
    ):  # fmt: skip
        """(T, 28) speech features -> `Match`: clip, frame, take and time of every window. Options: `Matcher.search`.

        It starts from the pose of a random frame, as all published runs do. With `controls` (see
        `cospeech.matching.controls.search`) it is a `ControlledMatch`.
        """
        if k > len(self.matcher.database.pose):
            raise CospeechError(
                f"k is {k}, but the database has {len(self.matcher.database.pose)} clips to choose from"
            )
        if not controls:
            return self.matcher.search(features, k, mask, initial, seed, variant, exclude_take)
        if mask is not None:
            raise CospeechError("give either a mask or controls, not both")
        options = {"k": k, "initial": initial, "seed": seed, "variant": variant, "exclude_take": exclude_take}
        return controlled.search(self.matcher, self.signals, features, controls, **options)

    def generate(self, features, *, seed=0, report=None, **options):
        """(T, 28) speech features -> Motion of T frames, with head rotations if the database has them.

        `report` is called with the `Match`, for callers that want to know where the motion is from.
        """
        match = self.match(features, seed=seed, **options)
        if report:
            report(match)
        return motion_of(match)


def motion_of(match):
    """The Motion of a `Match`, for callers that keep both the motion and where it is from."""
    return Motion(match.positions, match.rotation)


def fake_pairs(database, features, takes, starts=None, *, seed=0, variant="pose"):
    """k-NN motions for the training part's own speech, the resynchroniser's input (thesis 5.3.3).

    Each sequence starts at a random pose; half of them take the best candidate, the others one k of 2..15. Nothing is
    taken from the sequence's own take or, if the database has no other, from the sequence's own stretch of it.

    Parameters
    ----------
    features : (n, T, 28) speech features of n sequences.
    takes : n take names. starts : (n,) seconds of the sequences' first frames in their takes; needed for one take only.

    Returns (n, T, 55, 3) float32 metres.
    """
    rng = np.random.default_rng(seed)
    count, frames = features.shape[:2]
    ranks = rng.integers(OTHER_RANKS[0], OTHER_RANKS[1] + 1, size=count)
    ranks[rng.random(count) < BEST_SHARE] = 1
    seeds = rng.integers(2**63, size=count)
    excluded = _exclusions(database, takes, starts, frames / database.fps)
    matcher = Matcher(database)
    motion = np.empty((count, frames, *database.positions.shape[2:]), np.float32)
    for i in range(0, count, CHUNK):
        part = slice(i, i + CHUNK)
        options = {"initial": "random", "seed": seeds[part], "variant": variant, "exclude_take": excluded[part]}
        matches = matcher.search_batch(features[part], ranks[part], **options)
        for j, match in enumerate(matches, start=i):
            motion[j] = match.positions
    return motion


def _exclusions(database, takes, starts, seconds):
    if len(database.takes) > 1:
        return [str(take) for take in takes]
    if starts is None:
        raise CospeechError(
            f"database: its only take is {database.takes[0]!r}; give the sequences' starts to leave them out"
        )
    return [(str(take), start, start + seconds) for take, start in zip(takes, starts, strict=True)]
