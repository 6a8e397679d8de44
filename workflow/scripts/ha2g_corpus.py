"""Every speaker's training part as one corpus of windows."""

from pathlib import Path

from job import job, snakemake

with job():
    from sections import sections

    from cospeech.errors import CospeechError
    from cospeech.gestures.ha2g.dataset.collect import Take, collect
    from cospeech.gestures.ha2g.dataset.filters import Filters
    from cospeech.gestures.ha2g.dataset.references import ReferenceFrames
    from cospeech.learning.settings import settings_of
    from cospeech.speech import load_audio
    from cospeech.speech.mfcc import RATE

    ensemble, takes = snakemake.params.ensemble, {}
    for split in map(Path, snakemake.input.splits):
        speaker, folder = split.parent.name, split.parent / "clips"
        paths = [path for path in snakemake.input.clips if Path(path).parent == folder]
        takes[speaker] = []
        for clip, start in zip(*sections(split, "train", paths), strict=True):
            sound = folder / clip.audio
            if not clip.audio or not sound.is_file():
                raise CospeechError(f"{folder / clip.clip}.h5: its sound {clip.audio!r} is missing; give it one")
            takes[speaker].append(Take(clip, load_audio(sound, RATE, start, start + clip.duration)[0]))
    references = {Path(path).parent.name: ReferenceFrames.read(path).pictures for path in snakemake.input.frames}
    corpus = collect(
        takes,
        ensemble["levels"],
        filters=settings_of(Filters(), ensemble["filters"], "ensemble.filters"),
        embeddings=ensemble["embeddings"] or None,
        references=references,
        seed=snakemake.params.seed,
    )
    corpus.write(snakemake.output.corpus)
