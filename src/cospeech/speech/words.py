"""Word times beside the audio: TSV, Praat TextGrid, CTM and the JSON files of aligners and recognizers."""

import json
import math
import re
from pathlib import Path

import numpy as np

from cospeech.clip import Words
from cospeech.errors import CospeechError, notice

SUFFIXES = (".tsv", ".textgrid", ".ctm", ".json")  # in order of preference
OVERLAP = 0.05  # seconds; less is the aligner's rounding
SILENCES = {"", "sil", "sp", "spn", "<eps>", "<sil>", "<s>", "</s>", "[noise]", "<p:>", "#"}
WORD_KEYS, START_KEYS, END_KEYS = ("word", "text", "token"), ("start", "begin", "onset"), ("end", "stop", "offset")


def find_words(audio_path):
    """Read the word times that lie beside a sound file (`talk.tsv`, `.TextGrid`, `.ctm` or `.json` for `talk.wav`).

    Returns `Words`, or None when there is no such file; of several the first in this order counts, with a notice.
    """
    audio_path = Path(audio_path)
    folder = audio_path.parent.iterdir() if audio_path.parent.is_dir() else ()
    beside = [path for path in folder if path.stem == audio_path.stem and path.suffix.lower() in SUFFIXES]
    beside.sort(key=lambda path: (SUFFIXES.index(path.suffix.lower()), path.name))
    if len(beside) > 1:
        notice(f"{audio_path}: {len(beside)} files of word times beside it; {beside[0].name} is used")
    return read_words(beside[0]) if beside else None


def read_words(path):
    """Read word times, the format told by the suffix.

    `.tsv`: word, start, end (seconds, tabs; a header may name the columns in another order). `.TextGrid`: long or
    short, UTF-8 or UTF-16; the interval tier named "words" or "word", else the first. `.ctm`: file, channel, start,
    duration, word. `.json`: a list of {word, start, end}, or an object with "words" or "segments" (whisper, gentle).
    Silences are dropped. Overlaps under 50 ms are cut, with a notice; times that are unsorted, negative, reversed, or
    no numbers are a CospeechError that names the file and the row.
    """
    path = Path(path)
    readers = dict(zip(SUFFIXES, (_tsv, _textgrid, _ctm, _json), strict=True))
    if path.suffix.lower() not in readers:
        raise CospeechError(f"{path}: word times come as .tsv, .TextGrid, .ctm or .json, not {path.suffix or 'this'}")
    rows = readers[path.suffix.lower()](path, _text(path))
    rows = [(row, str(word).strip(), start, end) for row, word, start, end in rows]
    words = _checked(path, [row for row in rows if row[1].lower() not in SILENCES])
    if not len(words):
        notice(f"{path}: holds no words")
    return words


def _text(path):
    """The file's text in UTF-8, or in UTF-16 where it says or shows so."""
    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    raw = path.read_bytes()
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    else:  # Praat writes the mark, others may not: then every second byte of the first characters is zero
        encoding = "utf-16-be" if raw[:1] == b"\0" else "utf-16-le" if raw[1:2] == b"\0" else "utf-8-sig"
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as error:
        raise CospeechError(f"{path}: is not text in UTF-8 or UTF-16; save it as UTF-8") from error


def _checked(path, rows):
    """`Words` of (row name, word, start, end) tuples, or one line that names the row."""
    starts, ends, cut = [], [], 0
    for row, word, start, end in rows:
        start, end = _seconds(path, row, "start", start), _seconds(path, row, "end", end)
        if start < 0 or end < start:
            raise CospeechError(f"{path}: {row} ({word!r}): from {start} s to {end} s; expected 0 <= start <= end")
        if starts and start < starts[-1]:
            raise CospeechError(
                f"{path}: {row} ({word!r}): starts at {start} s, before the word above it; sort by start"
            )
        if starts and start < ends[-1]:
            if ends[-1] - start >= OVERLAP:
                raise CospeechError(
                    f"{path}: {row} ({word!r}): starts at {start} s, but the word above ends at {ends[-1]} s"
                )
            ends[-1] = start
            cut += 1
        starts.append(start)
        ends.append(end)
    if cut:
        notice(f"{path}: {cut} words overlapped the next by less than {OVERLAP * 1000:.0f} ms; their ends were cut")
    return Words(np.array(starts, np.float64), np.array(ends, np.float64), [row[1] for row in rows])


def _seconds(path, row, name, value):
    try:
        seconds = float(value)
    except (TypeError, ValueError):
        seconds = math.nan
    if not math.isfinite(seconds):
        raise CospeechError(f"{path}: {row}: {name} is {value!r}, expected seconds as a number (with a decimal point)")
    return seconds


def _tsv(path, text):
    order, rows = (0, 1, 2), []
    for number, line in enumerate(text.splitlines(), 1):
        cells = [cell.strip() for cell in line.split("\t")]
        if not any(cells):
            continue
        header = _header([cell.lower() for cell in cells]) if not rows else None
        if header:
            order = header
            continue
        if len(cells) <= max(order):
            raise CospeechError(f"{path}: line {number}: {len(cells)} columns, expected word, start, end between tabs")
        rows.append((f"line {number}", *(cells[i] for i in order)))
    return rows


def _header(cells):
    """The columns of word, start and end, or None where the line is no header."""
    columns = [
        next((i for i, cell in enumerate(cells) if cell in keys), None) for keys in (WORD_KEYS, START_KEYS, END_KEYS)
    ]
    return None if None in columns else tuple(columns)


def _ctm(path, text):
    rows = []
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.split()
        if not cells or cells[0].startswith((";;", "#")):
            continue
        row = f"line {number}"
        if len(cells) < 5:
            raise CospeechError(f"{path}: {row}: {len(cells)} columns, expected file, channel, start, duration, word")
        start, duration = (
            _seconds(path, row, name, cell) for name, cell in zip(("start", "duration"), cells[2:4], strict=True)
        )
        rows.append((row, cells[4], start, start + duration))
    return rows


def _textgrid(path, text):
    """As Praat reads: only quoted strings, free-standing numbers and <exists> count, so long and short are one format.

    praatio refuses a whole file for one small overlap and does not name the row, hence these few lines.
    """
    found = re.finditer(
        r'"((?:[^"]|"")*)"|(?<!\S)(<exists>|[-+]?[\d.][\d.e+-]*|-?nan|-?inf)(?!\S)', text, re.IGNORECASE
    )
    tokens = (match[2] if match[1] is None else match[1].replace('""', '"') for match in found)
    try:
        if (next(tokens), next(tokens)) not in (("ooTextFile", "TextGrid"), ("ooTextFile short", "TextGrid")):
            raise CospeechError(f"{path}: does not begin as a Praat TextGrid text file")
        tiers = _tiers(tokens)
    except (StopIteration, ValueError) as error:
        raise CospeechError(f"{path}: the TextGrid is incomplete or damaged; save it again from Praat") from error
    if not tiers:
        raise CospeechError(f"{path}: the TextGrid has no interval tier")
    name, intervals = next((tier for tier in tiers if tier[0].strip().lower() in ("words", "word")), tiers[0])
    return [(f"tier {name!r}, interval {i}", word, start, end) for i, (start, end, word) in enumerate(intervals, 1)]


def _tiers(tokens):
    """[(name, [(start, end, label)])] of the interval tiers; `tokens` stand behind the object class."""

    def take(count):
        return [next(tokens) for _ in range(count)]

    _xmin, _xmax, _exists, size = take(4)
    tiers = []
    for _ in range(int(size)):
        tier_class, name, _xmin, _xmax, entries = take(5)
        rows = [take(3 if tier_class == "IntervalTier" else 2) for _ in range(int(entries))]
        if tier_class == "IntervalTier":
            tiers.append((name, rows))
    return tiers


def _json(path, text):
    try:
        content = json.loads(text)
    except ValueError as error:
        raise CospeechError(f"{path}: is not valid JSON ({error})") from error
    entries = _json_entries(content)
    if entries is None:
        raise CospeechError(f'{path}: holds no words; expected a list of {{word, start, end}}, "words" or "segments"')
    rows, untimed = [], 0
    for number, entry in enumerate(entries, 1):
        row = f"word {number}"
        if not isinstance(entry, dict) or (word := _first(entry, WORD_KEYS)) is None:
            raise CospeechError(f"{path}: {row}: expected an object with word, start and end")
        start, end = _first(entry, START_KEYS), _first(entry, END_KEYS)
        if start is None and end is None:  # gentle and whisperX leave words without times that they did not find
            untimed += 1
            continue
        rows.append((row, word, start, end))
    if untimed:
        notice(f"{path}: {untimed} words have no times and are left out")
    return rows


def _json_entries(content):
    if isinstance(content, dict):
        if isinstance(content.get("words"), list):
            return content["words"]
        segments = content.get("segments")
        if not isinstance(segments, list) or not all(
            isinstance(s, dict) and isinstance(s.get("words"), list) for s in segments
        ):
            return None
        return [word for segment in segments for word in segment["words"]]
    return content if isinstance(content, list) else None


def _first(entry, keys):
    return next((entry[key] for key in keys if entry.get(key) is not None), None)
