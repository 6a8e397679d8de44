"""Train the feature network of FGD and diversity on a subject's training part."""

from job import job, snakemake

with job():
    import torch
    from sections import sections

    from cospeech.evaluation.metrics.fgd import Settings, train_feature_net
    from cospeech.learning.settings import settings_of
    from cospeech.learning.training import finish

    torch.set_num_threads(snakemake.threads)
    clips, _ = sections(snakemake.input.split, "train", snakemake.input.clips)
    settings = settings_of(Settings(), snakemake.params.settings, "feature_net")
    checkpoint = snakemake.params.checkpoint
    network, history = train_feature_net(clips, settings, seed=snakemake.params.seed, checkpoint=checkpoint)
    history.write(snakemake.output.history)
    network.save(snakemake.output.network)
    finish(checkpoint)
