# Motion for speech, and the same in other programs' formats: results/<subject>/synthesis/<model>/.
# The recorded truth of every test clip lies there too, as if a model named ground_truth had made it.


rule cut_truth:
    input:
        split="<results>/{subject}/split.h5",
        clip="<results>/{subject}/clips/{clip}.h5",
    output:
        clip="<results>/{subject}/synthesis/ground_truth/{clip}.h5",
        wav="<results>/{subject}/synthesis/ground_truth/{clip}.wav",
    log:
        "<logs>/cut_truth/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/cut_truth/{subject}-{clip}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=library_code("cut_truth.py"),
    script:
        "../scripts/cut_truth.py"


rule synthesize:
    input:
        unpack(generator_of),
        unpack(speech_of),
    output:
        clip="<results>/{subject}/synthesis/{model}/{clip}.h5",
    log:
        "<logs>/synthesize/{subject}-{model}-{clip}.log",
    benchmark:
        "<benchmarks>/synthesize/{subject}-{model}-{clip}.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        model=lambda w: w.model,
        folder=lambda w: f"{config['results_dir']}/{w.subject}",
        fps=config["fps"],
        options=options_of,
        words=words_of,
        styles={},
        code=library_code("synthesize.py"),
    script:
        "../scripts/synthesize.py"


rule export:
    input:
        clip="<results>/{subject}/synthesis/{model}/{clip}.h5",
    output:
        bvh="<results>/{subject}/synthesis/{model}/{clip}.bvh",
        glb="<results>/{subject}/synthesis/{model}/{clip}.glb",
    log:
        "<logs>/export/{subject}-{model}-{clip}.log",
    benchmark:
        "<benchmarks>/export/{subject}-{model}-{clip}.tsv"
    wildcard_constraints:
        model=SHOWN,
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=library_code("export.py"),
    script:
        "../scripts/export.py"


rule render:
    input:
        clip="<results>/{subject}/synthesis/{model}/{clip}.h5",
        truth=truth_beside,
        audio=lambda w: speech_of(w)["audio"],
    output:
        video=report(
            "<results>/{subject}/synthesis/{model}/{clip}.mp4",
            caption="../report/synthesis.rst",
            category="Synthesis",
            subcategory="{subject}",
            labels={"model": "{model}", "clip": "{clip}"},
        ),
    log:
        "<logs>/render/{subject}-{model}-{clip}.log",
    benchmark:
        "<benchmarks>/render/{subject}-{model}-{clip}.tsv"
    wildcard_constraints:
        model=SHOWN,
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        code=library_code("render.py"),
    script:
        "../scripts/render.py"


# Target: every test clip and every `synthesis:` entry in every format.
rule synthesis:
    input:
        all_syntheses(),
