"""Train a subject's sync classifier of one window length, and let it judge the test part and every model on it."""

from pathlib import Path

from job import job, snakemake

with job():
    import numpy as np
    import torch
    from sections import sections

    from cospeech.clip import Clip
    from cospeech.evaluation.metrics.sync_classifier import Settings, train_sync_classifier, write_judgement
    from cospeech.learning.settings import settings_of
    from cospeech.learning.training import finish

    torch.set_num_threads(snakemake.threads)
    files, (frames, seed) = snakemake.input, map(int, (snakemake.wildcards.frames, snakemake.wildcards.seed))
    clips, _ = sections(files.split, "train", files.clips)
    settings = settings_of(Settings(frames=frames), snakemake.params.settings, "sync_classifier")
    options = {"seed": seed, "checkpoint": snakemake.params.checkpoint}
    classifier, history = train_sync_classifier(clips, settings, **options)
    classifier = classifier.calibrated(sections(files.split, "val", files.clips)[0], seed=seed)
    rows = {}
    for path in map(Path, [*files.ground_truth, *files.models]):
        rows.setdefault(path.parent.name, []).append(Clip.read(path))
    scores = {row: np.nanmean([classifier.score(c.features, c.motion) for c in made]) for row, made in rows.items()}
    accuracy = classifier.accuracy(rows["ground_truth"], seed=seed)
    classifier.save(snakemake.output.network)
    history.write(snakemake.output.history)
    write_judgement(snakemake.output.judgement, snakemake.wildcards.subject, frames, accuracy, scores, seed)
    finish(snakemake.params.checkpoint)
