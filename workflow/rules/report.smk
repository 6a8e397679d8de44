# Everything on one page that opens offline: results/report.html.


rule write_report:
    input:
        evaluations=[f"<results>/{subject}/evaluation/{row}.h5" for subject in SUBJECTS for row in ROWS],
        histories=all_histories(),
        videos=all_films(),
        studies=STUDIES,
        compared=COMPARED,
        curves=CURVES,
    output:
        report("<results>/report.html", caption="../report/report.rst", category="Report"),
    log:
        "<logs>/report.log",
    benchmark:
        "<benchmarks>/report.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        facts={"config": config, "budget": BUDGET, "subjects": {n: s.source for n, s in SUBJECTS.items()}},
        code=library_code("report.py"),
    script:
        "../scripts/report.py"


# Target: the report.
rule report:
    input:
        "<results>/report.html",
