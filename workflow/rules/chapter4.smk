# The tables of thesis chapter 4 beside the summary: results/tables/table_4_3.csv, generators.csv, ablation.csv,
# window_length.csv. Table 4.3 is part of a whole run; the others train every network with every seed of `chapter4:`.


rule lip_error:
    input:
        unpack(face_model_of),
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
        ground_truth=lambda w: synthesized(w.subject, "ground_truth"),
        models=lambda w: [clip for model in MODELS for clip in synthesized(w.subject, model)],
    output:
        lips="<results>/{subject}/evaluation/lips.h5",
    log:
        "<logs>/lip_error/{subject}.log",
    benchmark:
        "<benchmarks>/lip_error/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        seed=config["seed"],
        code=library_code("lip_error.py"),
    script:
        "../scripts/lip_error.py"


rule lip_table:
    input:
        [f"<results>/{name}/evaluation/lips.h5" for name in SUBJECTS],
    output:
        csv=report("<results>/tables/table_4_3.csv", caption="../report/lips.rst", category="Evaluation"),
    log:
        "<logs>/lip_table.log",
    benchmark:
        "<benchmarks>/lip_table.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=library_code("lip_table.py"),
    script:
        "../scripts/lip_table.py"


use rule train_model as train_seeded with:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
    output:
        weights="<results>/{subject}/chapter4/{model}_{seed}/weights.safetensors",
        network="<results>/{subject}/chapter4/{model}_{seed}/model.onnx",
        history="<results>/{subject}/chapter4/{model}_{seed}/history.h5",
    log:
        "<logs>/train_seeded/{subject}-{model}-{seed}.log",
    benchmark:
        "<benchmarks>/train_seeded/{subject}-{model}-{seed}.tsv"
    wildcard_constraints:
        model="|".join(SEEDED),
        seed="[0-9]+",
    params:
        model=lambda w: w.model,
        settings=seeded_settings,
        seed=lambda w: int(w.seed),
        checkpoint=f"{config['results_dir']}/checkpoints/{{subject}}-{{model}}_{{seed}}.pt",
        code=library_code("train.py"),


rule compare_seeded:
    input:
        unpack(face_model_of),
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
        feature_net="<results>/{subject}/evaluation/feature_net.safetensors",
        audio=lambda w: synthesized(w.subject, "ground_truth", "wav"),
        ground_truth=lambda w: synthesized(w.subject, "ground_truth"),
        networks=seeded_networks,
        classifiers=[f"<results>/{{subject}}/evaluation/sync/64_{seed}.safetensors" for seed in SEEDS],
    output:
        evaluations="<results>/{subject}/evaluation/{table}.h5",
    log:
        "<logs>/compare_seeded/{subject}-{table}.log",
    benchmark:
        "<benchmarks>/compare_seeded/{subject}-{table}.tsv"
    wildcard_constraints:
        table="|".join(COMPARISONS),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1900,
    params:
        seeds=SEEDS,
        code=library_code("compare_seeded.py"),
    script:
        "../scripts/compare_seeded.py"


rule compare_table:
    input:
        [f"<results>/{name}/evaluation/{{table}}.h5" for name in SUBJECTS],
    output:
        csv=report("<results>/tables/{table}.csv", caption="../report/chapter4.rst", category="Evaluation"),
    log:
        "<logs>/compare_table/{table}.log",
    benchmark:
        "<benchmarks>/compare_table/{table}.tsv"
    wildcard_constraints:
        table="|".join(COMPARISONS),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        rows=lambda w: COMPARISONS[w.table],
        code=library_code("compare_table.py"),
    script:
        "../scripts/compare_table.py"


# Target: Table 4.3, of the configuration's models.
rule lips:
    input:
        rules.lip_table.output,


# Target: every table of chapter 4.
rule chapter4:
    input:
        rules.lip_table.output,
        rules.sync_table.output,
        [f"<results>/tables/{table}.csv" for table in COMPARISONS],
