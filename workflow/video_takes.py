"""The takes of a subject of kind video: where each film lies or shall lie, and which cannot be had now."""

from pathlib import Path

from cospeech.capture.film.media import can_fetch, is_address, placeholder, read_takes
from cospeech.errors import CospeechError


def film_takes(source, folder, path):
    """(takes, absent): the entries of `source`, each with the `film` it is seen in, and {id: line} of those without.

    folder: results/<subject>/media. The film of an address belongs there under the name of the first take that needs
    it; `url` says so. A film that neither is there nor can be fetched makes its takes absent, and the others go on.
    Raises CospeechError if no take is left.
    """
    takes = source.get("takes")
    if takes is None:
        takes = read_takes(source["manifest"], source.get("speaker"), source.get("videos"))
    owners, present, absent = {}, [], {}
    for take in takes:
        video = take["video"]
        if is_address(video):
            film = Path(folder) / f"{owners.setdefault(video, take['id'])}.mp4"
            there, line = film.is_file() or can_fetch(), placeholder(video, film)
            take = take | {"film": str(film), "url": video}
        else:
            there, line = Path(video).is_file(), f"{video}: no such file"
            take = take | {"film": video}
        if there:
            present.append(take)
        else:
            absent[take["id"]] = f"{path}: take {take['id']!r}: {line}"
    if not present:
        raise CospeechError(next(iter(absent.values())))
    return present, absent


def precomputed_of(folder, take):
    """What another program saw in a take: <folder>/<take>.h5, .npz, or a folder of that name."""
    choices = [Path(folder) / f"{take}{suffix}" for suffix in (".h5", ".npz", "")]
    return str(next((choice for choice in choices if choice.exists()), choices[0]))
