# HA2G, its baselines and its ablations, one network for all speakers of `ensemble:`: results/<ensemble>/.
# A network lies in models/<row>_<seed>/, what it makes of every speaker's test clips in synthesis/<row>_<seed>/<subject>/.


SHARED = "|".join([*SHARED_MODELS, *HA2G_ABLATIONS])


wildcard_constraints:
    ensemble=ENSEMBLE["name"],
    filmed="|".join(FILMED) or "(?!)",
    seed=r"\d+",


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


use rule train_model as train_shared with:
    input:
        corpus="<results>/{ensemble}/corpus.h5",
        imagenet=ENSEMBLE["imagenet"] or [],
    output:
        weights="<results>/{ensemble}/models/{model}_{seed}/weights.safetensors",
        network="<results>/{ensemble}/models/{model}_{seed}/model.onnx",
        history="<results>/{ensemble}/models/{model}_{seed}/history.h5",
    log:
        "<logs>/train_shared/{ensemble}-{model}_{seed}.log",
    benchmark:
        "<benchmarks>/train_shared/{ensemble}-{model}_{seed}.tsv"
    wildcard_constraints:
        model=SHARED,
    params:
        model=lambda w: w.model,
        settings=lambda w: settings_for(w.model, BUDGET),
        seed=lambda w: int(w.seed),
        checkpoint=f"{config['results_dir']}/checkpoints/{{ensemble}}-{{model}}_{{seed}}.pt",
        code=library_code("train.py"),


# What knows people by their looks, in a file of its own: with it a network takes after whomever a film shows.
rule export_identity:
    input:
        weights="<results>/{ensemble}/models/{model}_{seed}/weights.safetensors",
    output:
        identity="<results>/{ensemble}/models/{model}_{seed}/identity.onnx",
    log:
        "<logs>/export_identity/{ensemble}-{model}_{seed}.log",
    benchmark:
        "<benchmarks>/export_identity/{ensemble}-{model}_{seed}.tsv"
    wildcard_constraints:
        model=SHARED,
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
use rule synthesize as synthesize_shared with:
    input:
        unpack(strangers_of),
        network="<results>/{ensemble}/models/{model}_{seed}/model.onnx",
        truth=ensemble_files("<results>/{subject}/synthesis/ground_truth/{clip}.h5", "test"),
        audio=ensemble_files("<results>/{subject}/synthesis/ground_truth/{clip}.wav", "test"),
    output:
        clip=ensemble_files("<results>/{{ensemble}}/synthesis/{{model}}_{{seed}}/{subject}/{clip}.h5", "test"),
    log:
        "<logs>/synthesize_shared/{ensemble}-{model}_{seed}.log",
    benchmark:
        "<benchmarks>/synthesize_shared/{ensemble}-{model}_{seed}.tsv"
    wildcard_constraints:
        model=SHARED,
    params:
        model=lambda w: f"{w.model}_{w.seed}",
        folder=lambda w: f"{config['results_dir']}/{w.ensemble}",
        fps=config["fps"],
        options={"seed": config["seed"]},
        words={},
        styles=styles,
        code=library_code("synthesize.py"),


# Target: HA2G and its baselines at work. With an `ensemble:` in the configuration it is what is made by default.
rule ha2g:
    input:
        shared_syntheses(*ENSEMBLE["models"]),
        expand(rules.export_identity.output, ensemble=ENSEMBLE["name"], model="ha2g", seed=ENSEMBLE["seeds"])
        if BY_FRAMES and "ha2g" in ENSEMBLE["models"]
        else [],
