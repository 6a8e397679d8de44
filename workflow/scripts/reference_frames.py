"""Pictures of a speaker from the films of the training takes."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.gestures.ha2g.dataset.references import take_reference_frames
    from cospeech.split import Split
    from cospeech.track import Track

    files, fps, stretches = snakemake.input, snakemake.params.fps, {}
    for take, start, stop in Split.read(files.split).of("train"):
        stretches.setdefault(take, []).append((start / fps, stop / fps))
    films = {Path(track).stem: (film, Track.read(track)) for film, track in zip(files.films, files.tracks, strict=True)}
    frames = take_reference_frames(snakemake.wildcards.filmed, films, stretches, **snakemake.params.settings)
    frames.write(snakemake.output.frames)
