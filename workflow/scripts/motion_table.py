"""Motion as it is shown, of every subject and row, in one table."""

from job import job, snakemake

with job():
    from cospeech.evaluation.motion_table import write_motion
    from cospeech.evaluation.tables import read_evaluations

    shown, judged = read_evaluations(snakemake.input.shown), read_evaluations(snakemake.input.judged)
    write_motion(snakemake.output.csv, shown, judged)
