"""The control signals of a subject's test part under the controls of Table 5.3, before and after the cGAN."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.evaluation.control import study_controls
    from cospeech.synthesis import load

    folder, params = snakemake.params.folder, snakemake.params
    generators = {model: load(model, folder, snakemake.threads) for model in params.models}
    if params.told:
        generators["moglow"] = {s: load(model, folder, snakemake.threads) for s, model in params.told.items()}
    clips = {Path(path).stem: Clip.read(path) for path in snakemake.input.clips}
    study = study_controls(snakemake.wildcards.subject, generators, clips, seed=params.seed)
    study.write(snakemake.output.study)
