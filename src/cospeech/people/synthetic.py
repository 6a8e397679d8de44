"""Stores of synthetic people: what the pose networks learn from where no data set is named."""

from dataclasses import replace

import numpy as np

from cospeech.people import make_people
from cospeech.posenet.store import write_store

# Room around the network's crop, to turn and shift it in: hands and faces are looked for about a body's rough joints.
MARGIN = {"body": 1.3, "hand": 1.8, "face": 1.7}
TEST = 1_000_000  # number of the first person to test with; those to train with are counted from 0
LICENCE = "synthetic people made by cospeech; no terms of their own"


def write_people(path, part, counts, *, size, seed, test=False, labelled=("studio",)):
    """Write a store of synthetic people of a part, mixed domains in one file; returns how many.

    counts : {"studio" or "wild": how many}. size : side of the network's crop, pixels.
    test : other people than without, and cut out as the network sees them, without room for augmentation.
    labelled : the domains whose 3D labels a training may use.
    """
    margin = 1.0 if test else MARGIN[part]
    side, start = round(margin * size), TEST if test else 0
    options = {"part": part, "size": side, "margin": side / size, "seed": seed, "start": start}
    batches = (
        replace(batch, labelled3d=np.full(len(batch), domain in labelled))
        for domain, n in counts.items()
        for batch in make_people(n, domain=domain, **options)
    )
    return write_store(path, batches, part=part, source="synthetic people", margin=side / size, licence_note=LICENCE)
