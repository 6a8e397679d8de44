"""What a reader finds in a file, before it is checked: rows, what to tell about them, and times in any notation."""

import re
from dataclasses import dataclass, field

from cospeech.errors import CospeechError

CLOCK = re.compile(r"(?:(\d+):)?(\d+):(\d+(?:[.,]\d+)?)\Z")
ISO = re.compile(r"PT(?:(\d+(?:\.\d+)?)H)?(?:(\d+(?:\.\d+)?)M)?(?:(\d+(?:\.\d+)?)S)?\Z", re.IGNORECASE)


class NotATranscript(CospeechError):
    """The file holds something else than words and times: beside a sound it is passed over, with a notice."""


@dataclass
class Transcript:
    """rows : [(row name, word, start, end)], times in seconds as they are written, None where there is none.

    notes : lines to tell when it is used. spoken : False where only sentences have times, spread over their words.
    """

    rows: list
    notes: list = field(default_factory=list)
    spoken: bool = True


def seconds_of(value):
    """Seconds of a number, "0.2", "0.2s", "PT0.2S", "00:01:02,5" or {"seconds": 1, "nanos": 2}; others as they are."""
    if isinstance(value, dict) and value.keys() & {"seconds", "nanos"}:  # protocol buffers leave out a zero
        parts = [seconds_of(value.get(key, 0)) for key in ("seconds", "nanos")]
        return parts[0] + parts[1] / 1e9 if all(type(part) in (int, float) for part in parts) else value
    if not isinstance(value, str):
        return value
    text = value.strip()
    if match := CLOCK.match(text):
        return 3600 * int(match[1] or 0) + 60 * int(match[2]) + float(match[3].replace(",", "."))
    if (match := ISO.match(text)) and any(match.groups()):
        return sum(unit * float(part or 0) for unit, part in zip((3600, 60, 1), match.groups(), strict=True))
    try:
        return float(text.removesuffix("s"))
    except ValueError:
        return value


def is_time(value):
    """Whether there is a number of seconds in `value`."""
    return type(seconds_of(value)) in (int, float)


def spread(row, text, start, end):
    """Rows of the words of a sentence that lasts from `start` to `end`, each as long as its letters are many."""
    words = re.sub(r"\[[^\]]*\]|\([^)]*\)|<[^>]*>|[♪♫]|(?<!\S)(?:-|>+)(?!\w)|>>", " ", text).split()
    rows, at, letters = [], start, sum(len(word) for word in words)
    for word in words:
        until = at + (end - start) * len(word) / letters
        rows.append((row, word, at, until))
        at = until
    return rows


SPREAD = "has the times of sentences only, spread over their words by length: these are not word times"
