"""Put every sync classifier's accuracies and scores into one table."""

from job import job, snakemake

with job():
    from cospeech.evaluation.metrics.sync_classifier import write_accuracies

    write_accuracies(snakemake.output.csv, snakemake.input)
