"""Word times beside the audio: from any transcript that has them, checked, and held against the sound."""

import math
from pathlib import Path

import numpy as np

from cospeech.clip import Words
from cospeech.errors import CospeechError, notice
from cospeech.speech.transcripts.documents import read_json
from cospeech.speech.transcripts.lines import read_ctm, read_tsv
from cospeech.speech.transcripts.subtitles import read_subtitles
from cospeech.speech.transcripts.textgrid import read_textgrid
from cospeech.speech.transcripts.transcript import NotATranscript, seconds_of

READERS = {
    ".tsv": read_tsv,
    ".textgrid": read_textgrid,
    ".ctm": read_ctm,
    ".json": read_json,
    ".srt": read_subtitles,
    ".vtt": read_subtitles,
}
BESIDE = (".tsv", ".textgrid", ".ctm", ".json")  # a sound, in order of preference
OVERLAP = 0.05  # seconds; less is the aligner's rounding
ROUNDING = 0.1  # seconds that a word may begin or end after the sound's end
OVERSHOOT = 1.0  # seconds that a recogniser's last word may last beyond it: cut, with a notice
SILENCES = {"", "sil", "sp", "spn", "<eps>", "<sil>", "<s>", "</s>", "[noise]", "<p:>", "#"}


def find_words(audio_path, seconds=None):
    """Read the word times that lie beside a sound file (`talk.tsv`, `.TextGrid`, `.ctm` or `.json` for `talk.wav`).

    Returns `Words`, or None when there is no such file. Of several the first in this order counts that has words with
    times; one that is something else (blendshapes, a damaged file) costs a notice. `seconds`: see `read_words`.
    """
    audio_path = Path(audio_path)
    folder = audio_path.parent.iterdir() if audio_path.parent.is_dir() else ()
    beside = [path for path in folder if path.stem == audio_path.stem and path.suffix.lower() in BESIDE]
    beside.sort(key=lambda path: (BESIDE.index(path.suffix.lower()), path.name))
    found = []
    for path in beside:
        try:
            found.append((path, _transcript(path, audio_path.stem)))
        except NotATranscript as error:
            notice(f"{error}; it is passed over")
            continue
        if found[-1][1].spoken and found[-1][1].rows:
            break
    if not found:
        return None
    path, transcript = max(reversed(found), key=lambda one: (bool(one[1].rows), one[1].spoken))
    if len(beside) > 1:
        notice(f"{audio_path}: {len(beside)} files of word times beside it; {path.name} is used")
    return _words(path, transcript, seconds)


def read_words(path, recording=None, seconds=None):
    """Read word times, the format told by the suffix.

    `.tsv`: word, start, end (seconds, tabs; a heading may name the columns in another order, and milliseconds).
    `.TextGrid`: Praat's text files; the interval tier of words, by name or content. `.ctm`: recording, channel, start,
    duration, word; of several recordings that called `recording` (by default as the file). `.json`: see
    `transcripts.documents`. `.srt`, `.vtt`: sentences, spread over their words, unless words have times of their own.

    Returns `Words`. Silences are dropped, and words without an end or a time, with a notice. Overlaps under 50 ms are
    cut, with a notice; times that are unsorted, negative, reversed, or no numbers are a CospeechError that names the
    file and the row, and so are words beyond the end of a sound that lasts `seconds`. A notice tells what of a file
    with several tiers, channels or recordings was read.
    """
    path = Path(path)
    return _words(path, _transcript(path, recording or path.stem), seconds)


def within(words, seconds, source):
    """`words` that fit a sound of `seconds`, read from `source`; CospeechError for words beyond its end: another unit.

    The last may end up to OVERSHOOT later, as recognisers let it; it is cut there, with a notice.
    """
    if not len(words):
        return words
    start, end = np.asarray(words.start, float), np.asarray(words.end, float)
    if start[-1] > seconds + ROUNDING or end.max() > seconds + OVERSHOOT:
        raise CospeechError(
            f"{source}: the words end at {end.max():.2f} s, but the sound lasts {seconds:.2f} s; expected seconds "
            "(not hundredths or milliseconds) of this very recording"
        )
    if end.max() > seconds + ROUNDING:
        notice(f"{source}: the words end at {end.max():.2f} s, the sound lasts {seconds:.2f} s; they are cut there")
        return Words(np.minimum(start, seconds), np.minimum(end, seconds), words.text)
    return words


def _transcript(path, recording):
    """The `Transcript` of a file."""
    if path.suffix.lower() not in READERS:
        raise CospeechError(
            f"{path}: word times come as .tsv, .TextGrid, .ctm, .json, .srt or .vtt, not {path.suffix or 'this'}"
        )
    transcript = READERS[path.suffix.lower()](path, _text(path), recording)
    rows = [(row, str(word).strip(), start, end) for row, word, start, end in transcript.rows]
    transcript.rows = [row for row in rows if row[1].lower() not in SILENCES]
    return transcript


def _words(path, transcript, seconds):
    """The checked `Words` of a transcript, and what there is to tell about them."""
    for note in transcript.notes:
        notice(f"{path}: {note}")
    words = _checked(path, transcript.rows)
    if not len(words):
        notice(f"{path}: holds no words")
    return words if seconds is None else within(words, seconds, path)


def cut_words(words, start, end):
    """The `Words` of a recording that sound between `start` and `end` seconds, in the time that starts there."""
    kept = np.flatnonzero((np.asarray(words.end) > start) & (np.asarray(words.start) < end))
    first, last = np.asarray(words.start)[kept] - start, np.asarray(words.end)[kept] - start
    return Words(np.clip(first, 0, None), np.clip(last, None, end - start), [words.text[i] for i in kept])


def _text(path):
    """The file's text in UTF-8, or in UTF-16 where it says or shows so; a TextGrid may be in Latin-1, as Praat does."""
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
        text = raw.decode("latin-1")
        if path.suffix.lower() == ".textgrid" and not any(
            (c < " " and c not in "\t\r\n") or "\x7f" <= c < "\xa0" for c in text
        ):
            notice(f"{path}: is not UTF-8, and read as Latin-1")
            return text
        raise NotATranscript(f"{path}: is not text in UTF-8 or UTF-16; save it as UTF-8") from error


def _checked(path, rows):
    """`Words` of (row name, word, start, end) tuples, or one line that names the row."""
    timed = [row for row in rows if row[2] not in (None, "") and row[3] not in (None, "")]
    half = [row for row in rows if (row[2] in (None, "")) != (row[3] in (None, ""))]
    starts, ends, cut = [], [], 0
    for row, word, start, end in timed or half[:1]:
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
    if len(timed) < len(rows):
        notice(f"{path}: {len(rows) - len(timed)} words have no times and are left out")
    if cut:
        notice(f"{path}: {cut} words overlapped the next by less than {OVERLAP * 1000:.0f} ms; their ends were cut")
    return Words(np.array(starts, np.float64), np.array(ends, np.float64), [row[1] for row in timed])


def _seconds(path, row, name, value):
    try:
        seconds = float(seconds_of(value))
    except (TypeError, ValueError, OverflowError):
        seconds = math.nan
    if not math.isfinite(seconds):
        shown = f"{value!r:.60}"  # some files have numbers of thousands of digits
        raise CospeechError(f"{path}: {row}: {name} is {shown}, expected seconds as a number (with a decimal point)")
    return seconds
