"""The matching database of a subject's training part."""

from job import job, snakemake

with job():
    from sections import sections

    from cospeech.matching import Database

    clips, starts = sections(snakemake.input.split, "train", snakemake.input.clips)
    Database.from_clips(clips, starts).save(snakemake.output.database)
