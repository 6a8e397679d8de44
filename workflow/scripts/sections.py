"""The stretches of a subject's clips that belong to one part."""

from pathlib import Path

from cospeech.clip import Clip
from cospeech.split import Split


def sections(split, part, paths):
    """Clips of the part's frame ranges alone, and where each starts in its take (seconds); `paths` holds its takes."""
    clips = {Path(path).stem: Clip.read(path) for path in paths}
    ranges = [(clips[take], start, stop) for take, start, stop in Split.read(split).of(part)]
    return [clip.section(start, stop) for clip, start, stop in ranges], [start / clip.fps for clip, start, _ in ranges]
