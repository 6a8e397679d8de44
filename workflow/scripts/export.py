"""A clip in the formats of other programs."""

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.formats.export import export_clip

    clip = Clip.read(snakemake.input.clip)
    for path in snakemake.output:
        export_clip(clip, path)
