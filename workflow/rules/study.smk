# A study for people to judge the test clips: results/study/, to be opened and handed out (docs/study.md).

JUDGED = ["ground_truth", *MODELS]  # and mismatched, which is the truth of another take


rule build_study:
    input:
        clips=[clip for subject in SUBJECTS for model in JUDGED for clip in synthesized(subject, model)],
        audio=[wav for subject in SUBJECTS for wav in synthesized(subject, "ground_truth", "wav")],
    output:
        page="<results>/study/index.html",
        study="<results>/study/study.json",
        clips=directory("<results>/study/clips"),
    log:
        "<logs>/study.log",
    benchmark:
        "<benchmarks>/study.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        results=lambda w, output: Path(output.page).parents[1],
        subjects=list(SUBJECTS),
        methods=["ground_truth", "mismatched", *MODELS],
        settings=config.get("study", {}),
        seed=config["seed"],
        code=library_code("study.py"),
    script:
        "../scripts/study.py"


# Target: the study.
rule study:
    input:
        rules.build_study.output,
