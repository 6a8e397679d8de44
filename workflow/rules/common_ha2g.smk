# The ensemble, the rows of its tables, and the input functions of their rules (ha2g.smk, ha2g_tables.smk).

ENSEMBLE = {"name": "everyone", "speakers": [], "held_out": [], "levels": "expressive43", "identity": "speaker", "imagenet": "",
            "models": [], "seeds": [config["seed"]], "embeddings": "", "filters": {}} | config.get("ensemble", {})  # fmt: skip
BY_FRAMES = ENSEMBLE["identity"] == "frames"  # what ha2g and its ablations know the speakers by; the others never do
FILMED = [name for name, subject in SUBJECTS.items() if set(subject.filmed) & set(subject.takes_of("train"))]
# Rows of Tables 3 and 4 of the publication, and one of our own, `words`: what they change in the budget's section `ha2g`.
HA2G_ABLATIONS = {
    "low_only": {"audio_levels": ["low"]},
    "mid_only": {"audio_levels": ["mid"]},
    "high_only": {"audio_levels": ["high"]},
    "no_in_level_negatives": {"in_level_negatives": False},
    "no_cross_level_negatives": {"cross_level_negatives": False},
    "no_text": {"text": False},
    "words": {"text_input": True},
    "holistic": {"pose_hierarchy": "none"},
    "no_hand_hierarchy": {"pose_hierarchy": "body"},
    "no_body_hierarchy": {"pose_hierarchy": "hands"},
    "same_audio": {"same_audio": True},
    "no_physical": {"weights": {"physical": 0.0}},
}
SHARED_MODELS = ["ha2g", "trimodal", "seq2seq", "speech2gesture", "joint_embedding"]
RULERS = ("expressive", "expressive_compat", "trimodal", "trimodal_compat")
HA2G_BASELINES = ("ground_truth", "mismatched", "shuffled", "mean_pose")
HA2G_LABELS = {
    "seq2seq": "Seq2Seq",
    "speech2gesture": "Speech2Gesture",
    "joint_embedding": "Joint Embedding",
    "trimodal": "Trimodal",
    "ha2g": "HA2G",
}
OWN_MODELS = [model for model in MODELS if model not in DRAWN]  # each trained on one speaker alone
# Table: its rows, and what the publication calls them.
HA2G_TABLES = {
    "ha2g_table_1": {row: row for row in HA2G_BASELINES}
    | {row: label for row, label in HA2G_LABELS.items() if row in ENSEMBLE["models"]}
    | {model: model for model in OWN_MODELS},
    "ha2g_table_3": {
        "low_only": "Low-level audio only",
        "mid_only": "Mid-level audio only",
        "high_only": "High-level audio only",
        "no_in_level_negatives": "Without negatives of other times and clips",
        "no_cross_level_negatives": "Without negatives of low and mid level",
        "no_text": "Without text",
        "words": "Hearing words when generating",
        "ha2g": "HA2G",
    },
    "ha2g_table_4": {
        "holistic": "Holistic",
        "no_hand_hierarchy": "Without hand hierarchy",
        "no_body_hierarchy": "Without body hierarchy",
        "same_audio": "Same audio for every level",
        "no_physical": "Without physical loss",
        "ha2g": "HA2G",
    },
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
    if wildcards.shared in ("ha2g", *HA2G_ABLATIONS) and frames_of(*ENSEMBLE["held_out"]):
        network = "<results>/{ensemble}/models/{shared}_{seed}/identity.onnx"
        return {"identity": network.format(**wildcards), "frames": frames_of(*ENSEMBLE["held_out"])}
    return {}


def shared_settings(wildcards):
    """The budget's section for a row; an ablation's is that of ha2g with what it changes."""
    if wildcards.shared in SHARED_MODELS:
        return BUDGET.get(wildcards.shared, {})
    section, changes = BUDGET.get("ha2g", {}), HA2G_ABLATIONS[wildcards.shared]
    weights = section.get("weights", {}) | changes.get("weights", {})
    return section | changes | ({"weights": weights} if weights else {})


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
