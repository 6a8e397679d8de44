# How good: every model and three baselines against the test part: results/<subject>/evaluation/, results/summary.csv,
# results/tables/motion.csv.


rule train_feature_net:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
    output:
        network="<results>/{subject}/evaluation/feature_net.safetensors",
        history="<results>/{subject}/evaluation/feature_net_history.h5",
    log:
        "<logs>/feature_net/{subject}.log",
    benchmark:
        "<benchmarks>/feature_net/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: BUDGET["threads"]
    resources:
        mem_mb=1500,
        gpu=1,
    params:
        settings=BUDGET["feature_net"],
        seed=config["seed"],
        checkpoint=f"{config['results_dir']}/checkpoints/{{subject}}-feature_net.pt",
        code=library_code("feature_net.py"),
    script:
        "../scripts/feature_net.py"


rule evaluate:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
        network="<results>/{subject}/evaluation/feature_net.safetensors",
        audio=lambda w: synthesized(w.subject, "ground_truth", "wav"),
        ground_truth=lambda w: synthesized(w.subject, "ground_truth"),
        models=lambda w: [clip for model in MODELS for clip in synthesized(w.subject, model)],
    output:
        [f"<results>/{{subject}}/evaluation/{row}.h5" for row in ROWS],
    log:
        "<logs>/evaluate/{subject}.log",
    benchmark:
        "<benchmarks>/evaluate/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1900,
    params:
        seed=config["seed"],
        code=library_code("evaluate.py"),
    script:
        "../scripts/evaluate.py"


rule summarize:
    input:
        [f"<results>/{subject}/evaluation/{row}.h5" for subject in SUBJECTS for row in ROWS],
    output:
        hdf5="<results>/evaluation.h5",
        csv=report("<results>/summary.csv", caption="../report/summary.rst", category="Evaluation"),
    log:
        "<logs>/summarize.log",
    benchmark:
        "<benchmarks>/summarize.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=library_code("summarize.py"),
    script:
        "../scripts/summarize.py"


rule measure_motion:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
        audio=lambda w: synthesized(w.subject, "ground_truth", "wav"),
        ground_truth=lambda w: synthesized(w.subject, "ground_truth"),
        models=lambda w: [clip for model in MODELS for clip in synthesized(w.subject, model)],
    output:
        motion="<results>/{subject}/evaluation/motion.h5",
    log:
        "<logs>/measure_motion/{subject}.log",
    benchmark:
        "<benchmarks>/measure_motion/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        rows=ROWS,
        code=library_code("motion.py"),
    script:
        "../scripts/motion.py"


rule motion_table:
    input:
        shown=[f"<results>/{subject}/evaluation/motion.h5" for subject in SUBJECTS],
        judged=[f"<results>/{subject}/evaluation/{row}.h5" for subject in SUBJECTS for row in ROWS],
    output:
        csv=report("<results>/tables/motion.csv", caption="../report/motion.rst", category="Evaluation"),
    log:
        "<logs>/motion_table.log",
    benchmark:
        "<benchmarks>/motion_table.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=library_code("motion_table.py"),
    script:
        "../scripts/motion_table.py"


# Target: the tables of every subject and row.
rule evaluation:
    input:
        "<results>/evaluation.h5",
        "<results>/summary.csv",
        "<results>/tables/motion.csv",
