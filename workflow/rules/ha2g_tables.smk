# HA2G's tables over all speakers of `ensemble:` (docs/ha2g_metrics.md): results/tables/ha2g_table_1.csv, ha2g_table_3.csv
# and ha2g_table_4.csv, and every metric of Table 1's rows in results/<ensemble>/metrics.csv.


rule train_ha2g_feature_net:
    input:
        splits=ensemble_files("<results>/{subject}/split.h5"),
        clips=ensemble_files("<results>/{subject}/clips/{clip}.h5"),
    output:
        network="<results>/{ensemble}/feature_nets/{preset}.safetensors",
        history="<results>/{ensemble}/feature_nets/{preset}_history.h5",
    log:
        "<logs>/ha2g_feature_net/{ensemble}-{preset}.log",
    benchmark:
        "<benchmarks>/ha2g_feature_net/{ensemble}-{preset}.tsv"
    wildcard_constraints:
        preset="|".join(NETS),
    conda:
        "../../envs/cospeech.yaml"
    threads: BUDGET["threads"]
    resources:
        mem_mb=1500,
        gpu=1,
    params:
        settings=BUDGET.get("ha2g_ruler", {}),
        seed=config["seed"],
        checkpoint=f"{config['results_dir']}/checkpoints/{{ensemble}}-feature_net_{{preset}}.pt",
        code=library_code("ha2g_feature_net.py"),
    script:
        "../scripts/ha2g_feature_net.py"


rule evaluate_ha2g:
    input:
        splits=ensemble_files("<results>/{subject}/split.h5"),
        clips=ensemble_files("<results>/{subject}/clips/{clip}.h5"),
        networks=[f"<results>/{{ensemble}}/feature_nets/{preset}.safetensors" for preset in NETS],
        truth=ensemble_files("<results>/{subject}/synthesis/ground_truth/{clip}.h5", "test"),
        audio=ensemble_files("<results>/{subject}/synthesis/ground_truth/{clip}.wav", "test"),
        made=made_by,
    output:
        judged="<results>/{ensemble}/judged/{judged}.h5",
    log:
        "<logs>/evaluate_ha2g/{ensemble}-{judged}.log",
    benchmark:
        "<benchmarks>/evaluate_ha2g/{ensemble}-{judged}.tsv"
    wildcard_constraints:
        judged="|".join(["baselines", *SHARED_MODELS, *HA2G_ABLATIONS, *OWN_MODELS]),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1900,
    params:
        seed=config["seed"],
        code=library_code("ha2g_evaluate.py"),
    script:
        "../scripts/ha2g_evaluate.py"


rule ha2g_table:
    input:
        lambda w: judged(w.table),
    output:
        csv=report("<results>/tables/{table}.csv", caption="../report/ha2g.rst", category="Evaluation"),
    log:
        "<logs>/ha2g_table/{table}.log",
    benchmark:
        "<benchmarks>/ha2g_table/{table}.tsv"
    wildcard_constraints:
        table="|".join(HA2G_TABLES),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        rows=lambda w: HA2G_TABLES[w.table],
        code=library_code("ha2g_table.py"),
    script:
        "../scripts/ha2g_table.py"


rule ha2g_metrics:
    input:
        judged("ha2g_table_1"),
    output:
        csv="<results>/{ensemble}/metrics.csv",
    log:
        "<logs>/ha2g_metrics/{ensemble}.log",
    benchmark:
        "<benchmarks>/ha2g_metrics/{ensemble}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        rows=HA2G_TABLES["ha2g_table_1"],
        code=library_code("ha2g_table.py"),
    script:
        "../scripts/ha2g_table.py"


# Target: Table 1, and all metrics of its rows.
rule ha2g_table_1:
    input:
        "<results>/tables/ha2g_table_1.csv",
        f"{ENSEMBLE_FOLDER}/metrics.csv",


# Target: the ablations, Tables 3 and 4.
rule ha2g_ablations:
    input:
        "<results>/tables/ha2g_table_3.csv",
        "<results>/tables/ha2g_table_4.csv",
