"""The k-NN generator of thesis chapter 5."""

from cospeech.clip import Motion
from cospeech.errors import CospeechError
from cospeech.matching.control.controlled import search
from cospeech.matching.control.keywords import Gestures, read_gestures
from cospeech.matching.control.signals import ControlSignals
from cospeech.matching.search.matcher import Matcher
from cospeech.matching.search.seams import check_seams, smoothed
from cospeech.matching.trace import trace_of


class KNN:
    """`knn`: Algorithm 1 as a generator, frames of the database unchanged unless `seams` are smoothed."""

    def __init__(self, database):
        self.matcher = Matcher(database)
        self.signals = ControlSignals(database)

    def match(
        self, features, *, seed=0, k=1, initial="random", mask=None, exclude_take=None, variant="pose", controls=(),
        words=None, gestures=None, placement="published",
    ):  # fmt: skip
        """(T, 28) speech features -> `Match`: clip, frame, take and time of every window. Options: `Matcher.search`.

        It starts from the pose of a random frame, as all published runs do. With `controls` (see
        `matching.control.controlled.search`) it is a `ControlledMatch`; those that name a keyword need the `Words` of
        the speech, and may use `gestures`, a file of the user's own (see `read_gestures`).
        """
        database = self.matcher.database
        if k > len(database.pose):
            raise CospeechError(f"k is {k}, but the database has {len(database.pose)} clips to choose from")
        options = {"k": k, "initial": initial, "seed": seed, "variant": variant, "exclude_take": exclude_take}
        matcher = self.matcher if placement == "published" else self.matcher.placed(placement)
        if not controls:
            return matcher.search(features, mask=mask, **options)
        if mask is not None:
            raise CospeechError("give either a mask or controls, not both")
        called = Gestures(database, read_gestures(gestures, database) if gestures else None)
        return search(matcher, self.signals, features, controls, called, words, **options)

    def generate(self, features, *, seed=0, report=None, seams="off", **options):
        """(T, 28) speech features -> Motion of T frames, with head rotations if the database has them, and its Trace.

        `seams` : what happens where one window follows another, see `cospeech.matching.search.seams.smoothed`; "off" is
        Algorithm 1. `report` is called with the `Match`, for callers that want to know where the motion is from.
        """
        seams = seams or "off"  # YAML reads a bare off as false
        check_seams(seams)
        match = self.match(features, seed=seed, **options)
        if report:
            report(match)
        return motion_of(match, seams, k=options.get("k", 1), seed=seed)


def motion_of(match, seams="off", **settings):
    """The Motion of a `Match`, for callers that keep both the motion and where it is from."""
    positions, rotation = smoothed(match, seams)
    return Motion(positions, rotation, trace=trace_of(match, seams=seams, **settings))
