"""Judge one row of HA2G's tables: a shared network's runs, the models of single speakers, or the baselines."""

from pathlib import Path

from job import job, snakemake

with job():
    import torch
    from speakers import test_name, training_parts

    from cospeech.clip import Clip
    from cospeech.evaluation.evaluate import evaluate_baselines, evaluate_model
    from cospeech.evaluation.metrics.fgd import FeatureNet
    from cospeech.evaluation.metrics.ha2g import HA2GMetrics
    from cospeech.evaluation.reference import Reference
    from cospeech.evaluation.result import write_many
    from cospeech.speech import load_audio

    torch.set_num_threads(snakemake.threads)
    files, row = snakemake.input, snakemake.wildcards.judged
    truth = {test_name(path): Clip.read(path) for path in files.truth}
    audio = {test_name(path): load_audio(path) for path in files.audio}
    nets = {Path(path).stem: FeatureNet.load(path, Path(path).stem) for path in files.networks}
    options = {"metrics": HA2GMetrics, "seed": snakemake.params.seed, "subject": snakemake.wildcards.ensemble}
    reference = Reference.build(truth, training_parts(files.splits, files.clips), nets, audio, **options)
    runs = {}
    for path in files.made:
        clip = Clip.read(path)
        runs.setdefault(clip.generator, {})[f"{clip.subject}/{Path(path).stem}"] = clip
    judged = [evaluate_model(row, clips, reference, run) for run, clips in enumerate(runs.values())]
    write_many(snakemake.output.judged, judged or evaluate_baselines(reference))
