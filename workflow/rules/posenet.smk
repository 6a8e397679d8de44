# 3D pose from one image (thesis chapter 3): results/posenet/<part>/, for each part that the config names.


wildcard_constraints:
    part="body|hand|face",
    row="baseline|latent|projection|both",
    seed="[0-9]+",


rule make_people:
    output:
        train=f"{PART}/people/train.h5",
        test=f"{PART}/people/test.h5",
    log:
        "<logs>/posenet/people-{part}.log",
    benchmark:
        "<benchmarks>/posenet/people-{part}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        settings=lambda wildcards: posenet_settings("posenet", f"posenet_{wildcards.part}"),
        seed=config["seed"],
        code=library_code("posenet_people.py"),
    script:
        "../scripts/posenet_people.py"


rule train_posenet:
    input:
        people=people_of("train"),
        test=people_of("test"),
        imagenet=POSENET["imagenet"] or [],
    output:
        weights=f"{PART}/weights.safetensors",
        history=f"{PART}/history.h5",
    log:
        "<logs>/posenet/train-{part}.log",
    benchmark:
        "<benchmarks>/posenet/train-{part}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: lambda wildcards: posenet_settings("posenet", f"posenet_{wildcards.part}")["threads"]
    resources:
        mem_mb=1900,
        gpu=1,
    params:
        settings=lambda wildcards: posenet_settings("posenet", f"posenet_{wildcards.part}"),
        seed=config["seed"],
        checkpoint=f"{config['results_dir']}/checkpoints/posenet-{{part}}.pt",
        code=library_code("posenet_train.py"),
    script:
        "../scripts/posenet_train.py"


rule export_posenet:
    input:
        weights=f"{PART}/weights.safetensors",
    output:
        network=f"{PART}/model.onnx",
        manifest=f"{PART}/manifest.yaml",
    log:
        "<logs>/posenet/export-{part}.log",
    benchmark:
        "<benchmarks>/posenet/export-{part}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        code=library_code("posenet_export.py"),
    script:
        "../scripts/posenet_export.py"


rule evaluate_posenet:
    input:
        network=f"{PART}/model.onnx",
        people=people_of("test"),
    output:
        f"{PART}/evaluation.h5",
    log:
        "<logs>/posenet/evaluate-{part}.log",
    benchmark:
        "<benchmarks>/posenet/evaluate-{part}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: BUDGET["threads"]
    resources:
        mem_mb=1500,
    params:
        code=library_code("posenet_evaluate.py"),
    script:
        "../scripts/posenet_evaluate.py"


rule train_posenet_row:
    input:
        people=people_of("train"),
        test=people_of("test"),
        imagenet=POSENET["imagenet"] or [],
    output:
        weights=f"{PART}/ablation/{{row}}-{{seed}}/weights.safetensors",
        history=f"{PART}/ablation/{{row}}-{{seed}}/history.h5",
        network=f"{PART}/ablation/{{row}}-{{seed}}/model.onnx",
        manifest=f"{PART}/ablation/{{row}}-{{seed}}/manifest.yaml",
        evaluation=f"{PART}/ablation/{{row}}-{{seed}}/evaluation.h5",
    log:
        "<logs>/posenet/ablation-{part}-{row}-{seed}.log",
    benchmark:
        "<benchmarks>/posenet/ablation-{part}-{row}-{seed}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: posenet_settings("posenet", "posenet_ablation")["threads"]
    resources:
        mem_mb=1900,
        gpu=1,
    params:
        settings=posenet_settings("posenet", "posenet_ablation"),
        checkpoint=f"{config['results_dir']}/checkpoints/posenet-{{part}}-{{row}}-{{seed}}.pt",
        code=library_code("posenet_row.py"),
    script:
        "../scripts/posenet_row.py"


rule table_3_6:
    input:
        **{
            row: [f"<results>/posenet/body/ablation/{row}-{seed}/evaluation.h5" for seed in POSENET["seeds"]]
            for row in ("baseline", "latent", "projection", "both")
        },
    output:
        "<results>/tables/table_3_6.csv",
    log:
        "<logs>/posenet/table_3_6.log",
    benchmark:
        "<benchmarks>/posenet/table_3_6.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=library_code("posenet_table.py"),
    script:
        "../scripts/posenet_table.py"


# Target: the pose networks of all parts.
rule posenet:
    input:
        all_posenets(),


# Target: the ablation of Table 3.6, four rows over several seeds. Not part of the default run.
rule posenet_ablation:
    input:
        rules.table_3_6.output,
