# Everything on one page that opens offline: results/report.html.

# The tables that every run makes and the report shows. A new one is one line here, and four under its file's name in
# ../report/tables.yaml: its title, what it means, and whether it is drawn as curves. Their order there is the page's.
# Tables of a target of their own need no line: the next report shows what lies in results/tables/.
TABLES = ["<results>/tables/motion.csv", "<results>/tables/table_4_3.csv", *FILM_TABLES, *TAKE_TABLES]
OWN_SECTION = ("table_5_3", "table_5_4")  # which the report makes from the files behind them
FOUND = sorted(Path(config["results_dir"], "tables").glob("*.csv"))
MADE = [f"<results>/tables/{table.name}" for table in FOUND if table.stem not in OWN_SECTION]


rule write_report:
    input:
        evaluations=[f"<results>/{subject}/evaluation/{row}.h5" for subject in SUBJECTS for row in ROWS],
        histories=all_histories(),
        videos=all_films(),
        shown=[clip for name in SUBJECTS for row in ["ground_truth", *MODELS] for clip in synthesized(name, row)[:1]],
        sounds=[sound for name in SUBJECTS for sound in synthesized(name, "ground_truth", "wav")[:1]],
        studies=STUDIES,
        compared=COMPARED,
        curves=CURVES,
        tables=list(dict.fromkeys(TABLES + MADE)),
        captions=f"{workflow.basedir}/workflow/report/tables.yaml",
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
