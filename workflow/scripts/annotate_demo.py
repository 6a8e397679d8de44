"""A take of the virtual speaker becomes a clip."""

from job import job, snakemake

with job():
    from cospeech.demo import read_take

    clip = read_take(
        snakemake.input.truth,
        snakemake.input.wav,
        fps=snakemake.params.fps,
        subject=snakemake.wildcards.subject,
        clip=snakemake.wildcards.clip,
        audio_path=f"../media/{snakemake.wildcards.clip}.wav",
    )
    clip.write(snakemake.output.clip)
