# Whether a network can tell speech and motion apart that belong together (thesis Table 4.4): results/tables/table_4_4.csv.

SYNC_FRAMES = (64, 32, 16)


rule train_sync_classifier:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train", "val"),
        ground_truth=lambda w: synthesized(w.subject, "ground_truth"),
        models=lambda w: [clip for model in MODELS for clip in synthesized(w.subject, model)],
    output:
        network="<results>/{subject}/evaluation/sync/{frames}_{seed}.safetensors",
        history="<results>/{subject}/evaluation/sync/{frames}_{seed}_history.h5",
        judgement="<results>/{subject}/evaluation/sync/{frames}_{seed}.h5",
    log:
        "<logs>/sync/{subject}-{frames}-{seed}.log",
    benchmark:
        "<benchmarks>/sync/{subject}-{frames}-{seed}.tsv"
    wildcard_constraints:
        frames="64|32|16",
        seed="[0-9]+",
    conda:
        "../../envs/cospeech.yaml"
    threads: BUDGET["threads"]
    resources:
        mem_mb=1500,
        gpu=1,
    params:
        settings=BUDGET.get("sync_classifier", {}),
        checkpoint=f"{config['results_dir']}/checkpoints/{{subject}}-sync_{{frames}}_{{seed}}.pt",
        code=library_code("sync_classifier.py"),
    script:
        "../scripts/sync_classifier.py"


rule sync_table:
    input:
        [f"<results>/{n}/evaluation/sync/{f}_{s}.h5" for n in SUBJECTS for f in SYNC_FRAMES for s in SEEDS],
    output:
        csv=report("<results>/tables/table_4_4.csv", caption="../report/sync.rst", category="Evaluation"),
    log:
        "<logs>/sync_table.log",
    benchmark:
        "<benchmarks>/sync_table.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=library_code("sync_table.py"),
    script:
        "../scripts/sync_table.py"


# Target: Table 4.4 for every subject.
rule sync:
    input:
        rules.sync_table.output,
