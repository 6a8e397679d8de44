# HA2G, its baselines and its ablations, one network for all speakers of `ensemble:`: results/<ensemble>/.
# A network lies in models/<row>_<seed>/, what it makes of every speaker's test clips in synthesis/<row>_<seed>/<subject>/.

ENSEMBLE = {"name": "", "speakers": [], "held_out": [], "levels": "expressive43", "identity": "speaker", "imagenet": "",
            "models": [], "seeds": [config["seed"]], "embeddings": "", "filters": {}} | config.get("ensemble", {})  # fmt: skip
BY_FRAMES = ENSEMBLE["identity"] == "frames"  # what ha2g and its ablations know the speakers by; the others never do
FILMED = [name for name, subject in SUBJECTS.items() if set(subject.filmed) & set(subject.takes_of("train"))]
# Rows of Tables 3 and 4 of the publication: what they change in the budget's section `ha2g`.
HA2G_ABLATIONS = {
    "low_only": {"audio_levels": ["low"]},
    "mid_only": {"audio_levels": ["mid"]},
    "high_only": {"audio_levels": ["high"]},
    "no_in_level_negatives": {"in_level_negatives": False},
    "no_cross_level_negatives": {"cross_level_negatives": False},
    "no_text": {"text": False},
    "holistic": {"pose_hierarchy": "none"},
    "no_hand_hierarchy": {"pose_hierarchy": "body"},
    "no_body_hierarchy": {"pose_hierarchy": "hands"},
    "same_audio": {"same_audio": True},
    "no_physical": {"weights": {"physical": 0.0}},
}
SHARED_MODELS = ["ha2g", "trimodal", "seq2seq", "speech2gesture", "joint_embedding"]


wildcard_constraints:
    ensemble=ENSEMBLE["name"] or "(?!)",
    filmed="|".join(FILMED) or "(?!)",
    shared="|".join([*SHARED_MODELS, *HA2G_ABLATIONS]),
    seed=r"\d+",


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


rule take_reference_frames:
    input:
        unpack(films_of),
        split="<results>/{filmed}/split.h5",
    output:
        frames="<results>/{filmed}/reference_frames.h5",
    log:
        "<logs>/reference_frames/{filmed}.log",
    benchmark:
        "<benchmarks>/reference_frames/{filmed}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        fps=config["fps"],
        settings=BUDGET.get("reference_frames", {}),
        code=library_code("reference_frames.py"),
    script:
        "../scripts/reference_frames.py"


# Target: reference frames of every speaker on film, whatever they are known by.
rule reference_frames:
    input:
        [f"<results>/{name}/reference_frames.h5" for name in FILMED],


rule collect_corpus:
    input:
        splits=ensemble_files("<results>/{subject}/split.h5"),
        clips=ensemble_files("<results>/{subject}/clips/{clip}.h5"),
        frames=frames_of(*(name for name in ENSEMBLE["speakers"] if name not in ENSEMBLE["held_out"])),
        embeddings=ENSEMBLE["embeddings"] or [],
    output:
        corpus="<results>/{ensemble}/corpus.h5",
    log:
        "<logs>/corpus/{ensemble}.log",
    benchmark:
        "<benchmarks>/corpus/{ensemble}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        ensemble=ENSEMBLE,
        seed=config["seed"],
        code=library_code("ha2g_corpus.py"),
    script:
        "../scripts/ha2g_corpus.py"


rule train_shared:
    input:
        corpus="<results>/{ensemble}/corpus.h5",
        imagenet=ENSEMBLE["imagenet"] or [],
    output:
        weights="<results>/{ensemble}/models/{shared}_{seed}/weights.safetensors",
        network="<results>/{ensemble}/models/{shared}_{seed}/model.onnx",
        history="<results>/{ensemble}/models/{shared}_{seed}/history.h5",
    log:
        "<logs>/train_shared/{ensemble}-{shared}_{seed}.log",
    benchmark:
        "<benchmarks>/train_shared/{ensemble}-{shared}_{seed}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: BUDGET["threads"]
    resources:
        mem_mb=1900,
        gpu=1,
    params:
        model=lambda w: w.shared if w.shared in SHARED_MODELS else "ha2g",
        settings=shared_settings,
        checkpoint=f"{config['results_dir']}/checkpoints/{{ensemble}}-{{shared}}_{{seed}}.pt",
        code=library_code("ha2g_train.py"),
    script:
        "../scripts/ha2g_train.py"


# What knows people by their looks, in a file of its own: with it a network takes after whomever a film shows.
rule export_identity:
    input:
        weights="<results>/{ensemble}/models/{shared}_{seed}/weights.safetensors",
    output:
        identity="<results>/{ensemble}/models/{shared}_{seed}/identity.onnx",
    log:
        "<logs>/export_identity/{ensemble}-{shared}_{seed}.log",
    benchmark:
        "<benchmarks>/export_identity/{ensemble}-{shared}_{seed}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        code=library_code("ha2g_identity.py"),
    script:
        "../scripts/ha2g_identity.py"


# All test clips of a network in one job: opening it takes longer than using it.
rule synthesize_shared:
    input:
        unpack(strangers_of),
        network="<results>/{ensemble}/models/{shared}_{seed}/model.onnx",
        clips=ensemble_files("<results>/{subject}/synthesis/ground_truth/{clip}.h5", "test"),
        audio=ensemble_files("<results>/{subject}/synthesis/ground_truth/{clip}.wav", "test"),
    output:
        ensemble_files("<results>/{{ensemble}}/synthesis/{{shared}}_{{seed}}/{subject}/{clip}.h5", "test"),
    log:
        "<logs>/synthesize_shared/{ensemble}-{shared}_{seed}.log",
    benchmark:
        "<benchmarks>/synthesize_shared/{ensemble}-{shared}_{seed}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        seed=config["seed"],
        code=library_code("ha2g_synthesize.py"),
    script:
        "../scripts/ha2g_synthesize.py"


# Target: HA2G and its baselines at work. With an `ensemble:` in the configuration it is what is made by default.
rule ha2g:
    input:
        shared_syntheses(*ENSEMBLE["models"]),
        expand(rules.export_identity.output, ensemble=ENSEMBLE["name"], shared="ha2g", seed=ENSEMBLE["seeds"])
        if BY_FRAMES and "ha2g" in ENSEMBLE["models"]
        else [],
