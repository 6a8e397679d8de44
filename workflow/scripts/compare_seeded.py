"""Judge a subject's networks of several seeds, and the baselines, on its test part."""

from pathlib import Path

from job import job, snakemake

with job():
    import torch
    from sections import sections

    from cospeech.clip import Clip
    from cospeech.evaluation.comparison import compare
    from cospeech.evaluation.metrics.fgd import FeatureNet
    from cospeech.evaluation.metrics.sync_classifier import SyncClassifier
    from cospeech.evaluation.reference import Reference
    from cospeech.evaluation.result import write_many
    from cospeech.face.model import FaceModel
    from cospeech.gestures.generator import find, resolve
    from cospeech.speech import load_audio

    torch.set_num_threads(snakemake.threads)
    files, params, networks = snakemake.input, snakemake.params, {}
    for path in map(Path, files.networks):
        row, seed = path.parent.name.rsplit("_", 1)
        networks.setdefault(row, {})[int(seed)] = resolve(find(row).generator)(path, snakemake.threads)
    truth = {Path(path).stem: Clip.read(path) for path in files.ground_truth}
    train, _ = sections(files.split, "train", files.clips)
    audio = {Path(path).stem: load_audio(path) for path in files.audio}
    reference = Reference.build(truth, train, FeatureNet.load(files.feature_net), audio)
    classifiers = dict(zip(params.seeds, map(SyncClassifier.load, files.classifiers), strict=True))
    face = FaceModel.load(files.face_model) if files.get("face_model") else None
    write_many(snakemake.output.evaluations, compare(networks, truth, train, reference, classifiers, face))
