"""What several speakers have, by speaker: their folder under the results says who."""

from pathlib import Path

from sections import sections


def training_parts(splits, clips):
    """Clips of all speakers' training parts: <subject>/split.h5 and <subject>/clips/<take>.h5 of each."""
    parts = []
    for split in splits:
        own = [path for path in clips if Path(path).parents[1] == Path(split).parent]
        parts += sections(split, "train", own)[0]
    return parts


def test_name(path):
    """<subject>/synthesis/<model>/<clip>.h5 -> "<subject>/<clip>"."""
    return f"{Path(path).parents[2].name}/{Path(path).stem}"
