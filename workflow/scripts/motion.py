"""Is every row's motion whole, and how does it move? On a subject's test part, as it is shown."""

from pathlib import Path

from job import job, snakemake

with job():
    from sections import sections

    from cospeech.clip import Clip
    from cospeech.evaluation.baseline_rows import BASELINES
    from cospeech.evaluation.evaluate import evaluate_baseline, evaluate_model
    from cospeech.evaluation.metrics.wholeness import MotionMetrics
    from cospeech.evaluation.reference import Reference
    from cospeech.evaluation.result import write_many
    from cospeech.speech import load_audio

    files, made = snakemake.input, {}
    for path in map(Path, [*files.ground_truth, *files.models]):
        made.setdefault(path.parent.name, {})[path.stem] = Clip.read(path)
    train, _ = sections(files.split, "train", files.clips)
    audio = {Path(path).stem: load_audio(path) for path in files.audio}
    reference = Reference.build(made["ground_truth"], train, {}, audio, metrics=MotionMetrics)
    rows = [
        evaluate_baseline(row, reference) if row in BASELINES else evaluate_model(row, made[row], reference)
        for row in snakemake.params.rows
    ]
    write_many(snakemake.output.motion, rows)
