"""A take of motion capture becomes a clip, and its stretch of the sound a wav beside it."""

from job import job, snakemake

with job():
    from cospeech.capture.refusal import clip_or_refusal, sound_or_silence
    from cospeech.formats.mapping import load_mapping
    from cospeech.formats.mocap import read_mocap_take
    from cospeech.speech import audio_duration, load_audio, write_wav

    files, params, name = snakemake.input, snakemake.params, snakemake.wildcards.clip
    about = {"subject": snakemake.wildcards.subject, "clip": name, "fps": params.fps}
    about |= {"audio_path": f"../media/{name}.wav"}
    stretch = {"start": params.start, "end": params.end}
    if params.source["skeleton"]:
        load_mapping(params.source["skeleton"])  # a mapping that is wrong is no take's fault

    def made():
        clip = read_mocap_take(files.motion, files.audio, words=files.get("words"), **params.source, **stretch, **about)
        sound.update(end=min(params.start + clip.duration, audio_duration(files.audio)))
        return clip

    sound = dict(stretch)
    listen = lambda: load_audio(files.audio, **sound)
    clip, _ = clip_or_refusal(made, listen, **about)
    write_wav(snakemake.output.wav, *sound_or_silence(listen, name))
    clip.write(snakemake.output.clip)
