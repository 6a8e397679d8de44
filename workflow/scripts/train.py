"""Train one network of a subject."""

from pathlib import Path

from job import job, snakemake

with job():
    from sections import sections

    from cospeech.matching import Database
    from cospeech.synthesis import train_model

    clips, starts = sections(snakemake.input.split, "train", snakemake.input.clips)
    database = snakemake.input.get("database")
    train_model(
        snakemake.wildcards.model,
        clips,
        snakemake.params.settings,
        seed=snakemake.params.seed,
        folder=Path(snakemake.output.weights).parent,
        checkpoint=snakemake.params.checkpoint,
        database=Database.load(database) if database else None,
        starts=starts,
        threads=snakemake.threads,
    )
