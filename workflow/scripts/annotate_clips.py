"""A clip from elsewhere becomes one of this subject; its sound stays where it is."""

import os
from dataclasses import replace
from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.capture.refusal import SILENCE, clip_or_refusal
    from cospeech.clip import Clip
    from cospeech.errors import CospeechError

    path, out = Path(snakemake.input.clip), Path(snakemake.output.clip)
    about = {"subject": snakemake.wildcards.subject, "clip": snakemake.wildcards.clip}

    def made():
        clip = Clip.read(path)
        if clip.fps != snakemake.params.fps:
            raise CospeechError(f"{path}: made at {clip.fps:g} fps, but the config's fps is {snakemake.params.fps:g}")
        audio = os.path.relpath(path.parent / clip.audio, out.parent) if clip.audio else ""
        return replace(clip, audio=audio, **about)

    clip_or_refusal(made, lambda: SILENCE, fps=snakemake.params.fps, **about)[0].write(out)
