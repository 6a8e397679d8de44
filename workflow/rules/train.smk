# The networks: results/<subject>/models/<model>/. An interrupted training goes on from results/checkpoints/.


rule train_model:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
        database=branch(lambda w: w.model in MATCHED, then="<results>/{subject}/database.h5"),
    output:
        weights="<results>/{subject}/models/{model}/weights.safetensors",
        network="<results>/{subject}/models/{model}/model.onnx",
        history="<results>/{subject}/models/{model}/history.h5",
    log:
        "<logs>/train/{subject}-{model}.log",
    benchmark:
        "<benchmarks>/train/{subject}-{model}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: BUDGET["threads"]
    resources:
        mem_mb=1900,
        gpu=1,
    params:
        settings=lambda w: BUDGET.get(section_of(w.model), {}),  # a section left out has the published values
        seed=config["seed"],
        checkpoint=f"{config['results_dir']}/checkpoints/{{subject}}-{{model}}.pt",
        code=library_code("train.py"),
    script:
        "../scripts/train.py"


# Target: every network of every subject.
rule models:
    input:
        all_models(),
