"""Algorithm 1 under controls: masks that change along the speech, and gestures called by words in between."""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property, reduce
from itertools import combinations, pairwise

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.matching.control.controls import Control, Wanted
from cospeech.matching.control.keywords import Gesture, Keyword
from cospeech.matching.control.steps import steps_kept, tested
from cospeech.matching.database.descriptors import POSE_WIDTH, WINDOW
from cospeech.matching.search.match import STEP, Match
from cospeech.matching.search.matcher import COMPILED_WORK, Matcher
from cospeech.matching.search.queries import checked

WIDENED = (75, 60)  # what a bound gives way to, in turn, when no window of the database is left; then it is set aside
OFF = "off"


@dataclass(frozen=True)
class Inserted:
    """A keyword's gesture in a motion: its frames from `offset` on, in the windows `first` to `end`."""

    gesture: Gesture
    first: int
    end: int
    offset: int

    def put(self, name, whole):
        """Its own frames (`name` positions or rotation) in place of those of (T, ...)."""
        if (own := getattr(self.gesture, name)) is not None:
            frames = slice(self.first * WINDOW, min(self.end * WINDOW, len(whole)))
            whole[frames] = own[self.offset : self.offset + frames.stop - frames.start]


@dataclass(frozen=True)
class ControlledMatch(Match):
    """A `Match` under controls; `unmasked` tells where they were set aside.

    controls (W,) : tuples of the texts that each window follows. candidates (W,) : clips with a window that fits.
    widened (W,) : "" as asked, "percentile 75", "percentile 60" or "off", what it took to find any; "step ..." if only
        the step into the window was widened (see `cospeech.matching.control.steps`).
    inserted : gestures that keywords called for. In their windows candidates are gestures, ranks and distances -1; clip
        and frame too, where the gesture is a user's own.
    """

    controls: np.ndarray
    candidates: np.ndarray
    widened: np.ndarray
    inserted: tuple = field(default=(), kw_only=True)

    @cached_property
    def positions(self):
        """(T, 55, 3) float32 metres, as in `Match`, with the keywords' gestures."""
        return self._assembled("positions")

    @cached_property
    def rotation(self):
        """(T, 3) head rotation, or None."""
        return None if self.database.rotation is None else self._assembled("rotation")

    def _assembled(self, name):
        whole = self.database.gestures(np.maximum(self.clip, 0), np.maximum(self.frame, 0), name)[: self.frames]
        for one in self.inserted:
            one.put(name, whole)
        return whole

    @property
    def take(self):
        """(W,) names of the takes that the windows are from."""
        names = super().take
        for one in self.inserted:
            names[one.first : one.end] = one.gesture.take
        return names

    @property
    def time(self):
        """(W,) seconds in these takes."""
        times = super().time
        for one in self.inserted:
            frames = one.offset + np.arange(one.end - one.first) * WINDOW
            times[one.first : one.end] = one.gesture.start + frames / self.database.fps
        return times


def search(
    matcher, signals, features, controls, gestures=None, words=None, *, initial="mean", exclude_take=None, **options
):
    """`Matcher.search` under controls: -> ControlledMatch.

    controls : list of `Control`, text or mapping (see `Control.of`), and of `Keyword` or its mapping; in each window
        all that hold there, together, but where a keyword is spoken only its gesture.
    gestures, words : `Gestures` and the speech's `Words`, for keywords. Other parameters as in `Matcher.search`.

    Only one (M, F) mask per different set of controls is kept, however long the speech: stretches of windows that
    follow the same controls are searched in turn, each in a database in which only the allowed windows are eligible,
    and each from the pose that the one before ended with.
    """
    keywords, controls = sorted_out(controls)
    walk = _Walk(matcher, signals, checked(features), controls, initial, exclude_take, options)
    calls = _calls(keywords, words, len(features), matcher.database.fps)
    for (at, keyword), after in pairwise([*calls, None]):
        walk.perform(keyword, gestures[keyword.gesture], at, after[0] // WINDOW if after else len(walk.held))
    walk.until(len(walk.held))
    return walk.match()


def sorted_out(controls):
    """Controls as they are given -> (list of `Keyword`, list of `Control`)."""
    called = [isinstance(c, Keyword) or (isinstance(c, dict) and "keyword" in c) for c in controls]
    keywords = [c if isinstance(c, Keyword) else Keyword.of(c) for c, k in zip(controls, called, strict=True) if k]
    for one, other in combinations(keywords, 2):
        if one.word.casefold() == other.word.casefold() and one.gesture != other.gesture:
            raise CospeechError(f"keyword {one.text!r} and {other.text!r}: contradict each other; give one gesture")
    return keywords, [Control.of(c) for c, k in zip(controls, called, strict=True) if not k]


def _calls(keywords, words, frames, fps):
    """[(frame, keyword)] of every utterance, in time."""
    calls = [(min(round(time * fps), frames - 1), keyword) for keyword in keywords for time in keyword.times(words)]
    return sorted(calls, key=lambda call: call[0])


class _Walk:
    """The windows found so far, and the pose that the next one follows."""

    def __init__(self, matcher, signals, features, controls, initial, exclude_take, options):
        self.matcher, self.signals, self.features, self.controls = matcher, signals, features, controls
        self.exclude_take, self.options = exclude_take, {"k": 1} | options
        self.total, database = len(features), matcher.database
        first = np.arange(0, self.total, WINDOW)
        for control in controls:
            control.check_times(self.total, database.fps)
        middles = (first + np.minimum(first + WINDOW, self.total)) / 2 / database.fps
        none = [()] * len(first)
        self.held = list(zip(*(c.windows(middles) for c in controls), strict=True)) if controls else none
        self.excluded = _excluded(database, matcher.span(exclude_take))
        self.allowed = cache(lambda hold: _allowed(signals, database.eligible, self.holding(hold), self.excluded))
        work = len(database) * len(first) > COMPILED_WORK
        self.compiled = work if matcher.compiled is None else matcher.compiled
        self.at, self.pose, self.last, self.steps, self.inserted = 0, initial, None, [], []
        self.texts, self.steps_into = {}, {}

    def holding(self, hold):
        return [control for control, holds in zip(self.controls, hold, strict=True) if holds]

    def until(self, end):
        """Search the windows up to `end`."""
        while self.at < end:
            begin, hold = self.at, self.held[self.at]
            eligible, together = self._eligible(hold)
            others = (w for w in range(begin, end) if self.held[w] != hold)
            self.at = next(others, end) if together else begin + 1
            database = replace(self.matcher.database, eligible=eligible)
            frames = min(self.at * WINDOW, self.total) - begin * WINDOW
            match = Matcher(database, self.compiled).search(
                self.features[begin * WINDOW :],
                initial=self.pose,
                exclude_take=self.exclude_take,
                frames=frames,
                **self.options,
            )
            steps = np.zeros(len(match.clip), STEP)
            for name in STEP.names:
                steps[name] = getattr(match, name)
            self.steps.append(steps)
            self.pose, self.last = database.pose_after(match.clip[-1], match.frame[-1]), match.positions[-1]

    def _eligible(self, hold):
        """(M, F) bool where the next window may start, and whether that holds for those after it too."""
        starts, _, step = self.allowed(hold)
        controls = [] if step == OFF else tested(self.holding(hold))
        if not controls or self.last is None:
            return starts, not controls
        starts, step = steps_kept(controls, self.signals, self.last, starts)
        self.steps_into[self.at] = clips_of(starts & ~self.excluded), step
        return starts, False

    def perform(self, keyword, gestures, at, limit):
        """Search up to a gesture whose stroke meets frame `at`, and insert that which goes on best from the pose.

        It ends before window `limit`, where the next keyword is spoken, if that is not the stroke's own.
        """
        seconds = at / self.matcher.database.fps
        fits = [(one, one.windows(at, self.total)) for one in gestures if not self._left_out(one)]
        fits = [(one, *windows) for one, windows in fits if windows]
        if not fits:
            raise CospeechError(
                f"keyword {keyword.text!r}: no gesture has the frames around its stroke that the word at "
                f"{seconds:.2f} s needs; name a longer clip"
            )
        if at // WINDOW < self.at:
            notice(f"keyword {keyword.text!r}: left out at {seconds:.2f} s, another gesture goes on")
            return
        self.until(max(self.at, min(first for _, first, _ in fits)))
        number = min(self.options["k"], len(fits)) - 1
        gesture, first, end = fits[np.argsort(self._distances(fits, at), kind="stable")[number]]
        self.until(max(self.at, first))
        end = max(at // WINDOW + 1, min(end, limit))
        self._insert(keyword, Inserted(gesture, self.at, end, self.at * WINDOW - at + gesture.stroke), len(fits))

    def _left_out(self, gesture):
        return gesture.index >= 0 and self.excluded.flat[gesture.index + gesture.stroke]

    def _distances(self, fits, at):
        """From the pose so far to each gesture's first frame; to the mean pose where nothing is before it."""
        normalization = self.matcher.database.pose_normalization
        pose = np.zeros(POSE_WIDTH) if isinstance(self.pose, str) else self.pose
        begins = [max(self.at, first) * WINDOW - at + one.stroke for one, first, _ in fits]
        starts = [one.pose(begin, normalization) for (one, _, _), begin in zip(fits, begins, strict=True)]
        return np.linalg.norm(np.array(starts) - pose, axis=1)

    def _insert(self, keyword, inserted, candidates):
        gesture, count = inserted.gesture, inserted.end - inserted.first
        steps = np.full(count, -1, STEP)
        steps["unmasked"] = False
        if gesture.index >= 0:
            number = gesture.index + inserted.offset + np.arange(count) * WINDOW
            steps["clip"], steps["frame"] = np.divmod(number, self.matcher.database.clip_frames)
        self.steps.append(steps)
        self.inserted.append(inserted)
        self.texts |= dict.fromkeys(range(self.at, inserted.end), (keyword.text, candidates))
        last = min(inserted.offset + count * WINDOW, len(gesture.positions)) - 1
        self.pose, self.last = gesture.pose(last, self.matcher.database.pose_normalization), gesture.positions[last]
        self.at = inserted.end

    def match(self):
        """What was found, with a notice for every set of controls that was widened."""
        database, own = self.matcher.database, [w not in self.texts for w in range(len(self.held))]
        texts = {hold: tuple(control.text for control in self.holding(hold)) for hold in set(self.held)}
        listed, widened = np.empty(len(own), object), np.full(len(own), "", object)
        candidates = np.zeros(len(own), int)
        for w, hold in enumerate(self.held):
            if own[w]:
                listed[w], candidates[w], widened[w] = texts[hold], *self.allowed(hold)[1:]
            else:
                listed[w], candidates[w] = (self.texts[w][0],), self.texts[w][1]
        for hold in dict.fromkeys(self.held):
            windows = np.flatnonzero([h == hold and o for h, o in zip(self.held, own, strict=True)])
            if len(windows) and (step := widened[windows[0]]):
                done = "set aside" if step == OFF else f"widened to {step}"
                where = f"{len(windows)} windows from {windows[0] * WINDOW / database.fps:.2f} s"
                notice(f"control {', '.join(texts[hold])}: no gesture of the database fits; {done} in {where}")
        for w, (count, step) in self.steps_into.items():
            candidates[w], widened[w] = count, widened[w] or step
        if late := [w for w, (_, step) in self.steps_into.items() if step]:
            texts = sorted({c.text for w in late for c in tested(self.holding(self.held[w]))})
            where = f"{len(late)} windows from {late[0] * WINDOW / database.fps:.2f} s"
            notice(
                f"control {', '.join(texts)}: no gesture goes on so from the frame before; that is widened in {where}"
            )
        steps = np.concatenate(self.steps)
        found = {name: steps[name] for name in STEP.names} | {"unmasked": widened == OFF}
        return ControlledMatch(
            database,
            **found,
            frames=self.total,
            controls=listed,
            candidates=candidates,
            widened=widened,
            inserted=tuple(self.inserted),
        )


def _allowed(signals, eligible, controls, excluded):
    """Which of the `eligible` windows (M, F) fit all controls, widened as far as it takes.

    Returns (M, F) bool; the number of clips that they leave, without the `excluded` (M, F); and the step's name.
    """
    _check_contradictions(signals, controls)
    for widened in (None, *WIDENED):
        starts = reduce(np.logical_and, [eligible, *(control.starts(signals, widened) for control in controls)])
        if clips := clips_of(starts & ~excluded):
            return starts, clips, f"percentile {widened}" if widened else ""
    return eligible, clips_of(eligible & ~excluded), OFF


def clips_of(starts):
    """The number of clips in which (M, F) `starts` lets a window begin."""
    return int(starts.any(axis=1).sum())


def _check_contradictions(signals, controls):
    """CospeechError that names the fewest controls whose bounds rule each other out, in any database."""
    impossible = lambda group: reduce(Wanted.__and__, (control.wanted for control in group)).impossible(signals)
    if not controls or not impossible(controls):
        return
    group = next(g for n in range(1, len(controls) + 1) for g in combinations(controls, n) if impossible(g))
    texts = " and ".join(repr(control.text) for control in group)
    how = "contradict each other; give them separate intervals" if len(group) > 1 else "contradicts itself"
    raise CospeechError(f"control {texts}: {how}")


def _excluded(database, span):
    take, begin, end = span
    at = np.rint(database.start * database.fps)[:, None] + np.arange(database.clip_frames)
    return (database.take[:, None] == take) & (at < end) & (at + WINDOW > begin)
