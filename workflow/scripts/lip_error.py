"""The lip error of every model on a subject's test part."""

from pathlib import Path

from job import job, snakemake

with job():
    from sections import sections

    from cospeech.clip import Clip
    from cospeech.evaluation.metrics.lips import judge_lips
    from cospeech.face.model import FaceModel

    files, made = snakemake.input, {}
    for path in map(Path, [*files.ground_truth, *files.models]):
        made.setdefault(path.parent.name, {})[path.stem] = Clip.read(path)
    train, _ = sections(files.split, "train", files.clips)
    face = FaceModel.load(files.face_model) if files.get("face_model") else None
    judge_lips(made.pop("ground_truth"), made, train, face, snakemake.params.seed).write(snakemake.output.lips)
