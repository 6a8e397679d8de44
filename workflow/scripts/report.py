"""The page that shows a whole run."""

import platform
from importlib.metadata import version
from pathlib import Path

import yaml
from job import job, snakemake

PACKAGES = ("cospeech", "torch", "onnxruntime", "numpy", "scipy", "librosa", "h5py", "av", "snakemake")

with job():
    from cospeech.evaluation.control import ControlStudy, control_rows
    from cospeech.evaluation.tables import read_evaluations, summarise
    from cospeech.evaluation.variants import ordered
    from cospeech.files import read_yaml
    from cospeech.render.pages.report import side_by_side, write_report

    results, facts = Path(snakemake.output[0]).parent, snakemake.params.facts
    name = lambda path, folder: str(Path(path).relative_to(results / folder).with_suffix(""))
    logs = sorted((results / "logs").rglob("*.log"))
    studies, compared = map(ControlStudy.read, snakemake.input.studies), snakemake.input.compared
    write_report(
        snakemake.output[0],
        title="Gestures for speech: " + ", ".join(facts["subjects"]),
        players=side_by_side(snakemake.input.shown, snakemake.input.sounds),
        evaluation=summarise(read_evaluations(snakemake.input.evaluations)),
        control=[row for study in studies for row in control_rows(study)],
        variants=summarise(ordered(read_evaluations(compared))) if compared else (),
        tables=snakemake.input.tables,
        captions=read_yaml(snakemake.input.captions),
        figures=[(name(path, "figures"), path) for path in snakemake.input.curves],
        histories={" ".join(Path(path).parts[-4:-1]): path for path in snakemake.input.histories},
        videos=[(name(path, ""), path) for path in snakemake.input.videos],
        config=yaml.safe_dump(facts, sort_keys=False, allow_unicode=True),
        versions={"python": platform.python_version()} | {package: version(package) for package in PACKAGES},
        timings=[(name(path, "benchmarks"), path) for path in sorted((results / "benchmarks").rglob("*.tsv"))],
        notices=[line for log in logs for line in log.read_text(encoding="utf-8").splitlines() if ": note: " in line],
    )
