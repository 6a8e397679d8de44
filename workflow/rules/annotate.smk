# Every take becomes a clip: results/<subject>/clips/. One rule a kind of source.

TAKE_TABLES = ["<results>/tables/takes.csv"]

MOTION_KEYS = ("skeleton", "units", "up", "body_model")  # of a mocap subject's source


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
        source=lambda w: {key: SUBJECTS[w.subject].source.get(key) for key in MOTION_KEYS},
        start=lambda w: take_of(w).get("start", 0.0),
        end=lambda w: take_of(w).get("end"),
        fps=config["fps"],
        code=library_code("annotate_mocap.py"),
    script:
        "../scripts/annotate_mocap.py"


# One set of bone lengths for a speaker, from all of their tracks.
rule speaker_bones:
    input:
        tracks=lambda w: [f"<results>/{w.subject}/tracks/{take}.h5" for take in SPEAKERS[w.subject].takes],
    output:
        bones="<results>/{subject}/bones.h5",
    log:
        "<logs>/speaker_bones/{subject}.log",
    benchmark:
        "<benchmarks>/speaker_bones/{subject}.tsv"
    wildcard_constraints:
        subject=of_kind("video"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        code=library_code("speaker_bones.py"),
    script:
        "../scripts/speaker_bones.py"


rule annotate_video:
    input:
        unpack(lambda w: {"words": take_of(w)["words"], "film": film_of(w)} if "words" in take_of(w) else {}),
        unpack(lambda w: {key: path for key, path in SPEAKERS[w.subject].tracker.items() if key == "face_model"}),
        track="<results>/{subject}/tracks/{clip}.h5",
        wav="<results>/{subject}/media/{clip}.wav",
        bones="<results>/{subject}/bones.h5",
    output:
        clip="<results>/{subject}/clips/{clip}.h5",
        quality="<results>/{subject}/quality/{clip}.h5",
        page="<results>/{subject}/quality/{clip}.html",
    log:
        "<logs>/annotate/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/annotate/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("video"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        fps=config["fps"],
        code=library_code("annotate_video.py"),
    script:
        "../scripts/annotate_video.py"


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


# Every take in one table, the refused ones with their reason.
rule list_takes:
    input:
        judged=[f"<results>/{name}/quality/{take}.h5" for name, subject in on_video().items() for take in subject.takes],
        clips=[
            f"<results>/{name}/clips/{take}.h5"
            for name, subject in SUBJECTS.items()
            if name not in on_video()
            for take in subject.takes
        ],
    output:
        "<results>/tables/takes.csv",
    log:
        "<logs>/list_takes.log",
    benchmark:
        "<benchmarks>/list_takes.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        absent=[(name, take, line) for name, s in SUBJECTS.items() for take, line in s.absent.items()],
        code=library_code("list_takes.py"),
    script:
        "../scripts/list_takes.py"


# Target: the clips of every subject.
rule clips:
    input:
        [f"<results>/{name}/clips/{take}.h5" for name, subject in SUBJECTS.items() for take in subject.takes],


# Target: the quality pages of every take on film, and the overlay films that they show.
rule quality:
    input:
        [
            f"<results>/{name}/quality/{take}.{suffix}"
            for name, subject in on_video().items()
            for take in subject.takes
            for suffix in ("html", "mp4")
        ],
