"""Give the frames of a subject's clips to the train, val and test parts."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.errors import CospeechError
    from cospeech.split import split_clips

    params = snakemake.params
    clips = {Path(path).stem: Clip.read(path) for path in snakemake.input.clips}
    refused = [f"{take}: {clip.extra['refused']}" for take, clip in clips.items() if "refused" in clip.extra]
    if len(refused) == len(clips):
        raise CospeechError(f"{snakemake.wildcards.subject}: every take is refused; {refused[0]}")
    frames = {take: clip.frames for take, clip in clips.items() if "refused" not in clip.extra}  # by clean-up
    split_clips(frames, params.parts, params.shares, params.by, params.seed).write(snakemake.output.split)
