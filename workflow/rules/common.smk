# What every stage shares: the checked configuration, the speakers, and the lists of files that a whole run makes.

import sys
from itertools import zip_longest
from pathlib import Path

sys.path.insert(0, str(Path(workflow.basedir) / "workflow"))

from configuration import load_configuration
from digest import library_code
from restart import forgive_killed_run

forgive_killed_run(workflow)

SUBJECTS, BUDGET = load_configuration(config, workflow)
MODELS = config["models"]
TRAINED = [model for model in MODELS if model != "knn"]  # knn searches the database and has no weights
MATCHED = ("knn", "resync")
ROWS = ["ground_truth", "mismatched", "mean_pose", *MODELS]  # of every table; the first three are no models
SHOWN = "ground_truth|regression|gesture_gan|knn|resync"  # wildcard constraint: whose motion lies under synthesis/
SYNTHESES = {(e["subject"], e["model"], e["name"]): e for e in config["synthesis"]}


pathvars:
    results=config["results_dir"],
    logs="<results>/logs",
    benchmarks="<results>/benchmarks",


wildcard_constraints:
    subject="[A-Za-z0-9_-]+",
    clip="[A-Za-z0-9_-]+",
    model="regression|gesture_gan|knn|resync",


def of_kind(kind):
    """Wildcard constraint: the subjects whose source is of this kind (a pattern that nothing matches if there are none)."""
    return "|".join(name for name, subject in SUBJECTS.items() if subject.source["kind"] == kind) or "(?!)"


def take_of(wildcards):
    """The take's entry in its subject file."""
    return SUBJECTS[wildcards.subject].takes[wildcards.clip]


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
    files = {"network": f"{folder}/models/{wildcards.model}/model.onnx"} if wildcards.model in TRAINED else {}
    return files | ({"database": f"{folder}/database.h5"} if wildcards.model in MATCHED else {})


def speech_of(wildcards):
    """Input function: the sound to generate for, and for a test clip the truth, which knows the words."""
    entry = SYNTHESES.get((wildcards.subject, wildcards.model, wildcards.clip))
    if entry:
        return {"audio": entry["audio"]}
    truth = f"<results>/{wildcards.subject}/synthesis/ground_truth/{wildcards.clip}"
    return {"audio": f"{truth}.wav", "truth": f"{truth}.h5"}


def options_of(wildcards):
    """What a `synthesis:` entry asks of the generator; test clips are made with the config's seed alone."""
    entry = SYNTHESES.get((wildcards.subject, wildcards.model, wildcards.clip), {})
    return {"seed": config["seed"]} | {key: entry[key] for key in ("k", "initial", "controls", "seed") if key in entry}


def truth_beside(wildcards):
    """Input function: the recorded clip to show beside a generated one; none for `synthesis:` entries."""
    if wildcards.model == "ground_truth" or (wildcards.subject, wildcards.model, wildcards.clip) in SYNTHESES:
        return []
    return [f"<results>/{wildcards.subject}/synthesis/ground_truth/{wildcards.clip}.h5"]
