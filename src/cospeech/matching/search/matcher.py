"""Algorithm 1 of the thesis (5.3.1.3): which eight frames of the database come next, given speech and the pose so far.

Exact whatever the way it is called: alone, in batches or streaming, in plain numpy (small jobs) or compiled (large
ones). Distances are decided in float64; ties go to the lower clip, then to the lower frame.
"""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.matching.database.descriptors import POSE_WIDTH, WINDOW, audio_features, shift
from cospeech.matching.search.masks import Masks
from cospeech.matching.search.match import STEP, Match
from cospeech.matching.search.queries import check_options, checked, tell
from cospeech.matching.search.stream import Stream

COMPILED_WORK = 40_000  # clips x windows from which compiled kernels pay for their start of about a second
BATCH = 512  # queries that share one pass over the database
EVER = 1 << 40  # frames; more than any take has
NOTHING = (-1, 0, 0)  # excluded take, from frame, to frame


class Matcher:
    """Searches one `Database`.

    compiled : use the compiled kernels (True), plain numpy (False), or what is quicker. placement : where a window may
    start, see `Database.placed`.
    """

    def __init__(self, database, compiled=None, placement="published"):
        self._given, self.database = database, database.placed(placement)
        self.compiled = compiled
        self._first_frame = np.rint(database.start * database.fps).astype(np.int64)

    def query_features(self, features, frames=None):
        """(T, 28) speech features -> (W, 112) float32, the normalised audio feature at every eighth frame.

        Speech that ends within a feature's 14 frames of look-ahead repeats its last frame. With `frames`, rows past it
        serve as look-ahead only: W = ceil(frames / 8).
        """
        features = checked(features)
        if frames is not None and not 0 < frames <= len(features):
            raise CospeechError(f"speech features: {len(features)} frames, but {frames} are asked")
        at = np.arange(0, len(features) if frames is None else frames, WINDOW)
        return self.database.audio_normalization(audio_features(features)[at])

    def search(
        self,
        features,
        k=1,
        mask=None,
        initial="mean",
        seed=0,
        variant="pose",
        exclude_take=None,
        frames=None,
        placement=None,
    ):
        """Algorithm 1 for one speech: (T, 28) features -> Match of W = ceil(T / 8) windows.

        Parameters
        ----------
        k : take the k-th best candidate at every step, from 1; with fewer candidates the last.
        mask : (M, F) or (W, M, F) bool, frames that may be used (for each window); tested at a window's first and last
            frame, so that motion between them stays free. Where it leaves nothing it is set aside, with a notice.
        initial : pose feature before the first frame: "mean", "random" (a frame that the first window might start at,
            drawn with `seed`), or (96,) normalised as in `Database.pose`.
        variant : "pose" or "audio" pre-selects each clip's best frame by that feature and then adds the ranks by
            both; "pose_only" ignores the speech.
        exclude_take : name of a take not to use (may be unknown), or (name, start, end) for a stretch of it in seconds.
        frames : T, if `features` goes on past the end to be looked ahead to.
        placement : another than the Matcher's own, see `Database.placed`.
        """
        options = {"k": k, "mask": mask, "initial": initial, "seed": seed, "variant": variant, "frames": frames}
        return self.search_batch([features], **options, exclude_take=[exclude_take], placement=placement)[0]

    def search_batch(
        self,
        features,
        k=1,
        mask=None,
        initial="mean",
        seed=0,
        variant="pose",
        exclude_take=None,
        frames=None,
        placement=None,
    ):
        """`search` for a list of speeches at once, to the same indices: -> list of Match.

        k, seed and exclude_take may be lists with one entry per speech, initial (B, 96); mask is shared by all.
        """
        if placement is not None:
            options = {"k": k, "mask": mask, "initial": initial, "seed": seed, "variant": variant, "frames": frames}
            return self.placed(placement).search_batch(features, **options, exclude_take=exclude_take)
        queries = [self.query_features(f, frames) for f in features]
        count, windows = len(queries), np.array([len(q) for q in queries], int)
        ranks = np.broadcast_to(k, count)
        check_options(ranks, variant)
        masks = Masks(self.database, mask, windows.max(initial=0))
        excluded = np.array([self.span(e) for e in _each(exclude_take, count)], np.int64).reshape(count, 3)
        pose = self.initial(initial, np.broadcast_to(seed, count), masks)
        found = np.zeros((windows.max(initial=0), count), STEP)
        step = self.stepper(variant, len(self.database) * windows.sum() > COMPILED_WORK)
        for w in range(len(found)):
            now = np.flatnonzero(windows > w)
            audio = np.stack([queries[i][w] for i in now])
            found[w, now] = step(masks, w, pose[now], audio, ranks[now], excluded[now])
            pose[now] = self.database.pose_after(found["clip"][w, now], found["frame"][w, now])
        tell(found["unmasked"].any(axis=1))
        lengths = [len(f) if frames is None else frames for f in features]
        return [Match.of(self.database, found[: windows[i], i], lengths[i]) for i in range(count)]

    def stream(self, k=1, mask=None, initial="mean", seed=0, variant="pose", exclude_take=None, placement=None):
        """A `Stream` that is fed speech features as they arrive and finds what `search` would find.

        mask : as in `search`, or a function of the window's number that gives its (M, F) bool mask, or None for none.
        """
        matcher = self if placement is None else self.placed(placement)
        return Stream(matcher, k, mask, initial, seed, variant, exclude_take)

    def placed(self, placement):
        """A Matcher of the same database with another placement."""
        return Matcher(self._given, self.compiled, placement)

    def span(self, excluded):
        """exclude_take -> (take index, from frame, to frame)."""
        if excluded is None:
            return NOTHING
        name, start, end = (excluded, None, None) if isinstance(excluded, str) else excluded
        if name not in self.database.takes:
            return NOTHING
        index, fps = self.database.takes.index(name), self.database.fps
        return (index, -EVER, EVER) if start is None else (index, int(np.floor(start * fps)), int(np.ceil(end * fps)))

    def initial(self, initial, seeds, masks):
        """(B, 96) float64 pose features before the first frame."""
        if not isinstance(initial, str):
            pose = np.array(np.broadcast_to(initial, (len(seeds), POSE_WIDTH)), np.float64)
            if not np.isfinite(pose).all():
                raise CospeechError("initial pose: holds NaN or infinity")
            return pose
        if initial == "mean":
            return np.zeros((len(seeds), POSE_WIDTH))
        if initial != "random":
            raise CospeechError(f"initial pose {initial!r} is not known; give mean, random or {POSE_WIDTH} numbers")
        frames = np.flatnonzero(masks.allowed(0))
        frames = frames if len(frames) else np.flatnonzero(self.database.eligible)
        drawn = frames[[np.random.default_rng(seed).integers(len(frames)) for seed in seeds]]
        return self.database.pose[np.unravel_index(drawn, self.database.eligible.shape)].astype(np.float64)

    def stepper(self, variant, large):
        """One step of Algorithm 1 for B queries: (masks, window, pose, audio, k, excluded) -> (B,) of type `STEP`."""
        select = self._select_compiled if (large if self.compiled is None else self.compiled) else self._select

        def step(masks, window, pose, audio, k, excluded):
            queries = pose.astype(np.float64), audio.astype(np.float64)
            chosen = select(masks.allowed(window), variant, queries, k, excluded)
            empty = np.flatnonzero(chosen[:, 0] < 0)
            if len(empty) and masks.restrict:
                left = queries[0][empty], queries[1][empty]
                chosen[empty] = select(self.database.eligible, variant, left, k[empty], excluded[empty])
            if (chosen[:, 0] < 0).any():
                raise CospeechError("database: nothing is left to match when the excluded take is left out")
            return self._described(chosen, queries, empty)

        return step

    def _described(self, chosen, queries, unmasked):
        """(B, 4) clip, frame, pose rank, audio rank -> (B,) of type `STEP`."""
        found = np.zeros(len(chosen), STEP)
        found["clip"], found["frame"], found["pose_rank"], found["audio_rank"] = chosen.T
        found["unmasked"][unmasked] = True
        pose = self.database.pose[chosen[:, 0], chosen[:, 1] - self.database.match_offset]
        audio = self.database.audio[chosen[:, 0], chosen[:, 1]]
        found["pose_distance"] = np.sqrt(exact_keys(pose, queries[0], False))
        lengths = np.linalg.norm(queries[1], axis=1)
        nearness = -exact_keys(audio, queries[1], True)
        found["audio_distance"] = 1 - np.divide(nearness, lengths, out=np.zeros(len(pose)), where=lengths > 0)
        return found

    def _compared(self, variant):
        """(first rows, second rows, shift, angular) as in `kernels`; how far before a window the first feature is."""
        database = self.database
        if variant == "audio":
            return (database.audio, database.pose, -database.match_offset, True), 0
        return (database.pose, database.audio, database.match_offset, False), database.match_offset

    def _select(self, allowed, variant, queries, k, excluded):
        """Plain numpy: every allowed frame in float64. (B, 4): clip or -1, first frame, pose rank, audio rank."""
        (rows, others, _, angular), before = self._compared(variant)
        after = self.database.match_offset - before
        first, second = reversed(queries) if angular else queries
        found = np.zeros((len(k), 4), np.int64)
        for b, span in enumerate(excluded):
            clip, frame = np.nonzero(allowed & ~self._touched(span))
            if not len(clip):
                found[b] = -1, 0, 0, 0
                continue
            keys = exact_keys(rows[clip, frame - before], first[b], angular)
            order = np.lexsort((frame, keys, clip))  # each clip's best frame first, the lower one of equals
            best = order[np.unique(clip[order], return_index=True)[1]]
            clip, frame, one = clip[best], frame[best], _ranks(keys[best])
            two = np.zeros_like(one)
            if variant != "pose_only":
                two = _ranks(exact_keys(others[clip, frame - after], second[b], not angular))
            chosen = np.argsort(one + two, kind="stable")[min(k[b], len(clip)) - 1]
            found[b] = clip[chosen], frame[chosen], one[chosen], two[chosen]
        return found[:, [0, 1, 3, 2]] if angular else found

    def _touched(self, span):
        """(M, F) bool: where a window would touch the excluded (take, from, to) frames."""
        take, begin, end = span
        at = self._first_frame[:, None] + np.arange(self.database.clip_frames)
        return (self.database.take[:, None] == take) & (at < end) & (at + WINDOW > begin)

    def _select_compiled(self, allowed, variant, queries, k, excluded):
        """The same through `kernels`."""
        from cospeech.matching.search import kernels
        from cospeech.matching.search.compact import Index

        rows, before = self._compared(variant)
        angular = rows[-1]
        pair = tuple(reversed(queries)) if angular else queries
        where = shift(allowed, before) if before else allowed, self.database.take, self._first_frame + before
        found = np.zeros((len(k), 4), np.int64)
        for i in range(0, len(k), BATCH):
            part = slice(i, i + BATCH)
            asked = excluded[part], tuple(q[part] for q in pair), k[part].astype(np.int64)
            alone = len(asked[-1]) <= kernels.FEW and not angular
            index = Index.of(self.database).ask(len(asked[-1])) if alone else Index.none(rows[0])
            found[part] = kernels.select(rows, index, variant, *where, *asked)
        found[:, 1] += before
        return found[:, [0, 1, 3, 2]] if angular else found


def exact_keys(rows, q, angular):
    """What orders candidates: rows (n, D) float32, q (D,) float64 -> (n,) float64.

    Squared Euclidean distance or, `angular`, minus the cosine similarity times |q| (0 for a row of zeros).
    """
    rows = rows.astype(np.float64)
    if not angular:
        rows -= q
        return (rows * rows).sum(axis=1)
    lengths = np.sqrt((rows * rows).sum(axis=1))
    return np.divide(-(rows * q).sum(axis=1), lengths, out=np.zeros(len(rows)), where=lengths > 0)


def _ranks(keys):
    ranks = np.empty(len(keys), np.int64)
    ranks[np.argsort(keys, kind="stable")] = np.arange(len(keys))
    return ranks


def _each(value, count):
    """One entry per query: a list as it is, anything else repeated."""
    return value if isinstance(value, list) else [value] * count
