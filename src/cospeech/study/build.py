"""A study as a folder: index.html that opens from disk, the clips that it shows, and study.json, which knows them."""

import json
import re
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from html import escape
from importlib.resources import files
from pathlib import Path

from tqdm import tqdm

from cospeech import __version__
from cospeech.errors import CospeechError, notice
from cospeech.files import writing
from cospeech.render.pages.player_page import embedded, player_data, player_script
from cospeech.study.answers import read_study
from cospeech.study.stimuli import OWN, TRUTH, cut

SCHEMA, VERSION = "cospeech.study", 1
KINDS = ("rating", "pairs")
# The two prompts of thesis section 5.4, word by word; chapter 4 asks for the same two things and prints no wording.
PROMPTS = {
    "naturalness": "Does the clip appear natural and the gesture follows the speaking style of the speaker?",
    "synchrony": "Are the gesture and the audio well synchronized?",
}
PREFERENCES = {"naturalness": "Which clip moves more naturally?", "synchrony": "Which clip fits the speech better?"}
ENDS = {5: ("least plausible", "most plausible"), 7: ("lowest", "highest")}  # sections 4.5.2 and 5.4
# What the thesis did, as options of `cospeech study build`.
PUBLISHED = {
    "4.1": {"seconds": 12.0, "points": 5, "tracks": 3, "excerpts": 6, "examples": 0, "face": OWN},
    "4.2": {"seconds": 12.0, "points": 5, "tracks": 3, "excerpts": 6, "examples": 0, "face": "gesture_gan"},
    "5.2": {"seconds": 24.0, "points": 7, "tracks": 1, "excerpts": 6, "examples": 2, "face": TRUTH},
    "5.4": {"seconds": 24.0, "points": 7, "tracks": 2, "excerpts": 15, "examples": 2, "face": TRUTH},
}
ITEM_SECONDS = 12  # what a participant takes for an answer, for the estimate on the first page
WELCOME = "You will see short clips of a character who speaks and moves its body, hands and face. "
TASKS = {
    "rating": "After each clip you are asked to rate it.",
    "pairs": "They come in pairs with the same speech. After each pair you are asked to choose one of the two.",
}
FACE = " Please judge the gestures of body and hands, and ignore how good the expression of the face is."
CONSENT = "I am 18 or older, I take part of my own will and may stop at any time, and I agree that my answers are used."


@dataclass(frozen=True)
class Design:
    """How a study is run.

    kind : "rating" of one clip on `points` (5 or 7), or "pairs": which of two, with "no difference" if `ties`.
    tracks : how many tracks a participant gets; each condition is seen, or each pair compared, once on each.
    checks : attention checks; None is one for every ten items, at least one. examples : clips of the truth shown first.
    questions : {key: text}; empty for the published ones.
    """

    kind: str = "rating"
    points: int = 5
    tracks: int = 3
    checks: int | None = None
    examples: int = 0
    ties: bool = False
    seed: int = 0
    title: str = "Speech and gesture"
    instructions: str = ""
    consent: str = CONSENT
    questions: dict = field(default_factory=dict)


def settle(asked, like=None):
    """({seconds, excerpts, face} of `from_results`, Design) of what was asked for, by name.

    What was not, or is None, is as in the study of the thesis's table `like`, or else as in `Design`, with 12 s long
    excerpts, six a subject, who all wear the recorded face; pairs come on one track. CospeechError for what cannot be.
    """
    told = {key: value for key, value in asked.items() if value is not None}
    if like is not None and like not in PUBLISHED:
        raise CospeechError(f"study: like {like!r}; known tables: {', '.join(PUBLISHED)}")
    chosen = {"seconds": 12.0, "excerpts": 6, "face": TRUTH} | PUBLISHED.get(like, {}) | told
    if chosen.get("kind") == "pairs":
        chosen = {"tracks": 1} | chosen
    known = {"seconds", "excerpts", "face", *Design.__dataclass_fields__}
    for key in chosen.keys() - known:
        raise CospeechError(f"study: unknown setting {key!r}; known: like, {', '.join(sorted(known))}")
    for key, least in (("seconds", 0.5), ("excerpts", 1), ("tracks", 1), ("examples", 0), ("checks", 0)):
        number, kinds = chosen.get(key, least), (int, float) if key == "seconds" else int
        if isinstance(number, bool) or not isinstance(number, kinds) or not number >= least:
            raise CospeechError(f"study: {key} is {number!r}; expected {least:g} or more")
    return {key: chosen.pop(key) for key in ("seconds", "excerpts", "face")}, Design(**chosen)


def build_study(folder, stimuli, design):
    """Write a study into `folder` and return its description, the content of study.json.

    Parameters
    ----------
    folder : new, empty, or that of a study, which is replaced (with a notice if it was another).
    stimuli : list of Stimulus, one for every condition and track.

    Raises CospeechError when a condition lacks a track, or when `folder` holds anything else. Same input, same bytes.
    """
    folder, (conditions, tracks) = Path(folder), check_stimuli(stimuli)
    check_design(design, tracks)
    before = _clear(folder)
    listed, whole = [], sha256()
    for track, chosen in tqdm(tracks.items(), desc="study", unit="track", disable=None):
        ready = [cut(stimulus) for stimulus in chosen]
        text = embedded(player_data([("", clip) for clip, _ in ready], ready[0][1], subtitles=False))
        name = _digest(design.seed, track)
        with writing(folder / "clips" / f"{name}.js") as temporary:
            temporary.write_text(f'cospeechTrack("{name}", {text});\n', encoding="utf-8")
        whole.update(text.encode())
        for stimulus, (clip, _) in zip(chosen, ready, strict=True):
            name = _digest(design.seed, track, stimulus.condition)
            seconds = round(clip.duration, 3)
            listed.append({"id": name, "condition": stimulus.condition, "track": track, "seconds": seconds})
    study = _described(design, conditions, listed, all(stimulus.face == OWN for stimulus in stimuli))
    whole.update(json.dumps(study).encode())
    study = {"schema": SCHEMA, "version": VERSION, "id": whole.hexdigest()[:12]} | study
    study["sources"] = {
        _digest(design.seed, s.track, s.condition): {key: str(v) for key, v in asdict(s).items()} for s in stimuli
    }
    if before not in (None, study["id"]):
        notice(f"{folder}: study {before} was replaced by {study['id']}; answers to it can no longer be analysed here")
    _write_page(folder / "index.html", study, list(tracks))
    with writing(folder / "study.json") as temporary:
        temporary.write_text(json.dumps(study, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return study


def _digest(*parts):
    """A name that tells nothing: of a clip in the answers, of a file in the folder."""
    return sha256("/".join(map(str, parts)).encode()).hexdigest()[:12]


def check_stimuli(stimuli):
    """([condition, ...], {track: [Stimulus, ...]}), the latter in an order that does not tell the conditions.

    Raises CospeechError unless every condition has one clip on every track, all heard with the same sound.
    """
    conditions = list(dict.fromkeys(s.condition for s in stimuli))
    if len(conditions) < 2:
        raise CospeechError("study: one condition; give two or more to compare")
    tracks = {}
    for track in dict.fromkeys(s.track for s in stimuli):
        there = sorted((s for s in stimuli if s.track == track), key=lambda s: _digest(s.condition))
        for condition in conditions:
            count = sum(s.condition == condition for s in there)
            if count != 1:
                raise CospeechError(f"study: condition {condition!r} has {count} clips on track {track!r}; give one")
        if len({(s.audio, s.audio_start) for s in there}) > 1:
            raise CospeechError(f"study: track {track!r} has clips of different sounds; give those tracks of their own")
        tracks[track] = there
    return conditions, tracks


def check_design(design, tracks):
    """CospeechError for a Design that cannot be run on these tracks."""
    if design.kind not in KINDS or design.points not in ENDS:
        raise CospeechError(f"study: {design.kind} on {design.points} points; expected rating or pairs, 5 or 7 points")
    if not 1 <= design.tracks <= len(tracks):
        raise CospeechError(f"study: {design.tracks} tracks for each participant, but there are {len(tracks)}")
    for name in ("title", "instructions", "consent"):
        if not isinstance(getattr(design, name), str):
            raise CospeechError(f"study: {name}: expected text")
    told = design.questions if isinstance(design.questions, dict) else {"": None}
    for key, text in told.items():
        if not (isinstance(key, str) and key.isidentifier() and isinstance(text, str) and text):
            raise CospeechError("study: questions: expected short names (letters, digits, _), each with what is asked")


def _clear(folder):
    """Make room in a study's own folder; -> the study's id, or None. CospeechError for one that holds anything else."""
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if there and not there & {"study.json", "index.html", "clips"}:
        raise CospeechError(f"{folder}: is not empty and holds no study; choose a new folder")
    before = read_study(folder)["id"] if "study.json" in there else None
    for path in [folder / "study.json", folder / "index.html", *(folder / "clips").glob("*.js")]:
        path.unlink(missing_ok=True)
    return before


def _described(design, conditions, listed, own_faces):
    """What study.json holds, but for its id and where the clips are from."""
    rating, others = design.kind == "rating", len(listed) // len(conditions) - design.tracks
    items = design.tracks * (len(conditions) if rating else len(conditions) * (len(conditions) - 1) // 2)
    checks = max(1, round(items / 10)) if design.checks is None else design.checks
    examples = min(design.examples, others) if TRUTH in conditions else 0
    if examples < design.examples:
        notice(f"study: {examples} of {design.examples} examples; they are of the truth, on tracks not judged")
    texts = design.questions or (PROMPTS if rating else PREFERENCES)
    length = max(s["seconds"] for s in listed)
    minutes = ((items + checks) * ((1 if rating else 2) * length + ITEM_SECONDS) + examples * length) / 60
    return asdict(design) | {
        "instructions": design.instructions or WELCOME + TASKS[design.kind] + ("" if own_faces else FACE),
        "questions": texts,
        "ends": list(ENDS[design.points]),
        "checks": checks,
        "examples": examples,
        "items": items,
        "minutes": round(minutes, 1),
        "conditions": conditions,
        "stimuli": listed,
        "cospeech_version": __version__,
    }


def _write_page(path, study, tracks):
    """The page knows conditions by numbers only, so that its source does not tell who made what."""
    order = {name: i for i, name in enumerate(sorted(study["conditions"], key=_digest))}
    told = (
        "id",
        "title",
        "kind",
        "points",
        "ends",
        "tracks",
        "checks",
        "examples",
        "ties",
        "seed",
        "minutes",
        "instructions",
        "consent",
    )
    page = {key: study[key] for key in told} | {
        "questions": [{"key": key, "text": text} for key, text in study["questions"].items()],
        "conditions": len(order),
        "reference": order.get(TRUTH, -1) if study["examples"] else -1,
        "files": [_digest(study["seed"], track) for track in tracks],
        "stimuli": sorted([s["id"], order[s["condition"]], tracks.index(s["track"])] for s in study["stimuli"]),
    }
    room = files("cospeech.study")
    parts = {
        "TITLE": escape(study["title"]),
        "DATA": embedded(page),
        "PLAYER": player_script(),
        "SCRIPT": "".join((room / f"{name}.js").read_text("utf-8") for name in ("plan", "study")),
    }
    text = (room / "page.html").read_text("utf-8")
    text = re.sub("%(TITLE|DATA|PLAYER|SCRIPT)%", lambda place: parts[place[1]], text)
    with writing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
