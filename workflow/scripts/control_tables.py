"""Tables 5.3 and 5.4 and figure 5.5 of all subjects."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.evaluation import control, tables
    from cospeech.evaluation.result import write_many
    from cospeech.evaluation.variants import METRICS, ordered
    from cospeech.render.curves import plot_control

    studies = {study.subject: study for study in map(control.ControlStudy.read, snakemake.input.studies)}
    rows = [row for study in studies.values() for row in control.control_rows(study)]
    control.write_csv(snakemake.output.control, rows)
    control.write_hdf5(snakemake.output.control_hdf5, rows)
    judged = ordered(tables.read_evaluations(snakemake.input.evaluations))
    tables.write_csv(snakemake.output.variants, judged, METRICS)
    write_many(snakemake.output.variants_hdf5, judged)
    for path in map(Path, snakemake.output.figures):
        plot_control(path, studies[path.stem.removeprefix("figure_5_5_")])
