"""One set of bone lengths for a speaker, from all of their takes, kept in a file beside the tracks."""

import numpy as np

from cospeech.capture.cleanup.assemble import assemble, in_metres
from cospeech.capture.cleanup.clean import speaker_bones
from cospeech.errors import CospeechError, notice
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.skeleton import UPPER55
from cospeech.track import Track

SCHEMA = "cospeech.bones"


def measure_bones(paths):
    """(55,) metres of the speaker of these track files; takes without a usable body are told and left out."""
    takes, rates = [], []
    for path in paths:
        try:
            track = Track.read(path)
            if track.refused:
                raise CospeechError(f"{path}: {track.refused}")
            observed = in_metres(assemble(track, path))
        except CospeechError as error:
            notice(f"{error}; left out of the speaker's bone lengths")
            continue
        if observed.seen.any():
            takes.append(observed)
            rates.append(track.fps)
    if not takes:
        raise CospeechError(f"{paths[0] if paths else 'no tracks'}: no take of the speaker shows a body")
    return speaker_bones(takes, rates)


def write_bones(path, bones, subject=""):
    """Write them (schema `cospeech.bones`, version 1)."""
    with writing_hdf5(path, SCHEMA, subject=subject, skeleton=UPPER55.name, units="m") as file:
        put(file, "lengths", np.asarray(bones, np.float64))


def read_bones(path):
    """(55,) metres; CospeechError for another file."""
    with reading_hdf5(path, SCHEMA) as file:
        return file["lengths"][()]
