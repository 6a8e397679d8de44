"""Train one network, of a subject or of many."""

from pathlib import Path

from job import job, snakemake

with job():
    from sections import recordings

    from cospeech.synthesis import train

    train(
        snakemake.params.model,
        recordings(snakemake.input),
        snakemake.params.settings,
        seed=snakemake.params.seed,
        folder=Path(snakemake.output.weights).parent,
        checkpoint=snakemake.params.checkpoint,
        threads=snakemake.threads,
    )
