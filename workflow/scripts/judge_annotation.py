"""What capture makes of the virtual speakers' films, and what is learnt from it, against the truth."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.evaluation import annotation
    from cospeech.evaluation.metrics.fgd import FeatureNet
    from cospeech.evaluation.tables import write_csv
    from cospeech.speech import load_audio

    files, params, errors, judged = snakemake.input, snakemake.params, {}, []
    owner = lambda path: Path(path).parts[-3]
    read = lambda paths, who: {Path(path).stem: Clip.read(path) for path in paths if owner(path) == who}
    for name, split in params.films.items():
        player = params.players[name]
        clips, truth = read(files.clips, name), read(files.truth, player)
        errors[name] = annotation.annotation_errors(clips, truth)
        (network,) = [FeatureNet.load(path) for path in files.networks if owner(path) == player]
        audio = {Path(path).stem: load_audio(path) for path in files.audio if owner(path) == player}
        judged += annotation.judge_learning(clips, truth, split, audio, network, params.seed)
    annotation.write_errors(snakemake.output.errors, errors)
    write_csv(snakemake.output.learning, judged, annotation.METRICS)
