# Control and variants of the search: results/tables/table_5_3.csv, table_5_4.csv, results/figures/ (thesis 5.4).

from cospeech.evaluation.variants import VARIANTS

REFINED = ["knn", *(model for model in MODELS if model == "resync")]  # whose controls Table 5.3 compares
CONTROLLED = {name: find(name).signal for name in named() if find(name).signal}
TOLD = list(CONTROLLED) if set(CONTROLLED) <= set(MODELS) else []  # MoGlow's networks, one for each control signal
STUDIED = list(SUBJECTS) if any(model in SEARCHING for model in MODELS) else []  # who has a database to be controlled
STUDIES = [f"<results>/{name}/evaluation/control.h5" for name in STUDIED]
COMPARED = [f"<results>/{name}/evaluation/{row}.h5" for name in STUDIED for row in [*ROWS, *VARIANTS]]
CURVES = [f"<results>/figures/figure_5_5_{name}.svg" for name in STUDIED]


rule control_error:
    input:
        database="<results>/{subject}/database.h5",
        audio_rank="<results>/{subject}/models/audio_rank/weights.safetensors",
        networks=[f"<results>/{{subject}}/models/{model}/model.onnx" for model in [*REFINED, *TOLD] if model in TRAINED],
        clips=lambda w: synthesized(w.subject, "ground_truth"),
    output:
        study="<results>/{subject}/evaluation/control.h5",
    log:
        "<logs>/control_error/{subject}.log",
    benchmark:
        "<benchmarks>/control_error/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        folder=lambda w: f"{config['results_dir']}/{w.subject}",
        models=REFINED,
        told={CONTROLLED[model]: model for model in TOLD},
        seed=config["seed"],
        code=library_code("control_error.py"),
    script:
        "../scripts/control_error.py"


rule control_variants:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
        database="<results>/{subject}/database.h5",
        network="<results>/{subject}/evaluation/feature_net.safetensors",
        audio=lambda w: synthesized(w.subject, "ground_truth", "wav"),
        ground_truth=lambda w: synthesized(w.subject, "ground_truth"),
    output:
        [f"<results>/{{subject}}/evaluation/{row}.h5" for row in VARIANTS],
    log:
        "<logs>/control_variants/{subject}.log",
    benchmark:
        "<benchmarks>/control_variants/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1900,
    params:
        seed=config["seed"],
        code=library_code("control_variants.py"),
    script:
        "../scripts/control_variants.py"


rule write_control_tables:
    input:
        studies=STUDIES,
        evaluations=COMPARED,
    output:
        control=report("<results>/tables/table_5_3.csv", caption="../report/control.rst", category="Evaluation"),
        variants=report("<results>/tables/table_5_4.csv", caption="../report/control.rst", category="Evaluation"),
        control_hdf5="<results>/tables/table_5_3.h5",
        variants_hdf5="<results>/tables/table_5_4.h5",
        figures=[curves.replace("svg", kind) for curves in CURVES for kind in ("png", "svg")],
    log:
        "<logs>/control_tables.log",
    benchmark:
        "<benchmarks>/control_tables.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=700,
    params:
        code=library_code("control_tables.py"),
    script:
        "../scripts/control_tables.py"


rule train_audio_rank:
    input:
        database="<results>/{subject}/database.h5",
    output:
        weights="<results>/{subject}/models/audio_rank/weights.safetensors",
        history="<results>/{subject}/models/audio_rank/history.h5",
    log:
        "<logs>/train/{subject}-audio_rank.log",
    benchmark:
        "<benchmarks>/train/{subject}-audio_rank.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: BUDGET["threads"]
    resources:
        mem_mb=1500,
        gpu=1,
    params:
        settings=BUDGET.get("audio_rank", {}),
        seed=config["seed"],
        checkpoint=f"{config['results_dir']}/checkpoints/{{subject}}-audio_rank.pt",
        code=library_code("audio_rank.py"),
    script:
        "../scripts/audio_rank.py"


# Target: Tables 5.3 and 5.4 and figure 5.5, of the subjects that have a database.
rule control_tables:
    input:
        rules.write_control_tables.output if STUDIED else [],


# Target: the learned audio rank of every subject, for `cospeech generate --audio-rank learned`.
rule audio_ranks:
    input:
        [f"<results>/{name}/models/audio_rank/weights.safetensors" for name in SUBJECTS],
