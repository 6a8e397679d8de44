"""Every take on film in one table: how good its annotation is, or why it is not used."""

from job import job, snakemake

with job():
    from cospeech.capture.cleanup.quality import Quality
    from cospeech.capture.refusal import write_takes

    write_takes(snakemake.output[0], map(Quality.read, snakemake.input), snakemake.params.absent)
