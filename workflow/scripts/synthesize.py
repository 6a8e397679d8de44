"""Speech in, a clip of generated motion out."""

import os
from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.files import sha256
    from cospeech.speech import load_audio, words_of_speech
    from cospeech.synthesis import load_generator, synthesize

    audio, truth, out = snakemake.input.audio, snakemake.input.get("truth"), Path(snakemake.output.clip)
    generator = load_generator(snakemake.wildcards.model, snakemake.params.folder, snakemake.threads)
    samples, rate = load_audio(audio)
    words = Clip.read(truth).words if truth else words_of_speech(audio, samples, rate, **snakemake.params.words)
    clip = synthesize(
        generator,
        samples,
        rate,
        subject=snakemake.wildcards.subject,
        clip=snakemake.wildcards.clip,
        model=snakemake.wildcards.model,
        fps=snakemake.params.fps,
        words=words,
        audio=os.path.relpath(audio, out.parent),
        source=Path(audio).name,
        source_sha256=sha256(audio),
        **snakemake.params.options,
    )
    clip.write(out)
