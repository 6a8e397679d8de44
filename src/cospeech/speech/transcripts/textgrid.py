"""Praat's TextGrid as text: long, short and chronological; the word tier, by its name or by what stands in it."""

import re
from statistics import mean

from cospeech.speech.transcripts.transcript import NotATranscript, Transcript

TOKEN = re.compile(
    r'"((?:[^"]|"")*)"|(?<!\S)![^\r\n]*|(?<!\S)(<exists>|<absent>|[-+]?[\d.][\d.e+-]*|-?nan|-?inf)(?!\S)', re.IGNORECASE
)
CHRONOLOGICAL = "Praat chronological TextGrid text file"
WORDS = re.compile(r"words?|ort|worte?|wörter|woerter|mots?|palabras?|tokens?|tokensalign")
PHONES = re.compile(r"phon(es?|emes?|s|align|o)|mau|seg(ments?)?|syl(l|lables?)?|kan|mas|sampa|ipa|pho")
SENTENCES = re.compile(r"sentences?|utt(erances?)?|phrases?|trn|transcript(ion)?|ortho|ipus?|turns?|text")
SILENT = {"", "sil", "sp", "spn", "#", "_", "<p:>", "<eps>"}


def read_textgrid(path, text, recording):
    """As Praat reads: only quoted strings, free-standing numbers and flags count, so long and short are one format.

    praatio refuses a whole file for one small overlap and does not name the row, hence these few lines.
    """
    found = (match for match in TOKEN.finditer(text) if match[1] is not None or match[2] is not None)
    tokens = (match[2] if match[1] is None else match[1].replace('""', '"') for match in found)
    try:
        kind = next(tokens)
        if kind == CHRONOLOGICAL:
            tiers = _chronological(tokens)
        elif (kind, next(tokens)) in (("ooTextFile", "TextGrid"), ("ooTextFile short", "TextGrid")):
            tiers = _tiers(tokens)
        else:
            raise NotATranscript(f"{path}: does not begin as a Praat TextGrid text file")
    except (StopIteration, ValueError, IndexError, OverflowError) as error:
        raise NotATranscript(f"{path}: the TextGrid is incomplete or damaged; save it again from Praat") from error
    if not tiers:
        raise NotATranscript(f"{path}: the TextGrid has no interval tier")
    name, intervals = word_tier(path, tiers)
    others = ", ".join(repr(other) for other, _ in tiers)
    notes = [f"tier {name!r} is read, of {others}"] if len(tiers) > 1 else []
    return Transcript([(f"tier {name!r}, interval {i}", w, s, e) for i, (s, e, w) in enumerate(intervals, 1)], notes)


def word_tier(path, tiers):
    """The (name, intervals) that holds words, of [(name, [(start, end, label)])]."""
    named = [tier for tier in tiers if _called(tier[0], WORDS)]
    if named:
        return next((tier for tier in named if _spoken(tier[1])), named[0])
    possible = [tier for tier in tiers if not _called(tier[0], PHONES) and not _called(tier[0], SENTENCES)]
    possible = [(name, rows) for name, rows in possible if mean([" " in x for x in _spoken(rows)] or [0]) < 0.5]
    if not possible:
        names = ", ".join(repr(name) for name, _ in tiers)
        raise NotATranscript(f"{path}: no tier of words among {names}; name it 'words'")
    return max(
        possible, key=lambda tier: mean([len(label) for label in _spoken(tier[1])] or [0])
    )  # of sounds and syllables


def _spoken(rows):
    return [label.strip() for *_, label in rows if label.strip().lower() not in SILENT]


def _called(name, kind):
    return any(kind.fullmatch(part) for part in re.split(r"[\W_\d]+", name.strip().lower()))


def _tiers(tokens):
    """[(name, [(start, end, label)])] of the interval tiers; `tokens` stand behind the object class."""

    def take(count):
        return [next(tokens) for _ in range(count)]

    _xmin, _xmax, exists = take(3)
    tiers = []
    for _ in range(int(next(tokens)) if exists.lower() == "<exists>" else 0):
        tier_class, name, _xmin, _xmax, entries = take(5)
        rows = [take(3 if tier_class == "IntervalTier" else 2) for _ in range(int(entries))]
        if tier_class == "IntervalTier":
            tiers.append((name, rows))
    return tiers


def _chronological(tokens):
    """The same of a file whose intervals stand in the order of time, each behind the number of its tier."""
    _xmin, _xmax, size = (next(tokens) for _ in range(3))
    tiers = [[next(tokens) for _ in range(4)] for _ in range(int(size))]
    rows = [[] for _ in tiers]
    for number in tokens:
        at = int(number) - 1
        if at < 0:
            raise ValueError("tiers are counted from 1")
        rows[at].append([next(tokens) for _ in range(3 if tiers[at][0] == "IntervalTier" else 2)])
    return [(tier[1], part) for tier, part in zip(tiers, rows, strict=True) if tier[0] == "IntervalTier"]
