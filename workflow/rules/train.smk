# The networks: results/<subject>/models/<model>/. An interrupted training goes on from results/checkpoints/.


rule train_model:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
        database=branch(lambda w: "database" in find(w.model).needs, then="<results>/{subject}/database.h5"),
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
        model=lambda w: w.model,
        settings=lambda w: settings_for(w.model, BUDGET),  # a key left out has the published value
        seed=config["seed"],
        checkpoint=f"{config['results_dir']}/checkpoints/{{subject}}-{{model}}.pt",
        code=library_code("train.py"),
    script:
        "../scripts/train.py"


# Target: every network of every subject.
rule models:
    input:
        all_models(),
