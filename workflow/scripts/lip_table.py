"""Table 4.3 of all subjects."""

from job import job, snakemake

with job():
    from cospeech.evaluation.metrics.lips import LipErrors, write_lips

    write_lips(snakemake.output.csv, [LipErrors.read(path) for path in snakemake.input])
