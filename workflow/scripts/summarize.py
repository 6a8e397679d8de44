"""All evaluations in one file and one table."""

from job import job, snakemake

with job():
    from cospeech.evaluation.tables import read_evaluations, write_csv, write_hdf5

    evaluations = read_evaluations(snakemake.input)
    write_hdf5(snakemake.output.hdf5, evaluations)
    write_csv(snakemake.output.csv, evaluations)
