"""Speech in, clips of generated motion out: one clip, or all test clips of a network that is dear to open."""

import os
from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.gestures.generator import Speech
    from cospeech.synthesis import load, synthesize

    files, params = snakemake.input, snakemake.params
    generator = load(params.model, params.folder, snakemake.threads)
    listed = lambda paths: [paths] if isinstance(paths, str) else list(paths)
    audios, outs = listed(files.audio), map(Path, listed(snakemake.output.clip))
    truths = [Clip.read(path) for path in listed(files.get("truth", []))] or [None] * len(audios)
    for audio, truth, out in zip(audios, truths, outs, strict=True):
        subject = truth.subject if truth else snakemake.wildcards.subject
        speech = Speech.load(audio, params.fps, **({"words": truth.words} if truth else params.words))
        style = {"style": params.styles[subject]} if params.styles else {}
        clip = synthesize(
            generator,
            speech,
            subject=subject,
            clip=out.stem,
            model=params.model,
            audio=os.path.relpath(audio, out.parent),
            **params.options,
            **style,
        )
        clip.write(out)
