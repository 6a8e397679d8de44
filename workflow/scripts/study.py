"""A study of the test clips, for people to judge."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.study.build import build_study, settle
    from cospeech.study.stimuli import from_results

    params = snakemake.params
    asked = dict(params.settings) | {"seed": params.seed}
    cutting, design = settle(asked, asked.pop("like", None))
    stimuli = from_results(params.results, params.subjects, params.methods, **cutting)
    build_study(Path(snakemake.output.study).parent, stimuli, design)
