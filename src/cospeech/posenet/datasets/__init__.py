"""Data sets of people, read from the files as their owners ship them: `open_dataset(name, folder)` gives `Sample`s.

Nothing is converted or extracted beforehand. What cannot be used is left out and counted in `DataSet.dropped`.
"""

import importlib
import inspect
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from cospeech.errors import CospeechError

READERS = {  # name: (module, function)
    "mpi_inf_3dhp_train": ("mpi_inf_3dhp", "train"),
    "mpi_inf_3dhp_test": ("mpi_inf_3dhp", "test"),
    "h36m": ("h36m", "h36m"),
    "mpii": ("mpii", "mpii"),
    "lsp": ("lsp", "lsp"),
    "lspet": ("lsp", "lspet"),
    "coco_wholebody": ("coco_wholebody", "coco_wholebody"),
}
LICENCES = {
    "mpi_inf_3dhp": "MPI-INF-3DHP: non-commercial research only",
    "h36m": "Human3.6M: academic research only, by agreement with its owners",
    "mpii": "MPII Human Pose: non-commercial research; its images belong to their authors",
    "lsp": "Leeds Sports Pose: its images belong to their authors",
    "coco_wholebody": "COCO-WholeBody: annotations for non-commercial research; images under their Flickr terms",
}


@dataclass
class DataSet:
    """An iterable of `Sample`s, from the start each time. dropped {reason: count}: what the last pass left out."""

    name: str
    folder: Path
    part: str
    read: object
    licence_note: str
    dropped: Counter = field(default_factory=Counter)

    def __iter__(self):
        self.dropped.clear()
        count = 0
        for sample in self.read(self.folder, self.dropped):
            count += 1
            yield sample
        self.dropped += Counter()  # keeps what is above zero
        if not count:
            reasons = "; ".join(f"{number} {reason}" for reason, number in self.dropped.items()) or "nothing found"
            raise CospeechError(f"{self.folder}: no usable sample of {self.name} ({reasons})")


def open_dataset(name, folder, **options):
    """A data set as an iterable of `cospeech.posenet.samples.Sample`.

    Parameters
    ----------
    name : one of `READERS`. folder : where its files lie, as the owners ship them.
    options : of the reader (docs/posenet_data.md): `every`, `subset`, `scale`, `occluded`, `part`...

    Raises CospeechError when the name, the folder or an option is wrong; files are looked at when it is iterated.
    """
    if name not in READERS:
        raise CospeechError(f"data set {name!r} is unknown; known: {', '.join(READERS)}")
    folder = Path(folder)
    if not folder.is_dir():
        raise CospeechError(f"{folder}: no such folder; give the one that holds {name} as its owners ship it")
    module, function = READERS[name]
    reader = getattr(importlib.import_module(f"{__name__}.{module}"), function)
    known = list(inspect.signature(reader).parameters)[2:]
    if unknown := sorted(options.keys() - set(known)):
        raise CospeechError(f"{name}: has no option {unknown[0]!r}; it has {', '.join(known) or 'none'}")
    part = options.get("part", "hand") if name == "coco_wholebody" else "body"
    return DataSet(name, folder, part, lambda *where: reader(*where, **options), LICENCES[module])
