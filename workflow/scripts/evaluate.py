"""Judge every model and baseline on a subject's test part."""

from pathlib import Path

from job import job, snakemake

with job():
    import torch
    from sections import sections

    from cospeech.clip import Clip
    from cospeech.evaluation.baseline_rows import BASELINES
    from cospeech.evaluation.evaluate import evaluate_baseline, evaluate_model
    from cospeech.evaluation.metrics.fgd import FeatureNet
    from cospeech.evaluation.reference import Reference
    from cospeech.speech import load_audio

    torch.set_num_threads(snakemake.threads)
    files = snakemake.input
    made = {}
    for path in map(Path, [*files.ground_truth, *files.models]):
        made.setdefault(path.parent.name, {})[path.stem] = Clip.read(path)
    train, _ = sections(files.split, "train", files.clips)
    audio = {Path(path).stem: load_audio(path) for path in files.audio}
    reference = Reference.build(
        made["ground_truth"], train, FeatureNet.load(files.network), audio, seed=snakemake.params.seed
    )
    for path in map(Path, snakemake.output):
        row = path.stem
        judged = evaluate_baseline(row, reference) if row in BASELINES else evaluate_model(row, made[row], reference)
        judged.write(path)
