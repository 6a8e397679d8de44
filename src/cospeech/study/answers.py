"""What participants sent back: files that are read and checked against their study, or left out with a reason."""

import json
import re
import zlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from cospeech.errors import CospeechError

SCHEMA, VERSION = "cospeech.answers", 1
CODE = re.compile(r"[A-Za-z0-9_-]{1,32}")
CHOICES = ("first", "same", "second")
WATCHED = 0.9  # share of a clip's length that must lie between its play and its end
LARGEST = 5_000_000  # bytes; a file of answers has a few kilobytes


@dataclass(frozen=True)
class Answers:
    """One participant: `items` as the page wrote them; `failed` attention checks of `checks`."""

    participant: str
    path: str
    finished: str
    items: list

    @property
    def checks(self):
        return [item for item in self.items if item["kind"] == "check"]

    @property
    def failed(self):
        """How many checks were not answered as asked, in every question."""
        return sum(any(value != item["expected"] for value in item["values"].values()) for item in self.checks)


@dataclass(frozen=True)
class Left:
    """A file or a participant that is not counted, and why."""

    path: str
    participant: str
    reason: str


def read_study(folder):
    """The description of a study: content of <folder>/study.json, as `build_study` returned it."""
    path = Path(folder) / "study.json"
    study = _json(path)
    if study.get("schema") != "cospeech.study" or study.get("version") != VERSION:
        raise CospeechError(f"{path}: is no study of version {VERSION}; build it again")
    missing = {"id", "kind", "points", "questions", "conditions", "stimuli", "items", "checks", "tracks"} - study.keys()
    if missing:
        raise CospeechError(f"{path}: has no {', '.join(sorted(missing))}; build it again")
    return study


def read_answers(study, paths, failures=0):
    """(list of Answers, list of Left) of the files `paths`, folders among them standing for their .json files.

    failures : attention checks that a participant may fail and still count.

    Left out are: what is no whole file of answers of this study, a participant's second file (the one finished first
    counts), and who failed more checks.
    """
    read, left = [], []
    for path in _listed(paths):
        try:
            read.append(read_file(study, path))
        except CospeechError as error:
            left.append(Left(str(path), "", str(error).removeprefix(f"{path}: ")))
    kept = {}
    for answers in sorted(read, key=lambda one: (one.finished, one.path)):
        first = kept.setdefault(answers.participant, answers)
        if first is not answers:
            again = f"participant {answers.participant} has answered before, in {first.path}"
            left.append(Left(answers.path, answers.participant, again))
        elif answers.failed > failures:
            failed = f"failed {answers.failed} of {len(answers.checks)} attention checks"
            left.append(Left(answers.path, answers.participant, failed))
    out = {one.path for one in left}
    return sorted((a for a in kept.values() if a.path not in out), key=lambda one: one.participant), left


def _listed(paths):
    for path in map(Path, paths):
        yield from sorted(path.glob("*.json")) if path.is_dir() else [path]


def _json(path):
    try:
        if path.stat().st_size > LARGEST and path.name != "study.json":
            raise CospeechError(f"{path}: is larger than any file of answers")
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CospeechError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise CospeechError(f"{path}: is not whole JSON") from error
    if not isinstance(found, dict):
        raise CospeechError(f"{path}: expected keys and values")
    return found


# ------------------------------------------------------------------------------------------------------ one whole file


def read_file(study, path):
    """Answers of one file; CospeechError in one line where it is not what this study's page has written."""
    path = Path(path)
    file = _json(path)
    if file.get("schema") != SCHEMA or file.get("version") != VERSION:
        raise CospeechError(f"{path}: is no file of answers")
    if file.get("study") != study["id"]:
        raise CospeechError(f"{path}: answers of study {str(file.get('study'))[:40]!r}; this is {study['id']!r}")
    if file.pop("checksum", None) != checksum(file):
        raise CospeechError(f"{path}: was edited after it was saved (its checksum differs)")
    code, items = file.get("participant"), file.get("answers")
    if not (isinstance(code, str) and CODE.fullmatch(code) and isinstance(items, list)):
        raise CospeechError(f"{path}: has no participant or no answers")
    judged = study["items"] + study["checks"] + study.get("examples", 0)
    if file.get("complete") is not True or len(items) != judged:
        raise CospeechError(f"{path}: half-filled, {len(items)} of {judged} answered")
    known = {one["id"]: one for one in study["stimuli"]}
    for number, item in enumerate(items, 1):
        wrong = _wrong(study, known, item)
        if wrong:
            raise CospeechError(f"{path}: item {number}: {wrong}")
    seen = Counter(
        frozenset(known[one]["condition"] for one in item["stimuli"])
        for item in items
        if item["kind"] in ("rating", "pair")
    )
    if seen.total() != study["items"] or set(seen.values()) != {study["tracks"]}:
        raise CospeechError(f"{path}: its clips are not those of one participant")
    return Answers(code, str(path), str(file.get("finished", "")), items)


def checksum(file):
    """CRC-32 of the file's JSON as its page wrote it, without its checksum: it tells of slips, it is no signature."""
    text = json.dumps({k: v for k, v in file.items() if k != "checksum"}, ensure_ascii=False, separators=(",", ":"))
    return f"{zlib.crc32(text.encode('utf-8', 'replace')):08x}"


def _wrong(study, known, item):
    """What is wrong with one answer, or None."""
    pairs = study["kind"] == "pairs"
    kind = item.get("kind") if isinstance(item, dict) else None
    if kind not in ("example", "check", "pair" if pairs else "rating"):
        return "is of no known kind"
    stimuli = item.get("stimuli")
    if not isinstance(stimuli, list) or len(stimuli) != (2 if pairs and kind != "example" else 1):
        return "names no clip"
    if any(not isinstance(one, str) or one not in known for one in stimuli):
        return "a clip that this study does not have"
    values = item.get("values")
    if not isinstance(values, dict) or values.keys() != (set() if kind == "example" else study["questions"].keys()):
        return "its questions are not those of the study"
    for key, value in [*values.items(), *([("expected", item.get("expected"))] if kind == "check" else [])]:
        if not (value in CHOICES if pairs else type(value) is int and 1 <= value <= study["points"]):
            return f"{key} is {value!r}, off the scale"
    times = item.get("ms")
    if not isinstance(times, dict) or any(type(times.get(k)) is not int for k in ("play", "ended", "answered")):
        return "has no times"
    length = sum(known[one]["seconds"] for one in stimuli)
    if times["ended"] - times["play"] < WATCHED * 1000 * length or times["answered"] < times["ended"]:
        return f"answered before its {length:g} s were played"
    return None
