# Every take becomes a clip: results/<subject>/clips/. One rule a kind of source.


rule annotate_demo:
    input:
        wav="<results>/{subject}/media/{clip}.wav",
        truth="<results>/{subject}/media/{clip}.truth.h5",
    output:
        clip="<results>/{subject}/clips/{clip}.h5",
    log:
        "<logs>/annotate/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/annotate/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("demo"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        fps=config["fps"],
        code=library_code("annotate_demo.py"),
    script:
        "../scripts/annotate_demo.py"


rule annotate_mocap:
    input:
        unpack(lambda w: {key: take_of(w)[key] for key in ("motion", "audio", "words") if key in take_of(w)}),
    output:
        wav="<results>/{subject}/media/{clip}.wav",
        clip="<results>/{subject}/clips/{clip}.h5",
    log:
        "<logs>/annotate/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/annotate/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("mocap"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        source=lambda w: {key: SUBJECTS[w.subject].source.get(key) for key in ("skeleton", "units", "up")},
        start=lambda w: take_of(w).get("start", 0.0),
        end=lambda w: take_of(w).get("end"),
        fps=config["fps"],
        code=library_code("annotate_mocap.py"),
    script:
        "../scripts/annotate_mocap.py"


rule annotate_clips:
    input:
        clip=lambda w: take_of(w)["clip"],
    output:
        clip="<results>/{subject}/clips/{clip}.h5",
    log:
        "<logs>/annotate/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/annotate/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("clips"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        fps=config["fps"],
        code=library_code("annotate_clips.py"),
    script:
        "../scripts/annotate_clips.py"


# Target: the clips of every subject.
rule clips:
    input:
        [f"<results>/{name}/clips/{take}.h5" for name, subject in SUBJECTS.items() for take in subject.takes],
