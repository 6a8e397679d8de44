"""Config, subject and budget files, read and checked before any job runs; every mistake is one line."""

import os
import sys
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from place import DEFAULT, elsewhere
from video_takes import film_takes

from cospeech.commands.schema import check_schema, config_schema
from cospeech.commands.schema import read_mapping as read_yaml
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.gestures.generator import find
from cospeech.split import PARTS, split_clips

SCHEMAS = Path(__file__).parent / "schemas"
SHARES = {"train": 0.8, "val": 0.1, "test": 0.1, "by": "take"}


ON_FILM = "{}_on_film"  # what is made of a subject's films is another subject


@dataclass(frozen=True)
class Subject:
    """One speaker: `source` as in the subject file, `split` = the shares and `by`.

    For films: `tracker` = its name and files, `absent` = {take: why it is left out}, `played_by` = the demo speaker who
    is seen in them.
    """

    name: str
    source: dict
    split: dict
    seed: int
    tracker: dict = field(default_factory=dict)
    absent: dict = field(default_factory=dict)
    played_by: str = ""

    @cached_property
    def takes(self):
        """{take id: its entry in the subject file}; the demo speaker's takes are only numbered."""
        if self.source["kind"] == "demo":
            count = self.source["takes"]
            return {f"take{number:0{len(str(max(count, 10)))}d}": {} for number in range(1, count + 1)}
        return {take["id"]: take for take in self.source["takes"]}

    @property
    def shares(self):
        return {part: self.split[part] for part in PARTS if part in self.split}

    @cached_property
    def split_of_equals(self):
        """The split if all takes were equally long. It decides which takes belong to which part, so that the graph of
        jobs is known before the first recording is read; `split_clips` then finds the frames.
        """
        given = {take: entry.get("part") for take, entry in self.takes.items()}
        with warnings.catch_warnings(action="ignore", category=CospeechNotice):  # the split job says it again
            return split_clips(dict.fromkeys(self.takes, 1000), given, self.shares, self.split["by"], self.seed)

    def takes_of(self, *parts):
        """Ids of the takes that have frames in one of these parts, in order."""
        return sorted({take for part in parts for take, _, _ in self.split_of_equals.of(part)})

    @property
    def filmed(self):
        """Ids of the takes that have a film: all of a speaker on film, a virtual speaker's first few."""
        films = self.source.get("film", {}).get("takes", 0)
        return list(self.takes)[: None if self.source["kind"] == "video" else films]

    @property
    def parts(self):
        """{take id: its part}, or None for a take that is cut in time."""
        found = {take: [part for part in PARTS if take in self.takes_of(part)] for take in self.takes}
        return {take: parts[0] if len(parts) == 1 else None for take, parts in found.items()}


def on_film(subjects, results):
    """{name: Subject} of the films of virtual speakers, which capture sees as it sees anyone's: the first takes of
    those whose source has `film`, each with a film under the results."""
    films = {}
    for name, subject in subjects.items():
        if asked := subject.source.get("film"):
            seen = ON_FILM.format(name)
            media, takes = Path(results) / seen / "media", list(subject.takes)[: asked["takes"]]
            takes = [{"id": take, "film": str(media / f"{take}.mp4")} for take in takes]
            source = {"kind": "video", "takes": takes, "domain": asked["domain"]}
            split = subject.split | {"by": "take"}
            films[seen] = Subject(seen, source, split, subject.seed, subject.tracker, played_by=name)
    return films


def load_configuration(config, workflow):
    """`read_configuration` of a running workflow; a mistake is printed as one line and ends it with status 2."""
    files = dict.fromkeys([*workflow.overwrite_configfiles, *workflow.configfiles])
    files = [os.path.relpath(file) if Path.cwd() in Path(file).parents else str(file) for file in files]
    label = " + ".join(files)
    try:
        lacks = [key for key in read_yaml(SCHEMAS / "config.schema.yaml")["required"] if key not in config]
        if lacks and not DEFAULT.is_file():
            raise CospeechError(f"{label}: key {lacks[0]!r} is missing; {elsewhere(workflow.basedir, ' '.join(files))}")
        subjects, budget = read_configuration(config, label or "config", workflow.basedir)
        for line in [line for subject in subjects.values() for line in subject.absent.values()]:
            print(f"note: {line}; left out", file=sys.stderr)
        return subjects, budget
    except CospeechError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def read_configuration(config, label, home):
    """Check the merged configuration and everything it names.

    Parameters
    ----------
    config : dict, as Snakemake merged it. label : name of the file(s) it came from, for messages.
    home : folder of the Snakefile; names of subjects and budgets are looked up in its config/.

    Returns ({name: Subject}, budget dict); raises CospeechError that names file, key and remedy.
    """
    check(config, "config", label)
    config.setdefault("synthesis", [])
    subjects = {}
    for entry in config["subjects"]:
        path = _locate(entry, Path(home) / "config" / "subjects", f"{label}: subjects")
        subject = read_subject(path, config["seed"], config["results_dir"])
        if subject.name in subjects:
            raise CospeechError(f"{path}: name {subject.name!r} is taken by another subject; give it its own")
        subjects[subject.name] = subject
    _check_synthesis(config, subjects, label)
    _check_posenet(config.get("posenet", {}), label)
    _check_ensemble(config.get("ensemble"), subjects, config["fps"], label)
    path = _locate(config["budget"], Path(home) / "config" / "budgets", f"{label}: budget")
    budget = read_yaml(path)
    check(budget, "budget", path)
    return subjects, budget


def read_subject(path, seed=0, results="results"):
    """The Subject of a subject file, after checking keys, names, times and that every file it names exists."""
    content = read_yaml(path)
    check(content, "subject", path)
    source, tracker, absent = content["source"], {}, {}
    if source["kind"] == "video" or "film" in source:
        tracker = _tracker_of(content, path)
    if source["kind"] == "video":
        takes, absent = film_takes(source, Path(results) / content["name"] / "media", path)
        source = source | {"takes": takes}
    subject = Subject(content["name"], source, SHARES | content.get("split", {}), seed, tracker, absent)
    if subject.source["kind"] != "demo":
        _check_takes(subject.source["takes"], path)
    try:
        subject.takes_of("test")
    except CospeechError as error:
        raise CospeechError(f"{path}: {error}") from error
    return subject


def _tracker_of(content, path):
    """{name, manifest, model, folder} of a subject of films."""
    keys = ("manifest", "model", "folder", "body_model", "face_model")
    tracker = {key: content[key] for key in keys if key in content}
    name = content.get("tracker", "mediapipe")
    for key, owner in {"manifest": "onnx", "model": "onnx", "folder": "tracks", "body_model": "tracks"}.items():
        if key in tracker and name != owner:
            raise CospeechError(f"{path}: {key} belongs to tracker {owner}, not to {name}")
    for needs, key in (("onnx", "manifest"), ("tracks", "folder")):
        if name == needs and key not in tracker:
            raise CospeechError(f"{path}: tracker {name} needs key {key!r}")
    return {"name": name} | tracker


def _check_takes(takes, path):
    seen = set()
    for take in takes:
        if take["id"] in seen:
            raise CospeechError(f"{path}: take id {take['id']!r} is there twice; ids name files, so give each its own")
        seen.add(take["id"])
        if take.get("end", float("inf")) <= take.get("start", 0):
            raise CospeechError(f"{path}: take {take['id']!r} ends at {take['end']} s, not after its start")
        for key in ("motion", "audio", "clip", "words"):
            if key in take and not Path(take[key]).is_file():
                raise CospeechError(f"{path}: take {take['id']!r}: {key}: {take[key]}: no such file")
        _check_braces(f"{path}: take {take['id']!r}", take.get("film", ""))


def _check_braces(where, path):
    """Of paths that the schemas do not see, or not alone."""
    if set("{}") & set(path):
        raise CospeechError(f"{where}: {path}: Snakemake takes braces for wildcards; rename it")


def _check_synthesis(config, subjects, label):
    seen = set()
    for entry in config["synthesis"]:
        where = f"{label}: synthesis: {entry['name']!r}"
        if entry["subject"] not in subjects:
            raise CospeechError(f"{where}: subject {entry['subject']!r} is not one of {', '.join(subjects)}")
        if entry["model"] not in config["models"]:
            raise CospeechError(f"{where}: model {entry['model']!r} is not one of {', '.join(config['models'])}")
        if "k" in entry and "k" not in find(entry["model"]).options:
            raise CospeechError(f"{where}: k chooses among matches, which {entry['model']} has none of; leave it out")
        named = {key: entry[key] for key in ("audio", "words", "gestures") if key in entry}
        named |= {f"replace[{i}].clip": one["clip"] for i, one in enumerate(entry.get("replace", []))}
        for key, file in named.items():
            if not Path(file).is_file():
                raise CospeechError(f"{where}: {key}: {file}: no such file")
            _check_braces(f"{where}: {key}", file)
        result = entry["subject"], entry["model"], entry["name"]
        if result in seen or entry["name"] in subjects[entry["subject"]].takes:
            raise CospeechError(f"{where}: the name is taken by another entry or a take; results would collide")
        seen.add(result)


def _check_posenet(posenet, label):
    named = {"imagenet": [posenet["imagenet"]] if posenet.get("imagenet") else []}
    for part, uses in posenet.get("data", {}).items():
        named |= {f"data.{part}.{use}": paths for use, paths in uses.items()}
    for key, paths in named.items():
        for path in paths:
            if not Path(path).is_file():
                raise CospeechError(f"{label}: posenet.{key}: {path}: no such file")


def _check_ensemble(ensemble, subjects, fps, label):
    if not ensemble:
        return
    where, speakers, held_out = f"{label}: ensemble", ensemble["speakers"], ensemble.get("held_out", [])
    if ensemble["name"] in subjects:
        raise CospeechError(f"{where}: name {ensemble['name']!r} is a subject's; results would collide")
    for key, names, known in (("speakers", speakers, subjects), ("held_out", held_out, speakers)):
        unknown = [name for name in names if name not in known]
        if unknown:
            raise CospeechError(f"{where}.{key}: {unknown[0]!r} is not one of {', '.join(known)}")
    if set(held_out) == set(speakers):
        raise CospeechError(f"{where}.held_out: all speakers are held out; leave one to learn from")
    embeddings = ensemble.get("embeddings")
    if embeddings and not Path(embeddings).is_file():
        raise CospeechError(f"{where}.embeddings: {embeddings}: no such file")
    _check_identity(ensemble, subjects, where)
    if fps != 15:
        raise CospeechError(f"{label}: fps: {fps:g}: HA2G's windows of 34 frames and 70 columns are for 15 fps")


def _check_identity(ensemble, subjects, where):
    """Where speakers are known by reference frames, all of them need a film of a training take."""
    by_frames, imagenet = ensemble.get("identity") == "frames", ensemble.get("imagenet")
    if imagenet and not by_frames:
        raise CospeechError(f"{where}.imagenet: is for identity: frames alone; set that, or leave imagenet out")
    if imagenet and not Path(imagenet).is_file():
        raise CospeechError(f"{where}.imagenet: {imagenet}: no such file")
    for name in ensemble["speakers"] if by_frames else ():
        subject = subjects[name]
        if not set(subject.filmed) & set(subject.takes_of("train")):
            lacks = "no filmed take in the training part" if subject.filmed else "no film"
            raise CospeechError(
                f"{where}.identity: frames: speaker {name!r} (kind: {subject.source['kind']}) has {lacks}; give one, "
                f"leave {name!r} out of speakers, or set identity: speaker"
            )


def _locate(entry, folder, where):
    """A name of a file in `folder`, or a path that ends in .yaml or .yml."""
    path = Path(entry)
    if path.suffix in (".yaml", ".yml"):
        if not path.is_file():
            raise CospeechError(f"{where}: {entry}: no such file")
        return path
    known = sorted(file.stem for file in folder.glob("*.yaml"))
    if entry not in known:
        raise CospeechError(f"{where}: {entry!r} is neither one of {', '.join(known)} nor the path of a .yaml file")
    return folder / f"{entry}.yaml"


def schema_of(name):
    """schemas/<name>.schema.yaml; that of the configuration with the library's models."""
    return config_schema() if name == "config" else read_yaml(SCHEMAS / f"{name}.schema.yaml")


def check(content, schema, where):
    """CospeechError with one line on the worst mistake, unless `content` fits schemas/<schema>.schema.yaml."""
    check_schema(content, schema_of(schema), where)
