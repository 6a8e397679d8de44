# Which frames train, validate and test: results/<subject>/split.h5.


rule split_clips:
    input:
        clips=clips_of(),
    output:
        split="<results>/{subject}/split.h5",
    log:
        "<logs>/split/{subject}.log",
    benchmark:
        "<benchmarks>/split/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        parts=lambda w: SUBJECTS[w.subject].parts,
        shares=lambda w: SUBJECTS[w.subject].shares,
        by=lambda w: SUBJECTS[w.subject].split["by"],
        seed=config["seed"],
        code=library_code("split.py"),
    script:
        "../scripts/split.py"


# Target: the split of every subject.
rule split:
    input:
        [f"<results>/{name}/split.h5" for name in SUBJECTS],
