"""All evaluations in one file and one table."""

from job import job, snakemake

with job():
    from cospeech.evaluation.result import write_many
    from cospeech.evaluation.tables import read_evaluations, write_csv

    evaluations = read_evaluations(snakemake.input)
    write_many(snakemake.output.hdf5, evaluations)
    write_csv(snakemake.output.csv, evaluations)
