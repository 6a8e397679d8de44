"""The ablation of Table 3.6: four ways to train on the same people, each over several seeds, tested on `wild`.

All rows share network, iterations and 2D pre-training. The baseline's second stage learns from 3D-labelled people
alone, by joints and bone vectors. "+ 2D latent loss" adds people with 2D labels and supervises the heatmaps;
"+ projection loss" adds them and compares the projected pose with the labels. Bone lengths (equation 3.6) act wherever
people with 2D labels alone do.
"""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import reading_hdf5
from cospeech.formats.result_table import fixed, headings, mean_and_deviation, write_table
from cospeech.posenet.evaluation.accuracy import METRICS, SCHEMA

TITLES = {
    "baseline": "baseline (direct 3D prediction + bone loss)",
    "latent": "+ 2D latent loss + outdoor data",
    "projection": "+ 3D-to-2D projection loss + outdoor data",
    "both": "+ 2D latent loss + outdoor data + 3D-to-2D projection loss",
}


def write_ablation(path, evaluations, domain="wild", protocol="globally scaled"):
    """Write Table 3.6 as CSV: a line a row, mean and deviation over seeds of each metric.

    evaluations : {row of TITLES: [paths of evaluation.h5, one a seed]}. The deviation is of the sample, n/a for one.
    """
    lines = []
    for row, paths in evaluations.items():
        found = mean_and_deviation(np.array([_values(path, domain, protocol) for path in paths]))
        cells = (fixed(x, 2) for pair in zip(*found, strict=True) for x in pair)
        lines.append([row, TITLES[row], len(paths), *cells])
    write_table(path, ["row", "method", "seeds", *(heading for name in METRICS for heading in headings(name))], lines)


def _values(path, domain, protocol):
    with reading_hdf5(path, SCHEMA) as file:
        keys = zip(*(file[f"table/{name}"].asstr()[()] for name in ("domain", "row", "protocol")), strict=True)
        table = dict(zip(keys, file["table/values"][()], strict=True))
    if (domain, "posenet", protocol) not in table:
        raise CospeechError(f"{path}: has no people of the domain {domain!r}; test on some")
    return table[domain, "posenet", protocol]
