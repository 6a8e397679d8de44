"""Controls (thesis 5.3.1.4): where and how the hands shall move, said as masks over the database that change in time.

A control is a text such as `left_wrist_height=high@2.0-5.5`; see `docs/control.md` for all of its forms. Its bounds are
tested on signals of the database's own frames, and only windows that pass are searched.
"""

import re
from dataclasses import dataclass, replace
from functools import cache, reduce
from itertools import combinations, groupby

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.matching.features import WINDOW
from cospeech.matching.search import COMPILED_WORK, Match, Matcher, checked
from cospeech.matching.signals import SIGNALS

OUTER = 85  # percentile of the upper levels; the lower ones have 100 - 85 = 15 (thesis Table 5.3)
WIDENED = (75, 60)  # what a bound gives way to, in turn, when no window of the database is left; then it is set aside
OFF = "off"
NUMBER = r"(?:\d+\.?\d*|\.\d+)"


@dataclass(frozen=True)
class Bound:
    """`signal` lies above (or below) `at`: a percentile of the database, or a value in the signal's unit."""

    signal: str
    above: bool
    at: float
    percentile: bool
    inclusive: bool = True

    def __invert__(self):
        return replace(self, above=not self.above, inclusive=not self.inclusive)

    def threshold(self, signals, widened=None):
        """In the signal's unit. `widened`: percentile (mirrored for upper bounds) that it gives way to, if wider."""
        asked = signals.percentile(self.signal, self.at) if self.percentile else self.at
        if widened is None:
            return asked
        wide = signals.percentile(self.signal, widened if self.above else 100 - widened)
        return min(asked, wide) if self.above else max(asked, wide)

    def frames(self, signals, widened=None):
        """(M, F) bool: the frames that keep it."""
        compare = {(1, 1): np.greater_equal, (1, 0): np.greater, (0, 1): np.less_equal, (0, 0): np.less}
        test = compare[self.above, self.inclusive]
        return test(signals.values(self.signal), np.float32(self.threshold(signals, widened)))


@dataclass(frozen=True)
class Wanted:
    """Alternatives, each a tuple of `Bound`s that hold together; combined with `&`, `|` and `~`."""

    alternatives: tuple

    def __and__(self, other):
        return Wanted(tuple(one + two for one in self.alternatives for two in other.alternatives))

    def __or__(self, other):
        return Wanted(self.alternatives + other.alternatives)

    def __invert__(self):
        refused = (Wanted(tuple((~bound,) for bound in bounds)) for bounds in self.alternatives)
        return reduce(Wanted.__and__, refused)

    @classmethod
    def of(cls, name, level):
        """One bound: `level` is a level of the signal `name`, or a value such as `>0.2` or `<0.1` in its unit."""
        if name not in SIGNALS:
            raise CospeechError(f"control {name!r} is not known; known: {', '.join(SIGNALS)}")
        levels = SIGNALS[name].levels
        if level in levels:
            return cls(((Bound(name, levels[level], OUTER if levels[level] else 100 - OUTER, True),),))
        value = re.fullmatch(rf"([<>])(=?)\s*([-+]?{NUMBER})", level)
        if not value:
            known = f"{', '.join(levels)}, or a value in {SIGNALS[name].unit} such as >0.2 or <0.1"
            raise CospeechError(f"control {name} has no level {level!r}; known: {known}")
        return cls(((Bound(name, value[1] == ">", float(value[3]), False, bool(value[2])),),))

    def frames(self, signals, widened=None):
        """(M, F) bool: the frames that fit one of the alternatives."""
        return reduce(np.logical_or, (_all(bound.frames(signals, widened) for bound in a) for a in self.alternatives))

    def impossible(self, signals):
        """Whether the bounds alone rule out every frame, whatever the database holds."""
        return all(_contradictory(bounds, signals) for bounds in self.alternatives)


def _all(masks):
    return reduce(np.logical_and, masks)


def _contradictory(bounds, signals):
    for name in {bound.signal for bound in bounds}:
        own = [(b.threshold(signals), b) for b in bounds if b.signal == name]
        highest = max(((at, not b.inclusive) for at, b in own if b.above), default=(-np.inf, False))
        lowest = min(((at, b.inclusive) for at, b in own if not b.above), default=(np.inf, True))
        if highest[0] > lowest[0] or (highest[0] == lowest[0] and (highest[1] or not lowest[1])):
            return True
    return False


@dataclass(frozen=True)
class Control:
    """What is wanted from `start` to `end` (seconds of the speech), as `text` says it.

    strict : every frame of a window is tested; else the first and the last, as published, so that motion stays free.
    """

    text: str
    wanted: Wanted
    start: float = 0.0
    end: float = np.inf
    strict: bool = False

    @classmethod
    def parse(cls, text):
        """`[strict ]SIGNAL=LEVEL[@START-END]`; terms may be joined by and, or, not and parentheses."""
        what, at, interval = text.partition("@")
        times = re.fullmatch(rf"\s*({NUMBER})?\s*-\s*({NUMBER})?\s*", interval)
        if at and not (times and any(times.groups())):
            raise CospeechError(f"control {text!r}: {interval!r} is no interval; write @START-END in seconds")
        start, end = times.groups() if times else ("", "")
        strict, what = re.fullmatch(r"\s*(strict\s)?(.*)", what, re.DOTALL).groups()
        return cls(text, _Terms(what, text).whole(), float(start or 0), float(end or np.inf), bool(strict))

    @classmethod
    def of(cls, control):
        """A Control as it is, a text, or a mapping with `signal`, `level` and perhaps `start`, `end`, `strict`."""
        if isinstance(control, cls):
            return control
        if isinstance(control, str):
            return cls.parse(control)
        unknown = set(control) - {"signal", "level", "start", "end", "strict"}
        if unknown or not {"signal", "level"} <= set(control):
            wrong = f"{sorted(unknown)[0]!r} is not known" if unknown else "signal or level is missing"
            raise CospeechError(f"control: {wrong}; give signal, level and if wanted start, end, strict")
        start, end, strict = control.get("start", 0.0), control.get("end", np.inf), control.get("strict", False)
        when = f"@{start:g}-{end:g}" if np.isfinite(end) else f"@{start:g}-" if start else ""
        text = f"{'strict ' if strict else ''}{control['signal']}={control['level']}{when}"
        return cls(text, Wanted.of(control["signal"], str(control["level"])), float(start), float(end), strict)

    def check_times(self, frames, fps):
        """CospeechError unless the interval begins in a speech of that length; a notice if it goes on past its end."""
        seconds = frames / fps
        if not 0 <= self.start < self.end:
            raise CospeechError(f"control {self.text!r}: its end is not after its start; write @START-END in seconds")
        if self.start >= seconds:
            raise CospeechError(f"control {self.text!r}: it lies outside the speech, which has {seconds:.2f} s")
        if np.isfinite(self.end) and self.end > seconds + 1 / fps:
            notice(f"control {self.text!r}: it goes on past the speech, which has {seconds:.2f} s")

    def windows(self, middles):
        """(W,) bool from the windows' middles in seconds: those inside, or the nearest if it is too short for one.

        Intervals that do not overlap thus never share a window, unless they are shorter than one.
        """
        inside = (middles >= self.start) & (middles < self.end)
        if not inside.any():
            inside[np.abs(middles - (self.start + min(self.end, middles[-1])) / 2).argmin()] = True
        return inside

    def starts(self, signals, widened=None):
        """(M, F) bool: where a window may start (windows that leave their clip are never eligible)."""
        frames = self.wanted.frames(signals, widened)
        starts = frames.copy()
        for ahead in range(1, WINDOW) if self.strict else (WINDOW - 1,):
            starts[:, :-ahead] &= frames[:, ahead:]
        return starts


class _Terms:
    """Recursive descent over `a=b and (not c=d or e=f)`; not binds before and, and before or."""

    def __init__(self, what, text):
        self.text = text
        self.rest = re.findall(r"[()]|[^\s()=]+\s*=\s*(?:[<>]=?\s*)?[^\s()=]+|[^\s()]+", what)

    def whole(self):
        wanted = self.either()
        if self.rest:
            self.refuse(self.rest[0])
        return wanted

    def either(self):
        wanted = self.both()
        while self.take("or"):
            wanted |= self.both()
        return wanted

    def both(self):
        wanted = self.one()
        while self.take("and"):
            wanted &= self.one()
        return wanted

    def one(self):
        if self.take("not"):
            return ~self.one()
        if self.take("("):
            wanted = self.either()
            if not self.take(")"):
                self.refuse("the end")
            return wanted
        if not self.rest or "=" not in self.rest[0][1:]:
            self.refuse(self.rest[0] if self.rest else "the end")
        name, level = self.rest.pop(0).split("=", 1)
        return Wanted.of(name.strip(), level.strip())

    def take(self, token):
        return bool(self.rest) and self.rest[0] == token and bool(self.rest.pop(0))

    def refuse(self, found):
        raise CospeechError(f"control {self.text!r}: SIGNAL=LEVEL is expected, or and, or, not, ( and ), not {found!r}")


@dataclass(frozen=True)
class ControlledMatch(Match):
    """A `Match` under controls; `unmasked` tells where they were set aside.

    controls (W,) : tuples of the texts that each window follows. candidates (W,) : clips with a window that fits.
    widened (W,) : "" as asked, "percentile 75", "percentile 60" or "off", what it took to find any.
    """

    controls: np.ndarray
    candidates: np.ndarray
    widened: np.ndarray


def search(matcher, signals, features, controls, *, k=1, initial="mean", seed=0, variant="pose", exclude_take=None):
    """`Matcher.search` under controls: -> ControlledMatch.

    controls : list of `Control`, text or mapping (see `Control.of`); in each window all that hold there, together.
    Other parameters as in `Matcher.search`. Only one (M, F) mask per different set of controls is kept, however long
    the speech: stretches of windows that follow the same controls are searched in turn, each in a database in which
    only the allowed windows are eligible, and each from the pose that the one before ended with.
    """
    controls, features = [Control.of(control) for control in controls], checked(features)
    database, total = matcher.database, len(features)
    first = np.arange(0, total, WINDOW)
    for control in controls:
        control.check_times(total, database.fps)
    middles = (first + np.minimum(first + WINDOW, total)) / 2 / database.fps
    held = [tuple(column) for column in np.array([c.windows(middles) for c in controls], bool).T]
    excluded = _excluded(database, matcher.span(exclude_take))
    allowed = cache(lambda hold: _allowed(signals, [c for c, h in zip(controls, hold, strict=True) if h], excluded))
    compiled = len(database) * len(held) > COMPILED_WORK if matcher.compiled is None else matcher.compiled
    parts, windows = [], 0
    for hold, run in groupby(held):
        at, windows = windows, windows + len(list(run))
        narrowed = Matcher(replace(database, eligible=allowed(hold)[0]), compiled)
        frames = min(windows * WINDOW, total) - at * WINDOW
        parts.append(narrowed.search(features[at * WINDOW :], k, None, initial, seed, variant, exclude_take, frames))
        initial = database.pose[parts[-1].clip[-1], parts[-1].frame[-1] + WINDOW - 1]
    return _joined(database, parts, total, controls, held, allowed)


def _allowed(signals, controls, excluded):
    """Windows that fit all controls, widened as far as it takes.

    Returns (M, F) bool; the number of clips that they leave, without the `excluded` (M, F); and the step's name.
    """
    _check_contradictions(signals, controls)
    eligible = signals.database.eligible
    for widened in (None, *WIDENED):
        starts = _all([eligible, *(control.starts(signals, widened) for control in controls)])
        if clips := _clips(starts & ~excluded):
            return starts, clips, f"percentile {widened}" if widened else ""
    return eligible, _clips(eligible & ~excluded), OFF


def _clips(starts):
    return int(starts.any(axis=1).sum())


def _check_contradictions(signals, controls):
    """CospeechError that names the fewest controls whose bounds rule each other out, in any database."""
    impossible = lambda group: reduce(Wanted.__and__, (control.wanted for control in group)).impossible(signals)  # noqa: E731
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


def _joined(database, parts, frames, controls, held, allowed):
    """The stretches' matches as one, with a notice for every set of controls that was widened."""
    joined = [np.concatenate([getattr(p, n) for p in parts]) for n in ("clip", "frame", "pose_rank", "audio_rank")]
    texts = {hold: tuple(c.text for c, h in zip(controls, hold, strict=True) if h) for hold in set(held)}
    for hold in dict.fromkeys(held):
        if step := allowed(hold)[2]:
            windows = np.flatnonzero([h == hold for h in held])
            done = "set aside" if step == OFF else f"widened to {step}"
            where = f"{len(windows)} windows from {windows[0] * WINDOW / database.fps:.2f} s"
            notice(f"control {', '.join(texts[hold])}: no gesture of the database fits; {done} in {where}")
    listed = np.empty(len(held), object)
    listed[:] = [texts[hold] for hold in held]
    candidates = np.array([allowed(hold)[1] for hold in held])
    widened = np.array([allowed(hold)[2] for hold in held], object)
    return ControlledMatch(database, *joined, widened == OFF, frames, listed, candidates, widened)


def explain(match):
    """A table, one line per window of a `Match`: source, ranks, candidates that the controls left, and the controls."""
    everything = _clips(match.database.eligible)
    rows = [("seconds", "source", "pose rank", "audio rank", "clips left", "control")]
    for w, (take, time) in enumerate(zip(match.take, match.time, strict=True)):
        left, control = everything, ""
        if isinstance(match, ControlledMatch):
            left, step = match.candidates[w], match.widened[w]
            control = ", ".join(match.controls[w]) + (f" ({step})" if step else "")
        ranks = match.pose_rank[w], match.audio_rank[w]
        at = w * WINDOW / match.database.fps
        rows.append((f"{at:.2f}", f"{take} {time:.2f} s", *map(str, ranks), f"{left} of {everything}", control))
    return _table(rows)


def listing():
    """A table of all signals with their levels, units and what they measure."""
    rows = [("signal", "levels", "unit", "")]
    rows += [(name, f"{s.lower}, {s.upper}", s.unit, s.about) for name, s in SIGNALS.items()]
    return _table(rows)


def _table(rows):
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
