"""The environment of the mediapipe tracker, apart from the main one."""

import shutil

from job import job, snakemake

with job():
    from cospeech.capture.trackers.mediapipe import build_environment

    build_environment(snakemake.params.folder, snakemake.input.requirements)
    shutil.copyfile(snakemake.input.requirements, snakemake.output.mark)
