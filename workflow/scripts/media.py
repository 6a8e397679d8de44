"""The sound of a take: of its own file where it has one, else of its film."""

from job import job, snakemake

with job():
    from cospeech.capture.film.media import take_sound
    from cospeech.capture.refusal import sound_or_silence
    from cospeech.speech import write_wav

    files, params = snakemake.input, snakemake.params
    listen = lambda: take_sound(files.video, files.get("audio"), params.start, params.end)
    write_wav(snakemake.output.wav, *sound_or_silence(listen, snakemake.wildcards.clip))
