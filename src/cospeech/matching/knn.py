"""The k-NN generator of thesis chapter 5."""

from pathlib import Path

from cospeech.clip import Motion
from cospeech.errors import CospeechError, notice
from cospeech.gestures.generator import Speech
from cospeech.matching.control.controlled import search
from cospeech.matching.control.keywords import Gestures, read_gestures
from cospeech.matching.control.signals import ControlSignals
from cospeech.matching.database.motion_database import Database
from cospeech.matching.search.matcher import Matcher
from cospeech.matching.search.seams import check_seams, smoothed
from cospeech.matching.trace import trace_of

# What looks best, and the default of `knn` and `resync`: windows go on from the frame after the one that resembles the
# last one shown, which else would be shown twice, and seams are transitions. Without these: Algorithm 1 as published.
DEFAULTS = {"placement": "any_frame_continued", "seams": "inertialize"}
AUDIO_RANKS = ("plain", "learned")
RANK = Path("models", "audio_rank", "weights.safetensors")  # of the learned one, under a subject's folder


class KNN:
    """Algorithm 1 as a generator, frames of the database unchanged unless `seams` are smoothed.

    placement, seams : what `match` and `generate` do unless they are told otherwise.
    """

    def __init__(self, database, placement="published", seams="off"):
        self.matcher, self.placement, self.seams = Matcher(database), placement, seams
        self.signals = ControlSignals(database)

    @classmethod
    def load(cls, name, folder, threads=None, audio_rank=None):
        """Of the subject whose results lie in `folder`, set to look best.

        audio_rank : how speech is compared: "plain" as published, "learned" with motion, by the networks of
            `cospeech.matching.search.similarity`. None is learned, or plain with a notice where these are not trained.
        """
        del name, threads
        return cls(database_of(folder, audio_rank), **DEFAULTS)

    def match(
        self,
        features,
        *,
        seed=0,
        k=1,
        initial="random",
        mask=None,
        exclude_take=None,
        variant="pose",
        controls=(),
        words=None,
        gestures=None,
        placement=None,
    ):
        """(T, 28) speech features -> `Match`: clip, frame, take and time of every window. Options: `Matcher.search`.

        It starts from the pose of a random frame, as all published runs do. With `controls` (see
        `matching.control.controlled.search`) it is a `ControlledMatch`; those that name a keyword need the `Words` of
        the speech, and may use `gestures`, a file of the user's own (see `read_gestures`).
        """
        database = self.matcher.database
        if k > len(database.pose):
            raise CospeechError(f"k is {k}, but the database has {len(database.pose)} clips to choose from")
        options = {"k": k, "initial": initial, "seed": seed, "variant": variant, "exclude_take": exclude_take}
        placement = placement or self.placement
        matcher = self.matcher if placement == "published" else self.matcher.placed(placement)
        if not controls:
            return matcher.search(features, mask=mask, **options)
        if mask is not None:
            raise CospeechError("give either a mask or controls, not both")
        called = Gestures(database, read_gestures(gestures, database) if gestures else None)
        return search(matcher, self.signals, features, controls, called, words, **options)

    def generate(self, speech, *, seed=0, report=None, seams=None, **options):
        """Speech -> Motion of T frames, with head rotations if the database has them, and its Trace.

        `seams` : what happens where one window follows another, see `cospeech.matching.search.seams.smoothed`; "off" is
        Algorithm 1, whose frames are the speaker's own to the bit. `report` is called with the `Match`, for callers
        that want to know where the motion is from.
        """
        seams = self.seams if seams is None else seams or "off"  # YAML reads a bare off as false
        check_seams(seams)
        speech = Speech.of(speech)
        match = self.match(speech.features, seed=seed, **{"words": speech.words} | options)
        if report:
            report(match)
        return motion_of(match, seams, k=options.get("k", 1), seed=seed)


class PublishedKNN(KNN):
    """`knn_published`: Algorithm 1 as the thesis has it, window after window of the speaker's own frames."""

    @classmethod
    def load(cls, name, folder, threads=None, audio_rank="plain"):
        """Of the subject whose results lie in `folder`."""
        del name, threads
        return cls(database_of(folder, audio_rank or "plain"))


def database_of(folder, audio_rank=None):
    """The Database of the subject whose results lie in `folder`, as `audio_rank` (see `KNN.load`) compares speech."""
    from cospeech.matching.search.similarity import Similarity

    folder = Path(folder)
    if audio_rank not in (None, *AUDIO_RANKS):
        raise CospeechError(f"audio rank {audio_rank!r} is not known; known: {', '.join(AUDIO_RANKS)}")
    if audio_rank is None:
        audio_rank = "learned" if (folder / RANK).is_file() else "plain"
        if audio_rank == "plain":
            notice(f"{folder / RANK}: not trained yet; matches are ranked by sound alone")
    database = Database.load(folder / "database.h5")
    return Similarity.load(folder / RANK).applied(database) if audio_rank == "learned" else database


def motion_of(match, seams="off", **settings):
    """The Motion of a `Match`, for callers that keep both the motion and where it is from."""
    positions, rotation = smoothed(match, seams)
    build = None if seams == "off" else match.database.build
    return Motion(positions, rotation, trace=trace_of(match, seams=seams, **settings), build=build)
