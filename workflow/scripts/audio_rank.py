"""Train the learned audio rank of a subject's database."""

from job import job, snakemake

with job():
    import torch

    from cospeech.learning.settings import settings_of
    from cospeech.learning.training import finish
    from cospeech.matching import Database
    from cospeech.matching.search.similarity import Settings, train_similarity

    torch.set_num_threads(snakemake.threads)
    settings = settings_of(Settings(), snakemake.params.settings, "audio_rank")
    database, checkpoint = Database.load(snakemake.input.database), snakemake.params.checkpoint
    similarity, history = train_similarity(database, settings, seed=snakemake.params.seed, checkpoint=checkpoint)
    history.write(snakemake.output.history)
    similarity.save(snakemake.output.weights)
    finish(checkpoint)
