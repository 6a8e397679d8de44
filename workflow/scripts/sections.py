"""The stretches of a subject's clips that belong to one part, and what a training's input files hold."""

from pathlib import Path

from cospeech.clip import Clip
from cospeech.gestures.generator import Recordings
from cospeech.split import Split


def sections(split, part, paths):
    """Clips of the part's frame ranges alone, and where each starts in its take (seconds); `paths` holds its takes."""
    clips = {Path(path).stem: Clip.read(path) for path in paths}
    ranges = [(clips[take], start, stop) for take, start, stop in Split.read(split).of(part)]
    return [clip.section(start, stop) for clip, start, stop in ranges], [start / clip.fps for clip, start, _ in ranges]


def recordings(files):
    """The `Recordings` of a rule's input: `split` and `clips`, perhaps `database`; or `corpus`, perhaps `imagenet`."""
    if files.get("corpus"):
        from cospeech.gestures.ha2g.dataset.corpus import Corpus

        return Recordings(corpus=Corpus.read(files.corpus), imagenet=files.get("imagenet") or None)
    clips, starts = sections(files.split, "train", files.clips)
    if not files.get("database"):
        return Recordings(clips, starts)
    from cospeech.matching import Database

    return Recordings(clips, starts, Database.load(files.database))
