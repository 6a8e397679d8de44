# Sound (and, for the virtual speaker, the take itself): results/<subject>/media/.


rule demo_take:
    output:
        wav="<results>/{subject}/media/{clip}.wav",
        truth="<results>/{subject}/media/{clip}.truth.h5",
    log:
        "<logs>/demo_take/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/demo_take/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("demo"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        source=lambda w: SUBJECTS[w.subject].source,
        number=lambda w: list(SUBJECTS[w.subject].takes).index(w.clip),
        seed=config["seed"],
        code=library_code("demo_take.py"),
    script:
        "../scripts/demo_take.py"
