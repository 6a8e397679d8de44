"""Algorithm 1 of the thesis (5.3.1.3): which eight frames of the database come next, given speech and the pose so far.

Exact whatever the way it is called: alone, in batches or streaming, in plain numpy (small jobs) or compiled (large
ones). Distances are decided in float64; ties go to the lower clip, then to the lower frame.
"""

from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cospeech.clip import FEATURES
from cospeech.errors import CospeechError, notice
from cospeech.matching.database import Database
from cospeech.matching.features import POSE_WIDTH, WINDOW, audio_features

VARIANTS = ("pose", "audio", "pose_only")
COMPILED_WORK = 40_000  # clips x windows from which compiled kernels pay for their start of about a second
BATCH = 256  # queries that share one pass over the database
EVER = 1 << 40  # frames; more than any take has
NOTHING = (-1, 0, 0)  # excluded take, from frame, to frame


@dataclass(frozen=True)
class Match:
    """What was found for W windows of 8 frames.

    clip, frame (W,) : where in the database each window starts.
    pose_rank, audio_rank (W,) : its 0-based ranks among the candidates; zeros where a variant does not use one.
    unmasked (W,) bool : the mask left no candidate here, so it was set aside for this window.
    frames : T, length of the speech; the last window is cut to it.
    """

    database: Database
    clip: np.ndarray
    frame: np.ndarray
    pose_rank: np.ndarray
    audio_rank: np.ndarray
    unmasked: np.ndarray
    frames: int

    @cached_property
    def positions(self):
        """(T, 55, 3) float32 metres, pelvis-relative: the matched windows one after the other, nothing changed."""
        return self.database.gestures(self.clip, self.frame)[: self.frames]

    @cached_property
    def rotation(self):
        """(T, 3) head rotation of the matched frames, or None."""
        if self.database.rotation is None:
            return None
        return self.database.gestures(self.clip, self.frame, "rotation")[: self.frames]

    @property
    def take(self):
        """(W,) names of the takes that the windows are from."""
        return np.array(self.database.takes, dtype=object)[self.database.take[self.clip]]

    @property
    def time(self):
        """(W,) seconds in these takes."""
        return self.database.time(self.clip, self.frame)


class Matcher:
    """Searches one `Database`. `compiled`: use the compiled kernels (True), plain numpy (False), or what is quicker."""

    def __init__(self, database, compiled=None):
        self.database = database
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
        self, features, k=1, mask=None, initial="mean", seed=0, variant="pose", exclude_take=None, frames=None
    ):  # fmt: skip
        """Gestures for one speech: (T, 28) features -> Match of W = ceil(T / 8) windows.

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
        """
        options = {"k": k, "mask": mask, "initial": initial, "seed": seed, "variant": variant, "frames": frames}
        return self.search_batch([features], **options, exclude_take=[exclude_take])[0]

    def search_batch(
        self, features, k=1, mask=None, initial="mean", seed=0, variant="pose", exclude_take=None, frames=None
    ):  # fmt: skip
        """`search` for a list of speeches at once, to the same indices: -> list of Match.

        k, seed and exclude_take may be lists with one entry per speech, initial (B, 96); mask is shared by all.
        """
        queries = [self.query_features(f, frames) for f in features]
        count, windows = len(queries), np.array([len(q) for q in queries], int)
        ranks = np.broadcast_to(k, count)
        check_options(ranks, variant)
        masks = Masks(self.database, mask, windows.max(initial=0))
        excluded = np.array([self.span(e) for e in _each(exclude_take, count)], np.int64).reshape(count, 3)
        pose = self.initial(initial, np.broadcast_to(seed, count), masks)
        found = np.zeros((windows.max(initial=0), count, 5), np.int64)
        step = self.stepper(variant, len(self.database) * windows.sum() > COMPILED_WORK)
        for w in range(len(found)):
            now = np.flatnonzero(windows > w)
            audio = np.stack([queries[i][w] for i in now])
            found[w, now] = step(masks, w, pose[now], audio, ranks[now], excluded[now])
            pose[now] = self.database.pose[found[w, now, 0], found[w, now, 1] + WINDOW - 1]
        tell(found[..., 4].any(axis=1))
        lengths = [len(f) if frames is None else frames for f in features]
        return [self.collect(found[: windows[i], i], lengths[i]) for i in range(count)]

    def stream(self, k=1, mask=None, initial="mean", seed=0, variant="pose", exclude_take=None):
        """A `Stream` that is fed speech features as they arrive and finds what `search` would find."""
        from cospeech.matching.stream import Stream

        return Stream(self, k, mask, initial, seed, variant, exclude_take)

    def collect(self, found, frames):
        """(W, 5) rows of the steps taken -> Match of a speech of `frames` frames."""
        clip, frame, pose_rank, audio_rank, unmasked = found.T
        return Match(self.database, clip, frame, pose_rank, audio_rank, unmasked.astype(bool), frames)

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
        frames = np.flatnonzero(masks.allowed(0) if len(masks) else self.database.eligible)
        frames = frames if len(frames) else np.flatnonzero(self.database.eligible)
        drawn = frames[[np.random.default_rng(seed).integers(len(frames)) for seed in seeds]]
        return self.database.pose[np.unravel_index(drawn, self.database.eligible.shape)].astype(np.float64)

    def stepper(self, variant, large):
        """One step of Algorithm 1 for B queries: (masks, window, pose, audio, k, excluded) -> (B, 5) for `Match`."""
        select = self._select_compiled if (large if self.compiled is None else self.compiled) else self._select

        def step(masks, window, pose, audio, k, excluded):
            queries = pose.astype(np.float64), audio.astype(np.float64)
            found = np.zeros((len(pose), 5), np.int64)
            found[:, :4] = select(masks.allowed(window), variant, queries, k, excluded)
            empty = np.flatnonzero(found[:, 0] < 0)
            if len(empty) and masks.restrict:
                queries = queries[0][empty], queries[1][empty]
                found[empty, :4] = select(self.database.eligible, variant, queries, k[empty], excluded[empty])
                found[empty, 4] = 1
            if (found[:, 0] < 0).any():
                raise CospeechError("database: nothing is left to match when the excluded take is left out")
            return found

        return step

    def _rows(self, variant, queries):
        """(rows, query) of the feature that pre-selects, then of the other; whether the first is audio."""
        pair = (self.database.pose, queries[0]), (self.database.audio, queries[1])
        return (*pair[1], *pair[0], True) if variant == "audio" else (*pair[0], *pair[1], False)

    def _select(self, allowed, variant, queries, k, excluded):
        """Plain numpy: every allowed frame in float64. (B, 4): clip or -1, frame, pose rank, audio rank."""
        rows, q, other_rows, r, angular = self._rows(variant, queries)
        found = np.zeros((len(q), 4), np.int64)
        for b, (take, begin, end) in enumerate(excluded):
            at = self._first_frame[:, None] + np.arange(allowed.shape[1])
            near = (self.database.take[:, None] == take) & (at < end) & (at + WINDOW > begin)
            clip, frame = np.nonzero(allowed & ~near)
            if not len(clip):
                found[b] = -1, 0, 0, 0
                continue
            keys = exact_keys(rows[clip, frame], q[b], angular)
            order = np.lexsort((frame, keys, clip))  # each clip's best frame first, the lower one of equals
            best = order[np.unique(clip[order], return_index=True)[1]]
            clip, frame, one = clip[best], frame[best], _ranks(keys[best])
            two = np.zeros_like(one)
            if variant != "pose_only":
                two = _ranks(exact_keys(other_rows[clip, frame], r[b], not angular))
            chosen = np.argsort(one + two, kind="stable")[min(k[b], len(clip)) - 1]
            found[b] = clip[chosen], frame[chosen], one[chosen], two[chosen]
        return found[:, [0, 1, 3, 2]] if angular else found

    def _select_compiled(self, allowed, variant, queries, k, excluded):
        """The same through `kernels`."""
        from cospeech.matching import kernels

        rows, q, other_rows, r, angular = self._rows(variant, queries)
        shared = rows, other_rows, angular, allowed, self.database.take, self._first_frame
        found = np.zeros((len(q), 4), np.int64)
        with _single_threaded_blas() if len(q) > 1 else nullcontext():
            for i in range(0, len(q), BATCH):
                part = slice(i, i + BATCH)
                frame, picked = kernels.select(
                    *shared, excluded[part], q[part], r[part], k[part].astype(np.int64), variant == "pose_only"
                )
                found[part] = np.column_stack([picked[:, 0], frame, picked[:, 1:]])
        return found[:, [0, 1, 3, 2]] if angular else found


class Masks:
    """The frames at which a window may start, window by window: eligible, and in the mask with its first and last."""

    def __init__(self, database, mask, windows):
        self.database, self.restrict = database, mask is not None
        self._mask = self._one = None
        if not self.restrict:
            self._one = database.eligible
            return
        self._mask = np.asarray(mask)
        expected = database.eligible.shape
        right = self._mask.shape[-2:] == expected and self._mask.ndim in (2, 3)
        if right and windows is not None and self._mask.ndim == 3:
            right = len(self._mask) == windows
        if not right or self._mask.dtype != bool:
            raise CospeechError(
                f"mask: {self._mask.dtype} of shape {self._mask.shape}, expected bool of shape {expected} or "
                f"{('windows' if windows is None else int(windows), *expected)}"
            )
        if self._mask.ndim == 2:
            self._one = self._both_ends(self._mask)

    def __len__(self):
        return 1 if self._one is not None else len(self._mask)

    def allowed(self, window):
        """(M, F) bool for the given window."""
        if self._one is not None:
            return self._one
        if window >= len(self._mask):
            raise CospeechError(f"mask: made for {len(self._mask)} windows, but the speech goes on")
        return self._both_ends(self._mask[window])

    def _both_ends(self, mask):
        allowed = self.database.eligible & mask
        allowed[:, : 1 - WINDOW] &= mask[:, WINDOW - 1 :]
        return allowed


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


def checked(features, empty=False):
    """The speech features as an array; CospeechError unless they are finite and (T, 28)."""
    features = np.asarray(features)
    if features.ndim != 2 or features.shape[1] != FEATURES or not (empty or len(features)):
        raise CospeechError(f"speech features: shape {features.shape}, expected (frames, {FEATURES})")
    if not np.isfinite(features).all():
        frame = int(np.argwhere(~np.isfinite(features))[0][0])
        raise CospeechError(f"speech features: NaN or infinity, first in frame {frame}")
    return features


def check_options(k, variant):
    """CospeechError unless every k (an array) counts from 1 and the variant is one of `VARIANTS`."""
    if (k < 1).any():
        raise CospeechError(f"k is {k.min()}, but candidates are counted from 1, the best")
    if variant not in VARIANTS:
        raise CospeechError(f"variant {variant!r} is not known; known: {', '.join(VARIANTS)}")


def _each(value, count):
    """One entry per query: a list as it is, anything else repeated."""
    return value if isinstance(value, list) else [value] * count


def tell(unmasked, first=0):
    """Notice of the windows, counted from `first`, for which the mask was set aside."""
    windows = np.flatnonzero(unmasked) + first
    if len(windows):
        shown = ", ".join(map(str, windows[:8])) + (", ..." if len(windows) > 8 else "")
        notice(f"mask: it leaves nothing to match in window {shown}; set aside there")


def _single_threaded_blas():
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1, user_api="blas")
