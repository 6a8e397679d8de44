"""The film of a take that is an address, by yt-dlp."""

from job import job, snakemake

with job():
    from cospeech.capture.film.media import fetch

    fetch(snakemake.params.url, snakemake.output.video)
