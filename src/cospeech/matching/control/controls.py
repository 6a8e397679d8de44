"""Controls (thesis 5.3.2.1): where and how the hands shall move, said as masks over the database that change in time.

A control is a text such as `left_wrist_height=high@2.0-5.5`; see `docs/control.md` for all of its forms. Its bounds are
tested on signals of the database's own frames, and only windows that pass are searched.
"""

import re
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.matching.control.signals import SIGNALS
from cospeech.matching.database.descriptors import WINDOW, shift

OUTER = 85  # percentile of the upper levels; the lower ones have 100 - 85 = 15 (thesis Table 5.3)
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
        kept = (reduce(np.logical_and, (bound.frames(signals, widened) for bound in a)) for a in self.alternatives)
        return reduce(np.logical_or, kept)

    def impossible(self, signals):
        """Whether the bounds alone rule out every frame, whatever the database holds."""
        return all(_contradictory(bounds, signals) for bounds in self.alternatives)


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
        """(M, F) bool: where a window may start; one that leaves its clip goes on in the next."""
        frames = self.wanted.frames(signals, widened)
        tested = range(1, WINDOW) if self.strict else (WINDOW - 1,)
        return reduce(np.logical_and, (shift(frames, count) for count in tested), frames)


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
