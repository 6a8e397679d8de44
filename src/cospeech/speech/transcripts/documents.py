"""JSON of recognisers and aligners, by where their words stand and what they call the times.

Read are lists of {word, start, end} and the documents of Whisper (openai, WhisperX, faster-whisper, whisper.cpp),
gentle, Vosk, Google, AWS Transcribe, Azure, Deepgram, AssemblyAI, Rev and the Montreal Forced Aligner. Keys are
compared in small letters without underscores: startTime, start_time and StartTime are one.
"""

import json

from cospeech.errors import CospeechError
from cospeech.speech.transcripts.textgrid import word_tier
from cospeech.speech.transcripts.transcript import NotATranscript, Transcript, is_time, seconds_of

ALL = None  # every item of a list; a number is one item
PLACES = {  # whose, in keys down to the words
    "words": ("words",),
    "Whisper": ("segments", ALL, "words"),
    "Whisper, words": ("wordsegments",),
    "Vosk": ("result",),
    "Vosk, alternatives": ("alternatives", 0, "result"),
    "AWS Transcribe": ("results", "items"),
    "Deepgram": ("results", "channels", 0, "alternatives", 0, "words"),
    "Google": ("results", ALL, "alternatives", 0, "words"),
    "Azure, batch": ("recognizedphrases", ALL, "nbest", 0, "words"),
    "Azure": ("nbest", 0, "words"),
    "Azure, fast": ("phrases", ALL, "words"),
    "Rev": ("monologues", ALL, "elements"),
    "whisper.cpp": ("transcription",),
}
WORD_KEYS = ("word", "text", "token", "value", "punctuatedword", "content", "label")
SECONDS = {  # for start and end: key -> its unit in seconds
    "start": {
        "start": 1,
        "begin": 1,
        "onset": 1,
        "starttime": 1,
        "ts": 1,
        "startms": 1e-3,
        "startmilliseconds": 1e-3,
        "offsetmilliseconds": 1e-3,
        "starttimems": 1e-3,
    },
    "end": {"end": 1, "stop": 1, "endtime": 1, "endts": 1, "endms": 1e-3, "endmilliseconds": 1e-3, "endtimems": 1e-3},
    "duration": {"duration": 1, "dur": 1, "durationmilliseconds": 1e-3, "durationms": 1e-3},
}
TICK = 1e-7  # seconds; Azure's whole numbers
TIMELIKE = ("time", "start", "end", "begin", "offset", "stamp")


def read_json(path, text, recording):
    """The words of one JSON document, or of several one after another (Vosk's)."""
    documents = _documents(path, text)
    content = documents[0] if len(documents) == 1 else documents
    if isinstance(content, dict) and isinstance(content.get("tiers"), dict):
        return _aligner(path, content["tiers"])
    notes, entries = _entries(path, content)
    rows = [
        (f"word {i}", *_row(path, i, entry, first=i == 1))
        for i, entry in enumerate(entries, 1)
        if not _punctuation(entry)
    ]
    if rows and not any(is_time(start) or is_time(end) for *_, start, end in rows):
        strange = sorted({key for entry in entries for key in entry if any(part in key for part in TIMELIKE)})
        known = set().union(*SECONDS.values()) | ({"startoffset", "endoffset"} if "case" in entries[0] else set())
        if strange := [key for key in strange if key not in known]:
            raise NotATranscript(f"{path}: word 1: expected start and end, found {', '.join(strange[:5])}")
    if isinstance(content, dict) and {"audioduration", "words"} <= content.keys() and is_time(content["audioduration"]):
        rows = [(row, word, *(x / 1000 if is_time(x) else x for x in times)) for row, word, *times in rows]
        notes = ["its times are milliseconds (AssemblyAI's)"]
    return Transcript(rows, notes)


def _documents(path, text):
    decoder, at, found = json.JSONDecoder(object_pairs_hook=_plain), 0, []
    text = text.strip()
    try:
        while at < len(text):
            content, at = decoder.raw_decode(text, at)
            found.append(content)
            while at < len(text) and text[at] in " \t\r\n\x1e":
                at += 1
    except (ValueError, RecursionError) as error:
        problem = str(error) if isinstance(error, ValueError) else "nested too deeply"
        raise NotATranscript(f"{path}: is not valid JSON ({problem})") from error
    if not found:
        raise NotATranscript(f"{path}: is not valid JSON (it is empty)")
    return found


def _plain(pairs):
    return {key.lower().replace("_", ""): value for key, value in pairs}


def _entries(path, content):
    """(notes, words as objects) of a document or a list of words or documents."""
    wrapped = content.get("response") if isinstance(content, dict) else None
    content = wrapped if isinstance(wrapped, dict) else content
    notes, entries = [], None
    if isinstance(content, list):
        parts = [_placed(part) for part in content if isinstance(part, dict)]
        if len(parts) == len(content) > 0 and any(parts):
            return [], [entry for part in parts for entry in _checked(path, part or [])]
        entries = content
    elif isinstance(content, dict):
        entries = _google_last(content) or _placed(content)
        notes = _channels(content)
    if entries is None and isinstance(content, dict) and isinstance(content.get("segments"), list):
        timed = [s for s in content["segments"] if isinstance(s, dict) and {"start", "end", "text"} <= s.keys()]
        if timed:
            return ["its sentences have times, its words have none (Whisper: --word_timestamps True)"], []
    if entries is None:
        raise NotATranscript(f'{path}: holds no words; expected a list of {{word, start, end}}, "words" or "segments"')
    return notes, _checked(path, entries)


def _checked(path, entries):
    for number, entry in enumerate(entries, 1):
        if not isinstance(entry, dict) or (_word(entry) is None and not _punctuation(entry)):
            some = any(isinstance(other, dict) and _word(other) is not None for other in entries)
            problem = f"{path}: word {number}: expected an object with word, start and end"
            raise (CospeechError if some else NotATranscript)(problem)
    return entries


def _placed(content):
    """The list at the first of PLACES that the document has, or None."""
    for name, place in PLACES.items():
        found = _at(content, place)
        if isinstance(found, list):
            return [word for piece in found for word in _pieces(piece)] if name == "whisper.cpp" else found
    return None


def _at(content, place):
    """What stands at a place, or None; the lists of all items are joined, items without it are passed over."""
    for depth, key in enumerate(place):
        if key is ALL:
            if not isinstance(content, list):
                return None
            parts = [part for item in content if isinstance(part := _at(item, place[depth + 1 :]), list)]
            return [entry for part in parts for entry in part] if parts else None
        if isinstance(key, int):
            content = content[key] if isinstance(content, list) and len(content) > key else None
        else:
            content = content.get(key) if isinstance(content, dict) else None
    return content


def _google_last(content):
    """Google, told to tell speakers apart, repeats all words in its last result: then that alone, else None."""
    results = content.get("results")
    if not isinstance(results, list) or len(results) < 2:
        return None
    *before, last = (_at(result, ("alternatives", 0, "words")) for result in results)
    if not isinstance(last, list) or not last or not all(isinstance(x, dict) and "speakertag" in x for x in last):
        return None
    return last if len(last) == sum(len(words) for words in before if isinstance(words, list)) else None


def _channels(content):
    channels = _at(content, ("results", "channels"))
    phrases = content.get("recognizedphrases")
    if isinstance(phrases, list):
        channels = {str(phrase.get("channel")) for phrase in phrases if isinstance(phrase, dict)}
        if len(channels) > 1:
            first = next(str(phrase.get("channel")) for phrase in phrases if isinstance(phrase, dict))
            phrases[:] = [p for p in phrases if isinstance(p, dict) and str(p.get("channel")) == first]
    return (
        [f"the first of {len(channels)} channels is read"]
        if isinstance(channels, list | set) and len(channels) > 1
        else []
    )


def _pieces(segment):
    """Words of one of whisper.cpp's segments: itself, or its pieces, where a blank begins a word."""
    tokens = segment.get("tokens") if isinstance(segment, dict) else None
    if not isinstance(tokens, list) or " " not in str(segment.get("text")).strip():
        return [segment]
    words = []
    for token in tokens:
        text = str(token.get("text", "")) if isinstance(token, dict) else ""
        times = token.get("offsets") if isinstance(token, dict) else None
        if not text or text.startswith("[_") or not isinstance(times, dict):
            continue
        if words and not text.startswith(" "):
            words[-1]["text"] += text
            words[-1]["offsets"] = words[-1]["offsets"] | {"to": times.get("to")}
        else:
            words.append({"text": text, "offsets": dict(times)})
    return words


def _word(entry):
    if isinstance(entry.get("alternatives"), list):  # AWS
        entry = _at(entry, ("alternatives", 0)) or {}
    return _first(entry, WORD_KEYS) if isinstance(entry, dict) else None


def _punctuation(entry):
    return isinstance(entry, dict) and entry.get("type") in ("punctuation", "punct")


def _first(entry, keys):
    return next((entry[key] for key in keys if entry.get(key) is not None), None)


def _row(path, number, entry, first):
    """(word, start, end) of an entry, in seconds where they can be read."""
    start, end, duration = (_read(entry, keys) for keys in SECONDS.values())
    offsets = entry.get("offsets")
    if isinstance(offsets, dict):  # whisper.cpp's milliseconds
        start, end = (seconds_of(x) / 1000 if is_time(x) else x for x in (offsets.get("from"), offsets.get("to")))
    elif start is None and end is None and "offset" in entry and "duration" in entry:  # Azure
        start, duration = _ticks(entry["offset"]), _ticks(entry["duration"])
    elif "case" not in entry and (start is None or end is None):  # Google's second version; gentle counts letters
        start = seconds_of(_first(entry, ("startoffset",))) if start is None else start
        end = (
            seconds_of(_first(entry, ("endoffset", "offset") if "onset" in entry else ("endoffset",)))
            if end is None
            else end
        )
    if end is None and is_time(start) and is_time(duration):
        end = start + duration
    if start is None and end is not None and first and entry.keys() & {"endtime", "endoffset"}:
        start = 0.0  # protocol buffers leave out a zero
    return _word(entry), start, end


def _read(entry, keys):
    key = next((key for key in keys if entry.get(key) is not None), None)
    value = seconds_of(entry.get(key))
    return value * keys[key] if key and is_time(value) and keys[key] != 1 else value


def _ticks(value):
    return value * TICK if type(value) is int else seconds_of(value)


def _aligner(path, tiers):
    """The Montreal Forced Aligner's: {"tiers": {name: {"entries": [[start, end, label]]}}}."""
    found = []
    for name, tier in tiers.items():
        rows = tier.get("entries") if isinstance(tier, dict) else None
        if isinstance(rows, list) and all(isinstance(r, list) and len(r) == 3 and isinstance(r[2], str) for r in rows):
            found.append((name, rows))
    if not found:
        raise NotATranscript(f"{path}: its tiers hold no intervals of [start, end, label]")
    name, rows = word_tier(path, found)
    notes = [f"tier {name!r} is read, of {', '.join(repr(other) for other, _ in found)}"] if len(found) > 1 else []
    return Transcript([(f"tier {name!r}, interval {i}", w, s, e) for i, (s, e, w) in enumerate(rows, 1)], notes)
