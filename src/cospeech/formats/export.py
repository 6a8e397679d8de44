"""One door for every file a clip can become; the suffix chooses."""

from pathlib import Path

from cospeech.errors import CospeechError
from cospeech.formats.bvh import write_bvh
from cospeech.formats.glb import write_glb
from cospeech.formats.ik import animation_from_clip
from cospeech.formats.table import write_csv

WRITERS = {
    ".bvh": lambda path, clip: write_bvh(path, animation_from_clip(clip)),
    ".glb": lambda path, clip: write_glb(path, animation_from_clip(clip)),
    ".csv": write_csv,
    ".h5": lambda path, clip: clip.write(path),
}


def export_clip(clip, path):
    """Write a clip as .bvh, .glb (rotations of a 55-joint skeleton), .csv (positions and face) or .h5 (the clip file).

    Raises CospeechError, naming the known suffixes, for any other.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise CospeechError(f"{path}: cannot export to {suffix or 'a file without suffix'}; use {', '.join(WRITERS)}")
    WRITERS[suffix](path, clip.validate())
