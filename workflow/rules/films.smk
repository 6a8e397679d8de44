# The virtual speaker on film (docs/demo.md): takes are filmed, go through capture as anyone's films do, and what comes out
# is held against the truth: results/tables/annotation.csv, annotation_learning.csv.

FILM_TAKES = [(name, film.played_by, take) for name, film in FILMS.items() for take in film.takes]
FILM_TESTS = [(film.played_by, take) for film in FILMS.values() for take in film.takes_of("test")]
FILM_TABLES = ["<results>/tables/annotation.csv", "<results>/tables/annotation_learning.csv"] if FILMS else []


rule film_take:
    input:
        wav=lambda w: f"<results>/{FILMS[w.subject].played_by}/media/{w.clip}.wav",
        truth=lambda w: f"<results>/{FILMS[w.subject].played_by}/media/{w.clip}.truth.h5",
    output:
        film="<results>/{subject}/media/{clip}.mp4",
    log:
        "<logs>/film_take/{subject}-{clip}.log",
    benchmark:
        "<benchmarks>/film_take/{subject}-{clip}.tsv"
    wildcard_constraints:
        subject="|".join(FILMS) or "(?!)",
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        domain=lambda w: FILMS[w.subject].source["domain"],
        fps=config["fps"],
        code=library_code("film_take.py"),
    script:
        "../scripts/film_take.py"


ruleorder: film_take > fetch_video


rule judge_annotation:
    input:
        clips=[f"<results>/{name}/clips/{take}.h5" for name, _, take in FILM_TAKES],
        truth=[f"<results>/{player}/clips/{take}.h5" for _, player, take in FILM_TAKES],
        audio=[f"<results>/{player}/media/{take}.wav" for player, take in FILM_TESTS],
        networks=[f"<results>/{film.played_by}/evaluation/feature_net.safetensors" for film in FILMS.values()],
    output:
        errors="<results>/tables/annotation.csv",
        learning="<results>/tables/annotation_learning.csv",
    log:
        "<logs>/judge_annotation.log",
    benchmark:
        "<benchmarks>/judge_annotation.tsv"
    conda:
        "../../envs/cospeech.yaml"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        films={name: {part: film.takes_of(part) for part in ("train", "test")} for name, film in FILMS.items()},
        players={name: film.played_by for name, film in FILMS.items()},
        seed=config["seed"],
        code=library_code("judge_annotation.py"),
    script:
        "../scripts/judge_annotation.py"


# Target: what capture makes of the virtual speakers' films, against the truth.
rule annotation:
    input:
        FILM_TABLES,
