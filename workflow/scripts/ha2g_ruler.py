"""Train an autoencoder of HA2G's metrics on the training parts of all speakers."""

from job import job, snakemake

with job():
    import torch
    from speakers import training_parts

    from cospeech.evaluation.metrics.expressive import Settings, train_ruler
    from cospeech.learning.settings import settings_of
    from cospeech.learning.training import finish

    torch.set_num_threads(snakemake.threads)
    params = snakemake.params
    settings = settings_of(Settings(), params.settings, "ha2g_ruler")
    clips = training_parts(snakemake.input.splits, snakemake.input.clips)
    ruler, history = train_ruler(snakemake.wildcards.ruler, clips, settings, params.seed, params.checkpoint)
    history.write(snakemake.output.history)
    ruler.save(snakemake.output.network)
    finish(params.checkpoint)
