"""Train the pose network of one part."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.learning.settings import settings_of
    from cospeech.posenet.training.stages import Settings, train_posenet

    train_posenet(
        snakemake.input.people,
        settings_of(Settings(), snakemake.params.settings, "posenet"),
        seed=snakemake.params.seed,
        folder=Path(snakemake.output.weights).parent,
        imagenet=snakemake.input.get("imagenet") or None,
        test=snakemake.input.test,
        checkpoint=snakemake.params.checkpoint,
    )
