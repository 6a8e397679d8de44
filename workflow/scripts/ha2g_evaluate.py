"""Judge one row of HA2G's tables: a shared network's runs, the models of single speakers, or the baselines."""

from pathlib import Path

from job import job, snakemake

with job():
    import torch
    from speakers import test_name, training_parts

    from cospeech.clip import Clip
    from cospeech.evaluation.ha2g import Yardstick, evaluate_baselines, evaluate_ha2g
    from cospeech.evaluation.ha2g_result import write_judgements
    from cospeech.evaluation.metrics.expressive import Ruler
    from cospeech.speech import load_audio

    torch.set_num_threads(snakemake.threads)
    files, row = snakemake.input, snakemake.wildcards.judged
    truth = {test_name(path): Clip.read(path) for path in files.truth}
    audio = {test_name(path): load_audio(path) for path in files.audio}
    rulers = {Path(path).stem: Ruler.load(path) for path in files.rulers}
    train = training_parts(files.splits, files.clips)
    yardstick = Yardstick.build(truth, train, rulers, audio, seed=snakemake.params.seed)
    runs = {}
    for path in files.made:
        clip = Clip.read(path)
        runs.setdefault(clip.generator, {})[f"{clip.subject}/{Path(path).stem}"] = clip
    judged = [evaluate_ha2g(row, clips, yardstick, run) for run, clips in enumerate(runs.values())]
    write_judgements(snakemake.output.judged, judged or evaluate_baselines(yardstick))
