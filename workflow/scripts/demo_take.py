"""One take of the virtual speaker: its speech, and the truth about its motion."""

from job import job, snakemake

with job():
    from cospeech.demo import write_take

    source = snakemake.params.source
    write_take(
        source["speaker"],
        snakemake.params.number,
        seconds=60.0 * source["minutes"] / source["takes"],
        seed=snakemake.params.seed,
        wav=snakemake.output.wav,
        truth=snakemake.output.truth,
    )
