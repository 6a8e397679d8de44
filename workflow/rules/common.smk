# What every stage shares: the checked configuration, the speakers, and the lists of files that a whole run makes.

import sys
from itertools import zip_longest
from pathlib import Path

sys.path.insert(0, str(Path(workflow.basedir) / "workflow"))

from configuration import load_configuration, on_film
from digest import library_code
from place import check_files
from restart import forgive_killed_run
from video_takes import precomputed_of

from cospeech.gestures.generator import find, named, settings_for

check_files(workflow)


configfile: "config/config.yaml"


forgive_killed_run(workflow)

SUBJECTS, BUDGET = load_configuration(config, workflow)
FILMS = on_film(SUBJECTS, config["results_dir"])  # of virtual speakers; they become clips and no more (films.smk)
SPEAKERS = SUBJECTS | FILMS
MODELS = config["models"]
TRAINED = [model for model in MODELS if find(model).task]
SEARCHING = named(needs="database")
ROWS = ["ground_truth", "mismatched", "mean_pose", *MODELS]  # of every table; the first three are no models
KNOWN = "|".join(named(learns="speaker"))
SHOWN = f"ground_truth|{KNOWN}"  # wildcard constraint: whose motion lies under synthesis/
SEEDS = config.get("chapter4", {}).get("seeds", [0, 1, 2])  # of the tables that have a deviation over seeds
POSENET = {"parts": [], "data": {}, "imagenet": "", "seeds": [0, 1, 2]} | config.get("posenet", {})
PART = "<results>/posenet/{part}"
SYNTHESES = {(e["subject"], e["model"], e["name"]): e for e in config["synthesis"]}


pathvars:
    results=config["results_dir"],
    logs="<results>/logs",
    benchmarks="<results>/benchmarks",


wildcard_constraints:
    subject="[A-Za-z0-9_-]+",
    clip="[A-Za-z0-9_-]+",
    model=KNOWN,


def of_kind(kind):
    """Wildcard constraint: the subjects whose source is of this kind (a pattern that nothing matches if there are none)."""
    return "|".join(name for name, subject in SPEAKERS.items() if subject.source["kind"] == kind) or "(?!)"


def take_of(wildcards):
    """The take's entry in its subject file."""
    return SPEAKERS[wildcards.subject].takes[wildcards.clip]


def clips_of(*parts):
    """Input function: the clips of a subject that have frames in one of these parts (in any part without)."""

    def clips(wildcards):
        subject = SUBJECTS[wildcards.subject]
        takes = subject.takes_of(*parts) if parts else list(subject.takes)
        return [f"<results>/{subject.name}/clips/{take}.h5" for take in takes]

    return clips


def all_models():
    return [f"<results>/{name}/models/{model}/weights.safetensors" for name in SUBJECTS for model in TRAINED]


def all_histories():
    networks = [f"<results>/{name}/models/{model}/history.h5" for name in SUBJECTS for model in TRAINED]
    networks += [f"<results>/posenet/{part}/history.h5" for part in config.get("posenet", {}).get("parts", [])]
    return networks + [f"<results>/{name}/evaluation/feature_net_history.h5" for name in SUBJECTS]


def synthesized(subject, model, suffix="h5"):
    """Of a subject's test part: what a model made of its speech, or the truth itself for ground_truth."""
    return [f"<results>/{subject}/synthesis/{model}/{clip}.{suffix}" for clip in SUBJECTS[subject].takes_of("test")]


def all_syntheses():
    """Every test clip and every `synthesis:` entry, in every format."""
    return [film.removesuffix("mp4") + suffix for film in all_films() for suffix in ("h5", "bvh", "glb", "mp4")]


def all_films():
    """Those of `synthesis:` entries, every model's first test clip, the second ones...: the report shows the first few."""
    asked = [f"<results>/{subject}/synthesis/{model}/{name}.mp4" for subject, model, name in SYNTHESES]
    tested = [synthesized(s, model, "mp4") for s in SUBJECTS for model in ["ground_truth", *MODELS]]
    return asked + [film for films in zip_longest(*tested) for film in films if film]


def generator_of(wildcards):
    """Input function: what a model generates from."""
    folder = f"<results>/{wildcards.subject}"
    model = find(wildcards.model)
    files = {"network": f"{folder}/models/{wildcards.model}/model.onnx"} if model.task else {}
    if "clips" in model.needs:
        files |= {"split": f"{folder}/split.h5", "clips": clips_of("train")(wildcards)}
    named_files = {"database": "database.h5", "audio_rank": "models/audio_rank/weights.safetensors"}
    return files | {need: f"{folder}/{file}" for need, file in named_files.items() if need in model.needs}


def speech_of(wildcards):
    """Input function: the sound to generate for, and for a test clip the truth, which knows the words."""
    entry = SYNTHESES.get((wildcards.subject, wildcards.model, wildcards.clip))
    if entry:
        files = [entry[key] for key in ("words", "gestures") if key in entry]
        return {"audio": entry["audio"], "asked": files + [one["clip"] for one in entry.get("replace", [])]}
    truth = f"<results>/{wildcards.subject}/synthesis/ground_truth/{wildcards.clip}"
    return {"audio": f"{truth}.wav", "truth": f"{truth}.h5"}


def options_of(wildcards):
    """What a `synthesis:` entry asks of the generator; test clips are made with the config's seed alone."""
    entry = SYNTHESES.get((wildcards.subject, wildcards.model, wildcards.clip), {})
    told = ("name", "subject", "audio", "model", "words", "recognize")
    return {"seed": config["seed"]} | {key: value for key, value in entry.items() if key not in told}


def words_of(wildcards):
    """Where a `synthesis:` entry has its words from, if not from beside its sound."""
    entry = SYNTHESES.get((wildcards.subject, wildcards.model, wildcards.clip), {})
    return {"words": entry.get("words"), "recognize": entry.get("recognize", False)}


def truth_beside(wildcards):
    """Input function: the recorded clip to show beside a generated one; none for `synthesis:` entries."""
    if wildcards.model == "ground_truth" or (wildcards.subject, wildcards.model, wildcards.clip) in SYNTHESES:
        return []
    return [f"<results>/{wildcards.subject}/synthesis/ground_truth/{wildcards.clip}.h5"]


def on_video():
    """{name: Subject} of those who are known from films."""
    return {name: subject for name, subject in SPEAKERS.items() if subject.source["kind"] == "video"}


def tracked_by(tracker):
    """Wildcard constraint: the subjects of films that this tracker sees."""
    return "|".join(name for name, s in on_video().items() if s.tracker["name"] == tracker) or "(?!)"


def film_of(wildcards):
    """Input function: the film of a take."""
    return take_of(wildcards)["film"]


def tracker_file(key):
    """Input function: a file or folder that the subject's tracker reads."""
    return lambda w: SPEAKERS[w.subject].tracker[key]


def posenet_files(name):
    """One file of each of our own pose networks, the body's first."""
    parts = {"body": None} | dict.fromkeys(config.get("posenet", {}).get("parts", []))
    return [f"<results>/posenet/{part}/{name}" for part in parts]


def fetched():
    """Wildcard constraint: the takes whose film is fetched under their name."""
    takes = [t for s in on_video().values() for t in s.takes.values() if "url" in t]
    return "|".join({Path(take["film"]).stem for take in takes}) or "(?!)"


def people_of(use):
    """Input function: files of people to train with or to test on; the config's own, or else synthetic ones."""

    def people(wildcards):
        return POSENET["data"].get(wildcards.part, {}).get(use, [f"{PART}/people/{use}.h5"])

    return people


def posenet_settings(*sections):
    """A training's keys of the budget, later sections over earlier ones; a section that is not there changes nothing."""
    settings = {"threads": BUDGET["threads"]}
    for section in sections:
        settings |= BUDGET.get(section, {})
    return settings


def all_posenets():
    files = ("weights.safetensors", "model.onnx", "manifest.yaml", "history.h5", "evaluation.h5")
    return [f"<results>/posenet/{part}/{name}" for part in POSENET["parts"] for name in files]
