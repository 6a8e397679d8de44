"""Word times in lines: TSV (also Whisper's own, in milliseconds) and NIST's CTM."""

from pathlib import Path
from statistics import median

from cospeech.errors import CospeechError
from cospeech.speech.transcripts.transcript import SPREAD, NotATranscript, Transcript, is_time, seconds_of, spread

WORD_KEYS, START_KEYS, END_KEYS = ("word", "text", "token"), ("start", "begin", "onset"), ("end", "stop", "offset")
UNITS = {"": 1, "_s": 1, "_sec": 1, "_seconds": 1, "_ms": 1e-3}  # what a heading may add to them
MILLISECONDS = 20  # a sentence that "lasts" longer, in whole numbers, is Whisper's


def read_tsv(path, text, recording):
    """word, start, end between tabs; a heading may name the columns in another order, and the unit as `start_ms`."""
    order, rows, heading = (0, 1, 2), [], None
    for number, line in enumerate(text.splitlines(), 1):
        cells = [cell.strip() for cell in line.split("\t")]
        if not any(cells):
            continue
        if not rows and heading is None:
            heading = _heading([cell.lower() for cell in cells])
            if heading:
                *order, unit = heading
                continue
            if len(cells) > 2 and is_time(cells[0]) and is_time(cells[1]) and not is_time(cells[2]):
                order = (2, 0, 1)  # labels as Audacity writes them
            heading = ()
        if len(cells) <= max(order):
            problem = f"{path}: line {number}: {len(cells)} columns, expected word, start, end between tabs"
            raise (CospeechError if rows else NotATranscript)(problem)
        rows.append((f"line {number}", *(cells[i] for i in order)))
    if rows and not any(is_time(start) or is_time(end) for *_, start, end in rows):
        row, _, start, _ = rows[0]
        raise NotATranscript(f"{path}: {row}: start is {start!r}, expected word, start, end (seconds) between tabs")
    if heading and unit != 1:
        rows = [(*row[:2], *(_times(value, unit) for value in row[2:])) for row in rows]
        return Transcript(rows, ["its times are in milliseconds, as its heading says"])
    return _whispers(rows) if heading and tuple(order) == (2, 0, 1) else Transcript(rows)


def _heading(cells):
    """The columns of word, start and end, and the unit in seconds; None where the line is no heading."""
    for ending, unit in UNITS.items():
        named = [[key + ending for key in keys] for keys in (START_KEYS, END_KEYS)]
        columns = [next((i for i, cell in enumerate(cells) if cell in keys), None) for keys in (WORD_KEYS, *named)]
        if None not in columns:
            return *columns, unit
    return None


def _times(value, unit):
    return seconds_of(value) * unit if is_time(value) else value


def _whispers(rows):
    """start, end, text: whole numbers are milliseconds, and a row of several words is a sentence."""
    notes, spoken = [], True
    whole = rows and all(s.isdecimal() and e.isdecimal() and len(s + e) < 30 for *_, s, e in rows)
    if whole and median(int(end) - int(start) for *_, start, end in rows) > MILLISECONDS:
        rows = [(row, text, int(start) / 1000, int(end) / 1000) for row, text, start, end in rows]
        notes.append("its times are whole numbers and taken as milliseconds (Whisper's own table)")
    several = [" " in text for _, text, *_ in rows]
    if sum(several) * 2 >= len(rows) > 0 and all(is_time(start) and is_time(end) for *_, start, end in rows):
        notes.append(SPREAD)
        spoken = False
        rows = [part for row, text, *times in rows for part in spread(row, text, *map(seconds_of, times))]
    return Transcript(rows, notes, spoken)


def read_ctm(path, text, recording):
    """recording, channel, start, duration, word: those of this recording, and of its first channel."""
    rows, skipping = [], False
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.split()
        if not cells or cells[0].startswith((";;", "#")):
            continue
        if cells[-1].upper() in ("<ALT_BEGIN>", "<ALT>", "<ALT_END>"):
            skipping = cells[-1].upper() == "<ALT>"  # the first alternative is read
            continue
        row = f"line {number}"
        if len(cells) < 5:
            problem = f"{path}: {row}: {len(cells)} columns, expected file, channel, start, duration, word"
            raise (CospeechError if rows else NotATranscript)(problem)
        if not skipping:
            rows.append((row, *cells[:5]))
    if rows and not any(is_time(start) and is_time(duration) for _, _, _, start, duration, _ in rows):
        row, _, _, start, duration, _ = rows[0]
        name, value = ("duration", duration) if is_time(start) else ("start", start)
        raise NotATranscript(f"{path}: {row}: {name} is {value!r}, expected seconds as a number")
    rows, notes = _own(path, rows, recording)
    return Transcript([_ended(path, *row) for row in rows], notes)


def _ended(path, row, _recording, _channel, start, duration, word):
    for name, value in (("start", start), ("duration", duration)):
        if not is_time(value):
            raise CospeechError(f"{path}: {row}: {name} is {value!r}, expected seconds as a number")
    return row, word, float(seconds_of(start)), seconds_of(start) + seconds_of(duration)


def _own(path, rows, recording):
    """The rows of this recording's first channel, and what to tell of the others."""
    notes, recordings = [], list(dict.fromkeys(row[1] for row in rows))
    if len(recordings) > 1:
        wanted = {recording.lower(), path.stem.lower()}
        own = [name for name in recordings if {Path(name).name.lower(), Path(name).stem.lower()} & wanted]
        if not own:
            held = ", ".join(recordings[:5]) + (", ..." if len(recordings) > 5 else "")
            raise CospeechError(f"{path}: holds {len(recordings)} recordings ({held}), none of them is {recording!r}")
        rows = [row for row in rows if row[1] == own[0]]
        notes.append(f"recording {own[0]!r} is read, of {len(recordings)}")
    channels = list(dict.fromkeys(row[2] for row in rows))
    if len(channels) > 1:
        rows = [row for row in rows if row[2] == channels[0]]
        notes.append(f"channel {channels[0]!r} is read, of {', '.join(channels)}")
    return rows, notes
