"""What one network makes of every speaker's test clips, each in the speaker's own style as far as it can know it."""

import os
from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.files import sha256
    from cospeech.gestures.ha2g.long_speech import SharedGenerator
    from cospeech.speech import load_audio
    from cospeech.synthesis import synthesize

    generator = SharedGenerator(snakemake.input.network, snakemake.threads)
    styles = {Path(path).parent.name: str(path) for path in snakemake.input.get("frames", [])}
    styles |= {speaker: speaker for speaker in generator.speakers}
    model = f"{snakemake.wildcards.shared}_{snakemake.wildcards.seed}"
    for truth, audio, out in zip(snakemake.input.clips, snakemake.input.audio, snakemake.output, strict=True):
        truth, (samples, rate) = Clip.read(truth), load_audio(audio)
        clip = synthesize(
            generator.hearing(samples, rate, truth.words),
            samples,
            rate,
            subject=truth.subject,
            clip=truth.clip,
            model=model,
            seed=snakemake.params.seed,
            words=truth.words,
            smoothing=0.0,
            audio=os.path.relpath(audio, Path(out).parent),
            source=Path(audio).name,
            source_sha256=sha256(audio),
            style=styles.get(truth.subject, "random"),
        )
        clip.write(out)
