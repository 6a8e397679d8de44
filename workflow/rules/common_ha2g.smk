# The ensemble, the rows of its tables, and the input functions of their rules (ha2g.smk, ha2g_tables.smk).

from cospeech.evaluation.baseline_rows import HA2G_BASELINES
from cospeech.evaluation.columns import NETS
from cospeech.gestures.generator import VARIANTS

ENSEMBLE = {"name": "everyone", "speakers": [], "held_out": [], "levels": "expressive43", "identity": "speaker", "imagenet": "",
            "models": [], "seeds": [config["seed"]], "embeddings": "", "filters": {}} | config.get("ensemble", {})  # fmt: skip
BY_FRAMES = ENSEMBLE["identity"] == "frames"  # what ha2g and its ablations know the speakers by; the others never do
FILMED = [name for name, subject in SUBJECTS.items() if set(subject.filmed) & set(subject.takes_of("train"))]
SHARED_MODELS = named(learns="speakers")
HA2G_ABLATIONS = [row for row, model in VARIANTS.items() if model.of == "ha2g"]
HA2G_LABELS = {row: find(row).label for row in [*SHARED_MODELS, *HA2G_ABLATIONS]}
OWN_MODELS = [model for model in MODELS if "clips" not in find(model).needs]  # each trained on one speaker alone
TABLE_1 = ("seq2seq", "speech2gesture", "joint_embedding", "trimodal", "ha2g")
TABLE_4 = ("holistic", "no_hand_hierarchy", "no_body_hierarchy", "same_audio", "no_physical")
# Table: its rows, and what the publication calls them.
HA2G_TABLES = {
    "ha2g_table_1": {row: row for row in HA2G_BASELINES}
    | {row: HA2G_LABELS[row] for row in TABLE_1 if row in ENSEMBLE["models"]}
    | {model: model for model in OWN_MODELS},
    "ha2g_table_3": {row: HA2G_LABELS[row] for row in [*HA2G_ABLATIONS, "ha2g"] if row not in TABLE_4},
    "ha2g_table_4": {row: HA2G_LABELS[row] for row in [*TABLE_4, "ha2g"]},
}
ENSEMBLE_FOLDER = f"<results>/{ENSEMBLE['name']}"


def ensemble_files(file, part="train"):
    """A file of every speaker of the ensemble; with {clip} in its name, of every clip of theirs in that part."""
    speakers = [name for name in ENSEMBLE["speakers"] if part == "test" or name not in ENSEMBLE["held_out"]]
    clips = {name: SUBJECTS[name].takes_of(part) if "{clip}" in file else [""] for name in speakers}
    return [file.format(subject=name, clip=clip) for name in speakers for clip in clips[name]]


def shared_syntheses(*rows, seeds=None):
    """Every test clip of every speaker by these rows, for every seed."""
    folder = f"<results>/{ENSEMBLE['name']}/synthesis"
    names = [f"{row}_{seed}" for row in rows for seed in (ENSEMBLE["seeds"] if seeds is None else seeds)]
    return [file for name in names for file in ensemble_files(f"{folder}/{name}/{{subject}}/{{clip}}.h5", "test")]


def frames_of(*names):
    """The files of some speakers' reference frames, where those are what they are known by."""
    return [f"<results>/{name}/reference_frames.h5" for name in names if BY_FRAMES]


def films_of(wildcards):
    """Input function: films and tracks of a speaker's training takes; a virtual speaker's belong to another subject."""
    subject = SUBJECTS[wildcards.filmed]
    seen = next((film for film in FILMS.values() if film.played_by == subject.name), subject)
    takes = [take for take in subject.takes_of("train") if take in subject.filmed]
    return {
        "films": [seen.takes[take]["film"] for take in takes],
        "tracks": [f"<results>/{seen.name}/tracks/{take}.h5" for take in takes],
    }


def strangers_of(wildcards):
    """Input function: what shows a network the speakers whom it has not learned from."""
    if wildcards.model in ("ha2g", *HA2G_ABLATIONS) and frames_of(*ENSEMBLE["held_out"]):
        network = "<results>/{ensemble}/models/{model}_{seed}/identity.onnx"
        return {"identity": network.format(**wildcards), "frames": frames_of(*ENSEMBLE["held_out"])}
    return {}


def styles(wildcards):
    """Whose manner a network takes for each speaker: the speaker's own as far as it can know it, or a drawn one."""
    frames = strangers_of(wildcards).get("frames", [])
    drawn = {name: "random" for name in ENSEMBLE["held_out"]}
    return {name: name for name in ENSEMBLE["speakers"]} | drawn | {Path(file).parent.name: file for file in frames}


def judged(*tables):
    """The evaluation files behind some tables."""
    rows = [row for table in tables for row in HA2G_TABLES[table] if row not in HA2G_BASELINES]
    return [f"{ENSEMBLE_FOLDER}/judged/{row}.h5" for row in dict.fromkeys(["baselines", *rows])]


def made_by(wildcards):
    """Input function: all test clips by a row, of every seed; none for the baselines."""
    if wildcards.judged == "baselines":
        return []
    if wildcards.judged in OWN_MODELS:
        return ensemble_files(f"<results>/{{subject}}/synthesis/{wildcards.judged}/{{clip}}.h5", "test")
    return shared_syntheses(wildcards.judged)
