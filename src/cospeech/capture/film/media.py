"""Getting video: lists of takes (CSV), films from addresses, and the sound that goes with a take."""

import csv
import io
import re
from pathlib import Path

from cospeech.errors import CospeechError, notice
from cospeech.files import sha256, writing

# our own columns, and beside each what the published interval lists call it
COLUMNS = {
    "id": ("id", "interval_id"),
    "video": ("video", "video_link", "video_fn"),
    "audio": ("audio",),
    "start": ("start", "start_time"),
    "end": ("end", "end_time"),
    "part": ("part", "dataset"),
    "speaker": ("speaker",),
}
PARTS = {"train": "train", "dev": "val", "val": "val", "validation": "val", "test": "test", "": None}
ADDRESS = re.compile(r"https?://", re.IGNORECASE)
LONGEST_NAME = 60
SILENCE = 16000  # Hz of the silence that stands in for a film without sound


def is_address(video):
    """Whether a take's video is a URL, and not a file."""
    return bool(ADDRESS.match(str(video)))


def safe_name(text):
    """A name made of letters, digits, _ and - alone, from whatever a list calls a take: "../../x" becomes "x"."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", str(text)).strip("_-")[:LONGEST_NAME]


def read_takes(path, speaker=None, videos=None):
    """Takes of a CSV file: [{id, video, start, end, part, audio}], keys without a value left out.

    Columns are id, video, start, end, part, audio (only video is needed), or those of the published interval list
    (speaker, video_fn, video_link, interval_id, start_time, end_time, dataset). Times are seconds or [days] h:mm:ss.
    `speaker` keeps that speaker's rows alone. `videos` is a folder with the films; one that lies there under the name
    in `video_fn` is used instead of its address.
    """
    path = Path(path)
    takes = [_take(row, f"{path}: line {line}", videos) for line, row in _rows(path) if _of(row, speaker)]
    if not takes:
        named = f" of speaker {speaker!r}" if speaker else ""
        raise CospeechError(f"{path}: no take{named} in it; its header needs a column 'video' or 'video_link'")
    return _with_own_names(takes)


def _rows(path):
    """[(line, {column: text without blanks around it})] of a CSV file; a notice names columns that nobody knows."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise CospeechError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise CospeechError(f"{path}: not a CSV file in UTF-8 (line {line}); save it as UTF-8") from error
    head = next((line for line in text.splitlines() if line.strip()), "")
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in head and "," not in head:
            raise CospeechError(f"{path}: its columns are parted by {name}; save it with commas between them")
    try:
        reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True, strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise CospeechError(f"{path}: not a CSV file ({error})") from error
    if not rows:
        return []
    columns = [column.lower() for column in rows[0][1]]
    known = {"video_fn", *(name for names in COLUMNS.values() for name in names)}
    if unknown := [column for column in columns if column and column not in known]:
        notice(f"{path}: columns that mean nothing here: {', '.join(unknown)}; known: {', '.join(sorted(known))}")
    if twice := [column for column in columns if column and columns.count(column) > 1]:
        raise CospeechError(f"{path}: column {twice[0]!r} is there twice")
    for line, row in rows[1:]:
        if any(row[len(columns) :]):
            raise CospeechError(
                f"{path}: line {line} has {len(row)} cells, the heading {len(columns)}; put text with commas in quotes"
            )
    return [(line, dict(zip(columns, row, strict=False))) for line, row in rows[1:]]


def _of(row, speaker):
    return speaker is None or row.get("speaker", "") == speaker


def _take(row, where, videos):
    def value(key):
        return next((text for name in COLUMNS[key] if (text := row.get(name))), "")

    video = value("video")
    local = Path(videos or "") / Path(row.get("video_fn") or "").name
    if videos and local.is_file():
        video = str(local)
    if not video:
        raise CospeechError(f"{where}: no video; expected a file or an address in 'video' or 'video_link'")
    start, end = (_seconds(value(key), f"{where}: {key}") for key in ("start", "end"))
    if end is not None and end <= (start or 0.0):
        raise CospeechError(f"{where}: ends at {end:g} s, not after its start")
    part = value("part").lower()
    if part not in PARTS:
        raise CospeechError(f"{where}: part {part!r} is not one of train, dev, test")
    name = safe_name(value("id") or Path(video).stem)
    take = {"id": name, "video": video, "audio": value("audio"), "start": start, "end": end, "part": PARTS[part]}
    return {key: value for key, value in take.items() if value not in (None, "")}


def _with_own_names(takes):
    """The takes with ids that differ: a number is added where two are alike or one is empty."""
    taken = set()
    for number, take in enumerate(takes, 1):
        base = name = take.get("id") or "take"
        while name in taken or not name:
            name = f"{base}_{number}"
            number += 1
        taken.add(name)
        take["id"] = name
    return [{"id": take["id"]} | take for take in takes]


def _seconds(text, where):
    """Seconds of "12.5", "0:12.5", "01:02:03.25" or "0 days 00:01:23.000000000"; None for nothing."""
    if not text:
        return None
    found = re.fullmatch(r"(?:(\d+) days?,? )?(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d*)?)", text)
    if not found:
        raise CospeechError(f"{where}: {text!r} is no time; write seconds, or hours:minutes:seconds")
    days, hours, minutes, seconds = (float(value or 0) for value in found.groups())
    return ((days * 24 + hours) * 60 + minutes) * 60 + seconds


def placeholder(url, path):
    """The line that tells how to go on without network: which film to put where."""
    return f"{url}: cannot be fetched here; put the film into {path} by hand, and run the same command again"


def can_fetch():
    """Whether yt-dlp is installed (the extra `video`)."""
    from importlib.util import find_spec

    return find_spec("yt_dlp") is not None


def fetch(url, path):
    """Fetch a film by yt-dlp into `path`, going on where an earlier try stopped; its SHA-256 goes into <path>.sha256.

    CospeechError with the placeholder's line without yt-dlp, or when nothing comes.
    """
    path = Path(path)
    if not can_fetch():
        raise CospeechError(f"{placeholder(url, path)} (or install yt-dlp: pip install 'cospeech[video]')")
    import yt_dlp

    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}.fetched{path.suffix}")
    options = {
        "outtmpl": {"default": str(partial)},
        "format": "best[ext=mp4]/best",
        "continuedl": True,
        "noplaylist": True,
        "quiet": True,
        "no_warnings": True,
        "noprogress": True,
        "retries": 3,
        "cachedir": False,
    }
    try:
        with yt_dlp.YoutubeDL(options) as download:
            download.download([url])
    except yt_dlp.utils.DownloadError as error:
        reason = " ".join(str(error).split())[:200]
        raise CospeechError(f"{placeholder(url, path)} ({reason})") from error
    partial.replace(path)
    record(path, url)


def record(path, url):
    """Write the SHA-256 of a film and where it came from, as `sha256sum` does: sum, two blanks, name; then the URL."""
    with writing(f"{path}.sha256") as temporary:
        temporary.write_text(f"{sha256(path)}  {Path(path).name}\n# {url}\n", encoding="utf-8")


def take_sound(video, audio=None, start=0.0, end=None):
    """(samples, rate) of a take: of its own sound file, which starts with it, or of seconds start to end of its film.

    A film without sound gives silence, and a notice.
    """
    from cospeech.speech import audio_duration, load_audio

    if audio:
        return load_audio(audio, end=None if end is None else min(end - start, audio_duration(audio)))
    if not _sounds(video):
        import numpy as np

        from cospeech.capture.film.decoding import open_film

        film = open_film(video, start, end)
        notice(f"{video}: has no sound; silence stands in")
        return np.zeros(round((film.end - film.start) * SILENCE), np.float32), SILENCE
    length = audio_duration(video)
    if start >= length:
        raise CospeechError(f"{video}: its sound ends at {length:.2f} s, before the take begins ({start:g} s)")
    if end is not None and end > length + 0.5:
        notice(f"{video}: its sound ends at {length:.2f} s, the take at {end:g} s")
    return load_audio(video, start=start, end=None if end is None else min(end, length))


def words_of_take(words, film, track):
    """The `Words` of a take, in its own time, from a file of those of its whole film.

    CospeechError for words beyond the end of the film, of its pictures and of its sound.
    """
    from cospeech.capture.film.decoding import open_film
    from cospeech.speech import audio_duration, read_words
    from cospeech.speech.words import cut_words

    seconds = max(open_film(film).end, audio_duration(film) if _sounds(film) else 0.0)
    spoken = read_words(words, Path(film).stem, seconds)
    return cut_words(spoken, track.start, track.start + track.frames / track.fps)


def _sounds(video):
    """Whether a film that can be opened has sound."""
    import av

    try:
        with av.open(video) as container:
            return bool(container.streams.audio)
    except (OSError, ValueError):  # what is wrong with it, whoever reads it says
        return True
