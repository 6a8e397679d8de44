"""A film of a take of the virtual speaker."""

from job import job, snakemake

with job():
    from cospeech.demo.film import film_take

    files, params = snakemake.input, snakemake.params
    film_take(snakemake.output.film, truth=files.truth, wav=files.wav, domain=params.domain, fps=params.fps)
