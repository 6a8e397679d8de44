"""Direct frame replacement (thesis 5.4.2): these frames from that clip, faded in and out."""

import re
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from cospeech.clip import Clip, Trace
from cospeech.errors import CospeechError
from cospeech.matching.control.controls import NUMBER
from cospeech.matching.search.seams import BLEND, cross_fade, cross_fade_rotation
from cospeech.skeleton import bone_lengths, with_bone_lengths

KEYS = ("start", "end", "clip", "at")


@dataclass(frozen=True)
class Replacement:
    """Seconds `start` to `end` of a motion become those of the clip file `clip` from its second `at` on.

    at : None takes the stretch of the clip that joins best at both ends.
    """

    start: float
    end: float
    clip: str
    at: float | None = None

    @property
    def text(self):
        """As it is written on the command line."""
        return f"{self.start:g}-{self.end:g}={self.clip}" + ("" if self.at is None else f"@{self.at:g}")

    @classmethod
    def parse(cls, text):
        """`START-END=CLIP[@SECONDS]`."""
        found = re.fullmatch(rf"\s*({NUMBER})\s*-\s*({NUMBER})\s*=\s*(.+?)(?:@({NUMBER}))?\s*", text)
        if not found:
            raise CospeechError(f"replace {text!r}: write START-END=CLIP.h5@SECONDS, as in 3.0-4.5=other.h5@10.2")
        start, end, clip, at = found.groups()
        return cls(float(start), float(end), clip, None if at is None else float(at))

    @classmethod
    def of(cls, entry):
        """A Replacement as it is, a text, or a mapping with `start`, `end`, `clip` and perhaps `at`."""
        if isinstance(entry, cls):
            return entry
        if isinstance(entry, str):
            return cls.parse(entry)
        if not set(KEYS[:3]) <= set(entry) <= set(KEYS):
            raise CospeechError(f"replace: {', '.join(entry)}; expected start, end, clip and if wanted at")
        return cls(**entry)

    @cached_property
    def source(self):
        """The Clip that is copied from."""
        return Clip.read(self.clip)

    def frames(self, total, fps):
        """The frames (slice) of a motion of `total` frames that it replaces."""
        if not 0 <= self.start < self.end:
            raise CospeechError(f"replace {self.text!r}: its end is not after its start")
        first, last = round(self.start * fps), round(self.end * fps)
        if first >= last or last > total:
            where = f"the motion's {total / fps:.2f} s" if last > total else "one frame"
            raise CospeechError(f"replace {self.text!r}: {self.start:g} to {self.end:g} s do not fit {where}")
        return slice(first, last)

    def begin(self, motion, frames, fps):
        """The frame of the source that comes first."""
        if self.source.fps != fps:
            raise CospeechError(
                f"replace {self.text!r}: {self.clip} has {self.source.fps:g} fps, the motion {fps:g}; make them equal"
            )
        count, there = frames.stop - frames.start, len(self.source)
        begin = 0 if self.at is None else round(self.at * fps)
        if begin + count > there:
            raise CospeechError(
                f"replace {self.text!r}: {self.clip} has {there / fps:.2f} s, too short for {count / fps:.2f} s from "
                f"{begin / fps:.2f} s on"
            )
        return _best_joined(motion.positions, frames, self.source.positions) if self.at is None else begin


def _best_joined(positions, frames, source):
    """Where the stretch of `source` starts whose ends lie nearest to the poses around `frames`, joint by joint."""
    starts = np.arange(len(source) - (frames.stop - frames.start) + 1)
    cost = np.zeros(len(starts))
    for own, other in ((frames.start - 1, starts), (frames.stop, starts + frames.stop - frames.start - 1)):
        if 0 <= own < len(positions):
            cost += ((source[other] - positions[own]) ** 2).sum(axis=(1, 2))
    return int(cost.argmin())


def replaced(motion, replacements, fps):
    """The Motion with every one of `replacements` (see `Replacement.of`) in it, told in its trace.

    Between their times the clips' frames stand with the motion's bone lengths, nothing else changed; the `BLEND` frames
    before and after lead there and back. Head rotation and expression come along where both have them.
    """
    entries = sorted((Replacement.of(entry) for entry in replacements), key=lambda one: one.start)
    for one, other in pairwise(entries):
        if other.start < one.end:
            raise CospeechError(f"replace {one.text!r} and {other.text!r}: both want the same frames")
    for entry in entries:
        motion = _with(motion, entry, fps)
    return motion


def _with(motion, entry, fps):
    total, source = len(motion), entry.source
    frames = entry.frames(total, fps)
    begin = entry.begin(motion, frames, fps)
    around = np.arange(max(0, frames.start - BLEND), min(total, frames.stop + BLEND))
    share = 1 - np.maximum(0, np.maximum(frames.start - around, around - frames.stop + 1)) / (BLEND + 1)
    copied = np.clip(around - frames.start + begin, 0, len(source) - 1)
    positions = motion.positions.copy()
    fitted = with_bone_lengths(source.positions[copied].astype(float), bone_lengths(positions))
    positions[around] = cross_fade(positions[around], fitted, share)
    rotation, expression = motion.rotation, motion.expression
    if rotation is not None and source.rotation is not None:
        rotation = rotation.copy()
        rotation[around] = cross_fade_rotation(rotation[around], source.rotation[copied], share)
    if expression is not None and source.expression is not None and motion.face_model == source.face_model:
        expression, fade = expression.copy(), share[:, None].astype(np.float32)
        expression[around] += fade * (source.expression[copied] - expression[around])
    seconds = (begin + np.arange(frames.stop - frames.start)) / fps
    trace = motion.trace or _no_trace(total)
    trace = trace.overlaid(frames, take=Path(entry.clip).name, time=seconds, control=entry.text)
    return replace(motion, positions=positions, rotation=rotation, expression=expression, trace=trace)


def _no_trace(total):
    """Of a motion that a network made: all columns that a replacement fills."""
    columns = {"take": np.full(total, -1, np.int32), "time": np.full(total, -1.0)}
    return Trace(columns | {"control": columns["take"].copy()}, {"take": [], "control": []})
