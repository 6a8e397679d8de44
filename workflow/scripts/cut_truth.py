"""The test stretch of a clip, with its sound, as a clip of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.errors import CospeechError
    from cospeech.speech import audio_duration, load_audio, write_wav
    from cospeech.split import Split

    path, name = Path(snakemake.input.clip), snakemake.wildcards.clip
    clip = Clip.read(path)
    ranges = [(start, stop) for take, start, stop in Split.read(snakemake.input.split).of("test") if take == name]
    sound = path.parent / clip.audio
    if "refused" in clip.extra:  # a stand-in without a valid frame: of the take, its speech alone is of use
        ranges = [(0, clip.frames)]
        if not sound.is_file():  # a clip from elsewhere that could not be read
            clip, sound = replace(clip, audio=f"{name}.wav"), Path(snakemake.output.wav)
            write_wav(sound, np.zeros(round(clip.duration * 16000)), 16000)
    if not ranges:
        raise CospeechError(f"{path}: too short to have a test part; give longer takes or a larger share")
    if not clip.audio or not sound.is_file():
        raise CospeechError(f"{path}: its sound {clip.audio!r} is missing; motion for a test clip is made from it")
    start, stop = ranges[0]
    whole = stop == clip.frames == round(audio_duration(sound) * clip.fps)  # a film's sound may outlast its pictures
    end = None if whole else stop / clip.fps
    write_wav(snakemake.output.wav, *load_audio(sound, start=start / clip.fps, end=end))
    replace(clip.section(start, stop), audio=f"{name}.wav").write(snakemake.output.clip)
