"""Every take in one table: how good its annotation is, or why it is not used."""

from job import job, snakemake

with job():
    from cospeech.capture.cleanup.quality import Quality
    from cospeech.capture.refusal import quality_of, write_takes
    from cospeech.clip import Clip

    files = snakemake.input
    judged = [*map(Quality.read, files.judged), *(quality_of(Clip.read(path)) for path in files.clips)]
    write_takes(snakemake.output[0], judged, snakemake.params.absent)
