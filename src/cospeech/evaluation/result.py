"""What an evaluation found: one row's values in the columns there are, and the file that holds it."""

from dataclasses import dataclass, field

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.columns import METRICS
from cospeech.files import put, reading_hdf5, writing_hdf5

SCHEMA = "cospeech.evaluation"
BASELINES = ("ground_truth", "mismatched", "mean_pose")


@dataclass
class Evaluation:
    """One row: values (C, M) per clip, NaN where a metric is not one of single clips; mean and deviation (M,).

    For metrics of single clips these are over clips; FGD has one value and no deviation; the deviation of diversity is
    over draws. Columns are in the order of `METRICS`. NaN: does not apply.
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

    def __getitem__(self, metric):
        """Mean of the named metric."""
        return float(self.mean[list(METRICS).index(metric)])

    def write(self, path):
        """Write results/<subject>/evaluation/<row>.h5 (schema `cospeech.evaluation`, version 1)."""
        head = {"subject": self.subject, "row": self.row, "seed": self.seed, **self.attributes}
        with writing_hdf5(path, SCHEMA, **head) as file:
            self.put(file)

    def put(self, group):
        """Store the arrays in an open HDF5 group."""
        group["metric"] = [name.encode() for name in METRICS]
        group["unit"] = [metric.unit.encode() for metric in METRICS.values()]
        group["clip"] = [name.encode() for name in self.clips]
        for name in ("frames", "values", "mean", "deviation"):
            put(group, name, getattr(self, name))

    @classmethod
    def read(cls, path):
        """Read what `write` wrote; CospeechError when it is something else or of other metrics."""
        with reading_hdf5(path, SCHEMA) as file:
            head = {k: v.item() if isinstance(v, np.generic) else v for k, v in file.attrs.items()}
            if [name.decode() for name in file["metric"]] != list(METRICS):
                raise CospeechError(f"{path}: made by another version with other metrics; evaluate again")
            arrays = {name: file[name][()] for name in ("frames", "values", "mean", "deviation")}
            clips = [name.decode() for name in file["clip"]]
        subject, row, seed = (head.pop(name) for name in ("subject", "row", "seed"))
        attributes = {k: v for k, v in head.items() if k not in ("schema", "schema_version")}
        return cls(subject, row, seed, clips, attributes=attributes, **arrays)
