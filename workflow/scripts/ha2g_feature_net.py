"""Train a feature network of HA2G's metrics on the training parts of all speakers."""

from job import job, snakemake

with job():
    import torch
    from speakers import training_parts

    from cospeech.evaluation.metrics.fgd import preset_of, train_feature_net
    from cospeech.learning.settings import settings_of
    from cospeech.learning.training import finish

    torch.set_num_threads(snakemake.threads)
    params, preset = snakemake.params, snakemake.wildcards.preset
    settings = settings_of(preset_of(preset).settings(), params.settings, "ha2g_ruler")
    clips = training_parts(snakemake.input.splits, snakemake.input.clips)
    options = {"seed": params.seed, "checkpoint": params.checkpoint, "preset": preset}
    network, history = train_feature_net(clips, settings, **options)
    history.write(snakemake.output.history)
    network.save(snakemake.output.network)
    finish(params.checkpoint)
