"""Subtitles, SubRip (.srt) and WebVTT (.vtt): word times where each word has its own, else sentences."""

import html
import re

from cospeech.speech.transcripts.transcript import SPREAD, NotATranscript, Transcript, seconds_of, spread

CLOCK = r"(?:\d+:)?\d+:\d+[.,]\d+"
CUE = re.compile(rf"^[ \t]*({CLOCK})[ \t]*-->[ \t]*({CLOCK})[^\n]*\n", re.MULTILINE)
INSIDE = re.compile(rf"<({CLOCK})>")


def read_subtitles(path, text, recording):
    """Cues with times inside (as of YouTube) and with one word underlined at a time (Whisper's) have word times."""
    cues = _cues(text.replace("\r\n", "\n").replace("\r", "\n"))
    if not cues:
        raise NotATranscript(f"{path}: no line 'start --> end' in it: not {path.suffix} subtitles")
    if any(INSIDE.search(lines) for *_, lines in cues):
        return Transcript([row for cue in cues for row in _timed(*cue)], ["the times inside its cues are read"])
    underlined = [(row, word, s, e) for row, s, e, lines in cues for word in re.findall(r"<u>(.*?)</u>", lines)]
    if len(underlined) > len(cues) / 2:
        return Transcript(underlined, ["its underlined words are read"])
    ends = [min(end, cues[i + 1][1]) if i + 1 < len(cues) else end for i, (_, _, end, _) in enumerate(cues)]
    rows = [
        part
        for (row, start, _, lines), end in zip(cues, ends, strict=True)
        for part in spread(row, html.unescape(re.sub(r"<[^>]*>", "", lines)), start, end)
    ]
    return Transcript(rows, [SPREAD], spoken=False)


def _cues(text):
    """[(row name, start, end, lines)]; a blank line ends a cue."""
    found = list(CUE.finditer(text + "\n"))
    ends = [match.start() for match in found[1:]] + [len(text)] * bool(found)
    blocks = [re.split(r"\n[ \t]*\n", text[m.end() : end])[0] for m, end in zip(found, ends, strict=True)]
    return [
        (f"cue {i}", seconds_of(match[1]), seconds_of(match[2]), block)
        for i, (match, block) in enumerate(zip(found, blocks, strict=True), 1)
    ]


def _timed(row, start, end, lines):
    """Rows of the lines that have times inside; the others repeat what was shown before."""
    rows = []
    for line in lines.split("\n"):
        parts = INSIDE.split(line)
        times = [start, *map(seconds_of, parts[1::2]), end]
        for i, part in enumerate(parts[::2] if len(parts) > 1 else []):
            word = html.unescape(re.sub(r"<[^>]*>", "", part)).strip()
            if word:
                rows.append((row, word, times[i], times[i + 1]))
    return rows
