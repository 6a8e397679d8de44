"""A take of motion capture becomes a clip, and its stretch of the sound a wav beside it."""

from job import job, snakemake

with job():
    from cospeech.formats.mocap import read_mocap_take
    from cospeech.speech import audio_duration, load_audio, write_wav

    files, params = snakemake.input, snakemake.params
    clip = read_mocap_take(
        files.motion,
        files.audio,
        subject=snakemake.wildcards.subject,
        clip=snakemake.wildcards.clip,
        fps=params.fps,
        start=params.start,
        end=params.end,
        words=files.get("words"),
        **params.source,
        audio_path=f"../media/{snakemake.wildcards.clip}.wav",
    )
    end = min(params.start + clip.duration, audio_duration(files.audio))
    write_wav(snakemake.output.wav, *load_audio(files.audio, start=params.start, end=end))
    clip.write(snakemake.output.clip)
