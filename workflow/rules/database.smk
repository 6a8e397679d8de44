# What knn and resync search: the training part, cut into clips of 64 frames: results/<subject>/database.h5.


rule build_database:
    input:
        split="<results>/{subject}/split.h5",
        clips=clips_of("train"),
    output:
        database="<results>/{subject}/database.h5",
    log:
        "<logs>/database/{subject}.log",
    benchmark:
        "<benchmarks>/database/{subject}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        code=library_code("database.py"),
    script:
        "../scripts/database.py"


# Target: the database of every subject.
rule database:
    input:
        [f"<results>/{name}/database.h5" for name in SUBJECTS],
