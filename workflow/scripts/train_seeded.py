"""Train one network of a comparison over seeds."""

from pathlib import Path

from job import job, snakemake

with job():
    from sections import sections

    from cospeech.synthesis import train_model

    clips, _ = sections(snakemake.input.split, "train", snakemake.input.clips)
    train_model(
        snakemake.params.model,
        clips,
        snakemake.params.settings,
        seed=int(snakemake.wildcards.seed),
        folder=Path(snakemake.output.network).parent,
        checkpoint=snakemake.params.checkpoint,
        threads=snakemake.threads,
    )
