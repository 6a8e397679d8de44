"""One set of bone lengths for a speaker, from all of their tracks."""

from job import job, snakemake

with job():
    from cospeech.capture.cleanup.bone_lengths import measure_bones, write_bones

    bones = measure_bones(list(snakemake.input.tracks))
    write_bones(snakemake.output.bones, bones, subject=snakemake.wildcards.subject)
