# Films become tracks: results/<subject>/tracks/. One rule a tracker; all write the same file, and nothing later knows
# which it was. A film that is an address is fetched first; a local one is used in place.


rule mediapipe_environment:
    input:
        requirements=f"{workflow.basedir}/envs/mediapipe-requirements.txt",
    output:
        mark="<results>/envs/mediapipe.txt",
    log:
        "<logs>/mediapipe_environment.log",
    benchmark:
        "<benchmarks>/mediapipe_environment.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        folder=lambda w, output: Path(output.mark).with_suffix(""),
        code=library_code("mediapipe_environment.py"),
    script:
        "../scripts/mediapipe_environment.py"


rule fetch_video:
    output:
        video="<results>/{subject}/media/{clip}.mp4",
    log:
        "<logs>/fetch_video/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/fetch_video/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("video"),
        clip=fetched(),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        url=lambda w: take_of(w)["url"],
        code=library_code("fetch_video.py"),
    script:
        "../scripts/fetch_video.py"


rule take_sound:
    input:
        unpack(lambda w: {"video": film_of(w)} | ({"audio": take_of(w)["audio"]} if "audio" in take_of(w) else {})),
    output:
        wav="<results>/{subject}/media/{clip}.wav",
    log:
        "<logs>/take_sound/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/take_sound/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("video"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        start=lambda w: take_of(w).get("start", 0.0),
        end=lambda w: take_of(w).get("end"),
        code=library_code("media.py"),
    script:
        "../scripts/media.py"


rule track_mediapipe:
    input:
        video=film_of,
        environment="<results>/envs/mediapipe.txt",
    output:
        track="<results>/{subject}/tracks/{clip}.h5",
    log:
        "<logs>/track/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/track/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=tracked_by("mediapipe"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 2
    resources:
        mem_mb=2000,
    params:
        folder=lambda w, input: Path(input.environment).with_suffix(""),
        start=lambda w: take_of(w).get("start", 0.0),
        end=lambda w: take_of(w).get("end"),
        code=library_code("track_mediapipe.py"),
    script:
        "../scripts/track_mediapipe.py"


rule track_posenet:
    input:
        video=film_of,
        manifests=posenet_files("manifest.yaml"),
        networks=posenet_files("model.onnx"),
    output:
        track="<results>/{subject}/tracks/{clip}.h5",
    log:
        "<logs>/track/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/track/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=tracked_by("posenet"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 2
    resources:
        mem_mb=2000,
    params:
        start=lambda w: take_of(w).get("start", 0.0),
        end=lambda w: take_of(w).get("end"),
        code=library_code("track_posenet.py"),
    script:
        "../scripts/track_posenet.py"


rule track_onnx:
    input:
        video=film_of,
        manifest=tracker_file("manifest"),
    output:
        track="<results>/{subject}/tracks/{clip}.h5",
    log:
        "<logs>/track/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/track/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=tracked_by("onnx"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 2
    resources:
        mem_mb=2000,
    params:
        model=lambda w: SPEAKERS[w.subject].tracker.get("model"),
        start=lambda w: take_of(w).get("start", 0.0),
        end=lambda w: take_of(w).get("end"),
        code=library_code("track_onnx.py"),
    script:
        "../scripts/track_onnx.py"


rule track_files:
    input:
        video=film_of,
        tracks=lambda w: precomputed_of(SPEAKERS[w.subject].tracker["folder"], w.clip),
    output:
        track="<results>/{subject}/tracks/{clip}.h5",
    log:
        "<logs>/track/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/track/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=tracked_by("tracks"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        body_model=lambda w: SPEAKERS[w.subject].tracker.get("body_model"),
        start=lambda w: take_of(w).get("start", 0.0),
        end=lambda w: take_of(w).get("end"),
        code=library_code("track_files.py"),
    script:
        "../scripts/track_files.py"


# The track drawn into its film, to be looked at.
rule overlay:
    input:
        video=film_of,
        track="<results>/{subject}/tracks/{clip}.h5",
    output:
        film="<results>/{subject}/quality/{clip}.mp4",
    log:
        "<logs>/overlay/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/overlay/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject=of_kind("video"),
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        code=library_code("overlay.py"),
    script:
        "../scripts/overlay.py"


# Target: the tracks of every subject of films.
rule tracks:
    input:
        [f"<results>/{name}/tracks/{take}.h5" for name, s in on_video().items() for take in s.takes],
