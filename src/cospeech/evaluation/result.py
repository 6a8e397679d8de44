"""What an evaluation found: one row's values, and the file that holds it."""

from dataclasses import dataclass, field

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.columns import KNOWN, METRICS
from cospeech.files import put, reading_hdf5, writing_hdf5

SCHEMA = "cospeech.evaluation"
MANY = "cospeech.evaluations"
HA2G = "cospeech.ha2g_evaluation"  # how earlier versions kept HA2G's rows: group /<row>/<run>, without a subject
ARRAYS = ("frames", "values", "mean", "deviation")


@dataclass
class Evaluation:
    """One run of one row: values (C, M) per clip, NaN where a metric is not one of single clips; mean, deviation (M,).

    For metrics of single clips these are over clips, with the deviation of the sample; FGD has one value and no
    deviation; the deviation of diversity is over draws. Columns are in the order of `metrics`. NaN: does not apply.
    """

    subject: str
    row: str
    seed: int
    clips: list
    frames: np.ndarray
    values: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    attributes: dict = field(default_factory=dict)
    metrics: tuple = tuple(METRICS)

    @classmethod
    def of(cls, subject, row, seed, found, clips=(), frames=(), values=None, attributes=None):
        """From {metric: (mean, deviation)}; `values` None: no metric is one of single clips."""
        mean, deviation = np.array(list(found.values()), float).reshape(-1, 2).T.copy()
        values = np.full((len(clips), len(found)), np.nan) if values is None else values
        head = subject, row, seed, list(clips), np.array(frames, int)
        return cls(*head, values, mean, deviation, attributes or {}, tuple(found))

    @property
    def found(self):
        """{metric: (mean, deviation)}"""
        return dict(zip(self.metrics, zip(self.mean, self.deviation, strict=True), strict=True))

    def __getitem__(self, metric):
        """Mean of the named metric."""
        return float(self.mean[self.metrics.index(metric)])

    def write(self, path):
        """Write results/<subject>/evaluation/<row>.h5 (schema `cospeech.evaluation`, version 1)."""
        head = {"subject": self.subject, "row": self.row, "seed": self.seed, **self.attributes}
        with writing_hdf5(path, SCHEMA, **head) as file:
            self.put(file)

    def put(self, group):
        """Store the arrays in an open HDF5 group."""
        group["metric"] = [name.encode() for name in self.metrics]
        group["unit"] = [KNOWN[name].unit.encode() for name in self.metrics]
        group["clip"] = [name.encode() for name in self.clips]
        for name in ARRAYS:
            put(group, name, getattr(self, name))

    @classmethod
    def read(cls, path):
        """Read what `write` wrote; CospeechError when it is something else or of other metrics."""
        with reading_hdf5(path, SCHEMA) as file:
            return _single(file, path)


def write_many(path, evaluations):
    """Any number of evaluations in one file (schema `cospeech.evaluations`), each as group /<subject>/<row>/<seed>."""
    with writing_hdf5(path, MANY) as file:
        for evaluation in evaluations:
            name = f"{evaluation.subject}/{evaluation.row}/{evaluation.seed}"
            if name in file:
                raise CospeechError(f"{path}: two evaluations of {name}; give each run a seed of its own")
            group = file.create_group(name)
            group.attrs.update(evaluation.attributes)
            evaluation.put(group)


def read_many(path):
    """Evaluations of a file of either schema, by subject, row and seed; also of HA2G's files of earlier versions."""
    with reading_hdf5(path, (SCHEMA, MANY, HA2G)) as file:
        schema = file.attrs["schema"]
        if schema == SCHEMA:
            return [_single(file, path)]
        if schema == HA2G:
            return [_earlier(group, row, int(run)) for row, runs in file.items() for run, group in runs.items()]
        return [
            _from(group, path, subject, row, int(seed), _attributes(group))
            for subject, rows in file.items()
            for row, seeds in rows.items()
            for seed, group in seeds.items()
        ]


def _single(file, path):
    head = _attributes(file)
    subject, row, seed = (head.pop(name) for name in ("subject", "row", "seed"))
    return _from(file, path, subject, row, seed, head)


def _from(group, path, subject, row, seed, attributes):
    metrics = tuple(name.decode() for name in group["metric"])
    if not set(metrics) <= set(KNOWN):
        raise CospeechError(f"{path}: made by another version with other metrics; evaluate again")
    arrays = {name: group[name][()] for name in ARRAYS}
    clips = [name.decode() for name in group["clip"]]
    return Evaluation(subject, row, seed, clips, attributes=attributes, metrics=metrics, **arrays)


def _earlier(group, row, run):
    names = (name.decode() for name in group["metric"])
    pairs = zip(group["value"][()], group["deviation"][()], strict=True)
    return Evaluation.of("", row, run, dict(zip(names, pairs, strict=True)), attributes=_attributes(group))


def _attributes(group):
    found = {name: value.item() if isinstance(value, np.generic) else value for name, value in group.attrs.items()}
    return {name: value for name, value in found.items() if name not in ("schema", "schema_version")}
