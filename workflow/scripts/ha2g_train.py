"""Train one network of all speakers."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.gestures.ha2g.dataset.corpus import Corpus
    from cospeech.gestures.ha2g.long_speech import train_shared

    train_shared(
        snakemake.params.model,
        Corpus.read(snakemake.input.corpus),
        snakemake.params.settings,
        seed=int(snakemake.wildcards.seed),
        folder=Path(snakemake.output.weights).parent,
        imagenet=snakemake.input.get("imagenet") or None,
        checkpoint=snakemake.params.checkpoint,
        threads=snakemake.threads,
    )
