"""Keyword -> gesture (thesis 5.4.2): where a word is spoken, motion comes from a second database, tagged by word.

That second database is made of what the speaker did at a word in the training takes, or of clips that the user names.
"""

import difflib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError
from cospeech.files import read_yaml
from cospeech.matching.database.descriptors import WINDOW, pose_features
from cospeech.matching.database.sources import stretches, usable_frames
from cospeech.skeleton import WRISTS, bone_lengths, with_bone_lengths

FASTEST = (-0.3, 0.1)  # seconds from the middle of its word, between which a stroke has its highest speed
ARRIVAL = 0.3  # seconds after that by which the hands arrive
ARRIVED = 0.3  # of the highest speed; what is slower is no more of the stroke
VIGOUR = 0.5  # of the most vigorous gesture of a word; what is slower is taken for no gesture
EXTENT = WINDOW  # frames before and after the stroke that a gesture has, unless its start and end are told
KEYS = ("clip", "stroke", "start", "end")


@dataclass(frozen=True)
class Keyword:
    """Where `word` (or several words in a row) is spoken, make the gesture of the tag `gesture`."""

    word: str
    gesture: str

    @property
    def text(self):
        """As it is written on the command line."""
        return f"{self.word}={self.gesture}"

    @classmethod
    def parse(cls, text):
        """`WORD=GESTURE`."""
        word, _, gesture = (part.strip() for part in text.partition("="))
        if not _plain(word) or not gesture or "=" in gesture:
            raise CospeechError(f"keyword {text!r}: write WORD=GESTURE, as in huge=wide")
        return cls(word, gesture)

    @classmethod
    def of(cls, control):
        """A mapping with `keyword` and `gesture`."""
        if set(control) != {"keyword", "gesture"}:
            wrong = sorted(set(control) ^ {"keyword", "gesture"})[0]
            how = "is not known" if wrong in control else "is missing"
            raise CospeechError(f"control: {wrong!r} {how}; a keyword's control has keyword and gesture")
        return cls.parse(f"{control['keyword']}={control['gesture']}")

    def times(self, words):
        """Seconds of the middle of every utterance in `words` (`Words` or None); CospeechError if there is none."""
        if words is None or not len(words):
            raise CospeechError(
                f"keyword {self.word!r}: no word times of the speech are known; give them by --words or --recognize"
            )
        if said := spoken(words, self.word):
            return [(start + end) / 2 for start, end in said]
        close = difflib.get_close_matches(_plain(self.word), {_plain(word) for word in words.text}, 3)
        remedy = f"did you mean {' or '.join(close)}?" if close else "choose a word of the speech"
        raise CospeechError(f"keyword {self.word!r}: never spoken among the {len(words)} words of the speech; {remedy}")


@dataclass(frozen=True)
class Gesture:
    """Recorded motion around a stroke.

    positions (n, 55, 3) metres; rotation (n, 3) head rotation, or None. first, stroke, last : the frames of it that are
    the gesture; those around serve to fill whole windows. take, start : where it is from, seconds of its frame 0.
    index : its frame 0 among all frames of the database, -1 if it is not from there.
    """

    positions: np.ndarray
    rotation: np.ndarray | None
    first: int
    stroke: int
    last: int
    take: str
    start: float
    index: int = -1

    def windows(self, at, total):
        """(first window, end) that it takes in a speech of `total` frames when its stroke lies at frame `at`.

        Only windows for which it has every frame; None unless that of the stroke is one.
        """
        number = np.arange(-(-total // WINDOW))
        begin = number * WINDOW - at + self.stroke
        there = (begin >= 0) & (np.minimum(begin + WINDOW, total - at + self.stroke) <= len(self.positions))
        within = there & (begin <= self.last) & (begin + WINDOW > self.first)
        own = at // WINDOW
        if not (0 <= own < len(number) and within[own]):
            return None
        outside = np.flatnonzero(~within)
        return (int(outside[outside < own].max(initial=-1)) + 1, int(outside[outside > own].min(initial=len(number))))

    def pose(self, frame, normalization):
        """(96,) normalised pose feature of a frame."""
        return normalization(pose_features(self.positions[frame : frame + WINDOW])[0])


class Gestures:
    """The second database: `gestures[tag]` is a list of `Gesture`.

    named : {tag: list of `Gesture`}, the user's own (`read_gestures`). Any other tag is a word of the training takes.
    """

    def __init__(self, database, named=None):
        self.database, self.named = database, named or {}
        self._said = cache(lambda tag: gestures_of_word(database, tag))

    def __getitem__(self, tag):
        found = self.named.get(tag) or self._said(tag)
        if not found:
            known = {_plain(word) for word in self.database.words.text} | set(self.named)
            close = difflib.get_close_matches(tag.casefold(), known, 3)
            near = f"did you mean {' or '.join(close)}?" if close else "take another word, or name clips for it"
            raise CospeechError(f"gesture {tag!r}: neither said in the training takes nor named by --gestures; {near}")
        return found


def spoken(words, phrase):
    """[(start, end)] in seconds of every utterance of a word, or of several in a row; case and signs do not count."""
    said, wanted = [_plain(word) for word in words.text], [_plain(word) for word in phrase.split()]
    found = [i for i in range(len(said) - len(wanted) + 1) if said[i : i + len(wanted)] == wanted]
    return [(float(words.start[i]), float(words.end[i + len(wanted) - 1])) for i in found]


def _plain(word):
    return "".join(letter for letter in word.casefold() if letter.isalnum())


def apex(positions, fps, middle):
    """The frame at which the wrists arrive from their fastest movement around a word whose middle is at `middle` s.

    Returns it and the speed of that movement in m/s. positions (T, 55, 3).
    """
    moved = np.diff(positions[:, WRISTS], axis=0, prepend=positions[:1, WRISTS])
    speed = np.linalg.norm(moved, axis=-1).max(axis=1) * fps
    low, high = (min(max(0, round((middle + away) * fps)), len(speed) - 1) for away in FASTEST)
    peak = low + int(speed[low : high + 1].argmax())
    after = speed[peak + 1 : peak + 2 + round(ARRIVAL * fps)]
    if not len(after):
        return peak, float(speed[peak])
    slow = np.flatnonzero(after <= ARRIVED * speed[peak])
    return peak + int(slow[0] if len(slow) else after.argmin()), float(speed[peak])


def gestures_of_word(database, word):
    """What the speaker did where the training takes say `word`: list of `Gesture`, those without vigour left out."""
    fps, frames = database.fps, database.clip_frames
    begins, ends = stretches(database)
    usable, flat = usable_frames(database), database.positions.reshape(-1, *database.positions.shape[2:])
    rotation = None if database.rotation is None else database.rotation.reshape(-1, 3)
    found = []
    for take, middle in _utterances(database, word):
        clips = np.flatnonzero((database.take == take) & (database.start <= middle))
        clip = clips[database.start[clips].argmax()] if len(clips) else None
        if clip is None or middle >= database.start[clip] + frames / fps:
            continue
        begin, stop = begins[clip], ends[clip]
        zero = database.start[clip] - (clip * frames - begin) / fps
        stroke, vigour = apex(flat[begin:stop], fps, middle - zero)
        low, high = _run_around(usable[begin:stop], stroke)
        if high > low:
            part, stroke = slice(begin + low, begin + high), stroke - low
            gesture = Gesture(
                flat[part],
                None if rotation is None else rotation[part],
                stroke - EXTENT,
                stroke,
                stroke + EXTENT,
                database.takes[take],
                zero + low / fps,
                int(begin + low),
            )
            found.append((vigour, gesture))
    least = VIGOUR * max((vigour for vigour, _ in found), default=0.0)
    return [gesture for vigour, gesture in found if vigour >= least]


def _utterances(database, word):
    for take in range(len(database.takes)):
        own = np.flatnonzero(database.word_take == take)
        words = database.words
        words = Words(words.start[own], words.end[own], [words.text[i] for i in own])
        yield from ((take, (start + end) / 2) for start, end in spoken(words, word))


def _run_around(flags, at):
    """The run of True around `at`, as [low, high); empty if `at` is False."""
    if not flags[at]:
        return 0, 0
    bad = np.flatnonzero(~flags)
    return int(bad[bad < at].max(initial=-1)) + 1, int(bad[bad > at].min(initial=len(flags)))


def read_gestures(path, database):
    """A YAML file of the user's own gestures -> {tag: list of `Gesture`}.

    Each tag has an entry, or a list of them: {clip: FILE.h5, stroke: seconds, start: seconds, end: seconds}; start and
    end may be left out (a window before the stroke, and one after it). The subject's bone lengths are put in.
    """
    path = Path(path)
    content = read_yaml(path)
    if not isinstance(content, dict) or not content:
        raise CospeechError(f"{path}: expected TAG: {{clip: FILE.h5, stroke: SECONDS}}")
    sample = database.positions[:: max(1, len(database) // 256), 0]
    lengths = bone_lengths(np.asarray(sample))
    named = {}
    for tag, entries in content.items():
        entries = entries if isinstance(entries, list) else [entries]
        named[str(tag)] = [_named(f"{path}: {tag}", entry, database.fps, lengths) for entry in entries]
    return named


def _named(where, entry, fps, lengths):
    if not isinstance(entry, dict) or not {"clip", "stroke"} <= set(entry) <= set(KEYS):
        raise CospeechError(f"{where}: expected clip and stroke, and if wanted start and end")
    times = {key: entry[key] for key in KEYS[1:] if key in entry}
    if not all(isinstance(time, (int, float)) and np.isfinite(time) for time in times.values()):
        raise CospeechError(f"{where}: {', '.join(times)} are to be seconds")
    clip = Clip.read(entry["clip"])
    if clip.fps != fps:
        raise CospeechError(f"{where}: {entry['clip']} has {clip.fps:g} fps, the database has {fps:g}; make them equal")
    stroke = round(times["stroke"] * fps)
    first = round(times["start"] * fps) if "start" in times else stroke - EXTENT
    last = round(times["end"] * fps) if "end" in times else stroke + EXTENT
    if not (first <= stroke <= last and 0 <= stroke < len(clip)):
        raise CospeechError(
            f"{where}: start, stroke, end are to follow each other within the clip's {clip.duration:.2f} s"
        )
    low, high = _run_around(clip.valid, stroke)
    if high - low < 2 * WINDOW - 1:
        raise CospeechError(f"{where}: {entry['clip']} has {high - low} valid frames, {2 * WINDOW - 1} are needed")
    rotation = None if clip.rotation is None else clip.rotation[low:high]
    positions = with_bone_lengths(clip.positions[low:high], lengths).astype(np.float32)
    return Gesture(positions, rotation, first - low, stroke - low, last - low, Path(entry["clip"]).name, low / fps)
