"""A take of the virtual speaker becomes a clip."""

from job import job, snakemake

with job():
    from cospeech.capture.refusal import clip_or_refusal
    from cospeech.demo import read_take
    from cospeech.speech import load_audio

    files, name = snakemake.input, snakemake.wildcards.clip
    about = {"subject": snakemake.wildcards.subject, "clip": name, "fps": snakemake.params.fps}
    about |= {"audio_path": f"../media/{name}.wav"}
    made = lambda: read_take(files.truth, files.wav, **about)
    clip, _ = clip_or_refusal(made, lambda: load_audio(files.wav), **about)
    clip.write(snakemake.output.clip)
