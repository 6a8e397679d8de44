"""Generate and judge the variants of the search on a subject's test part."""

from pathlib import Path

from job import job, snakemake

with job():
    import torch
    from sections import sections

    from cospeech.clip import Clip
    from cospeech.evaluation.metrics.fgd import FeatureNet
    from cospeech.evaluation.reference import Reference
    from cospeech.evaluation.variants import evaluate_variants
    from cospeech.matching import KNN, Database
    from cospeech.speech import load_audio

    torch.set_num_threads(snakemake.threads)
    files, seed = snakemake.input, snakemake.params.seed
    truth = {Path(path).stem: Clip.read(path) for path in files.ground_truth}
    audio = {Path(path).stem: load_audio(path) for path in files.audio}
    train, _ = sections(files.split, "train", files.clips)
    reference = Reference.build(truth, train, FeatureNet.load(files.network), audio, seed=seed)
    found = evaluate_variants(KNN(Database.load(files.database)), truth, reference, seed=seed)
    for path in snakemake.output:
        found[Path(path).stem].write(path)
