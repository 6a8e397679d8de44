"""What HA2G's evaluation found: one row's file, and the tables that rows end in."""

from dataclasses import dataclass, field

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.columns import BC, DIVERSITY_BY_NET, FGD_BY_NET, FGD_TRAIN_BY_NET, MEASURED
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.formats.result_table import headings, mean_and_deviation, write_table

SCHEMA = "cospeech.ha2g_evaluation"
BASELINES = ("ground_truth", "mismatched", "shuffled", "mean_pose")
# Columns of the tables by the names in a Judgement; docs/ha2g_metrics.md says what each is.
EXPRESSIVE, TRIMODAL = "expressive", "trimodal"
ABLATION = (FGD_BY_NET[EXPRESSIVE], FGD_TRAIN_BY_NET[EXPRESSIVE], BC[MEASURED], DIVERSITY_BY_NET[EXPRESSIVE])
TABLE_1 = (*ABLATION, FGD_BY_NET[TRIMODAL], FGD_TRAIN_BY_NET[TRIMODAL], DIVERSITY_BY_NET[TRIMODAL])


def columns_of(table):
    """The metrics of "ha2g_table_1", "ha2g_table_3" or "ha2g_table_4"; None, which is all, for anything else."""
    return {"ha2g_table_1": TABLE_1, "ha2g_table_3": ABLATION, "ha2g_table_4": ABLATION}.get(table)


@dataclass
class Judgement:
    """One run of one row: {metric: (value, deviation)}, NaN where it does not apply or there is none."""

    row: str
    run: int
    found: dict
    attributes: dict = field(default_factory=dict)

    def __getitem__(self, metric):
        """Value of the named metric."""
        return float(self.found[metric][0])


def write_judgements(path, judgements):
    """Runs of rows into one file (schema `cospeech.ha2g_evaluation`): group /<row>/<run>, attributes, two arrays."""
    with writing_hdf5(path, SCHEMA) as file:
        for one in judgements:
            group = file.create_group(f"{one.row}/{one.run}")
            group.attrs.update(one.attributes)
            group["metric"] = [name.encode() for name in one.found]
            put(group, "value", [value for value, _ in one.found.values()])
            put(group, "deviation", [deviation for _, deviation in one.found.values()])


def read_judgements(paths):
    """All judgements of some files, in their order; CospeechError when two are of one row and run."""
    found = {}
    for path in paths:
        with reading_hdf5(path, SCHEMA) as file:
            for row, runs in file.items():
                for run, group in runs.items():
                    if (row, int(run)) in found:
                        raise CospeechError(
                            f"{path}: run {run} of {row} is in another file too; give each its own seed"
                        )
                    found[row, int(run)] = _judgement(row, int(run), group)
    return list(found.values())


def _judgement(row, run, group):
    pairs = zip(group["value"][()].tolist(), group["deviation"][()].tolist(), strict=True)
    attributes = {k: v.item() if isinstance(v, np.generic) else v for k, v in group.attrs.items()}
    return Judgement(row, run, dict(zip((n.decode() for n in group["metric"]), pairs, strict=True)), attributes)


def write_judged(path, judgements, rows=None, columns=None, heading="row"):
    """HA2G's Tables 1, 3 and 4 as CSV: a line for each row, its number of runs, two columns a metric: mean, deviation.

    The deviation of one run is its own (diversity: over draws), that of several is over their values. `rows`: {name:
    label} of the lines, in their order; names without a judgement are left out; None: all. `columns`: metrics; None:
    all. `heading`: of the first column.
    """
    groups = {}
    for one in judgements:
        groups.setdefault(one.row, []).append(one)
    rows = {name: name for name in groups} if rows is None else rows
    columns = list(dict.fromkeys(name for one in judgements for name in one.found)) if columns is None else columns
    lines = (
        [label, len(groups[name]), *(x for metric in columns for x in merged(groups[name], metric))]
        for name, label in rows.items() if name in groups
    )  # fmt: skip
    write_table(path, [heading, "runs", *(cell for name in columns for cell in headings(name))], lines)


def merged(runs, metric):
    """(mean, deviation) of a metric over the runs of a row; of one run, its own."""
    pairs = np.array([run.found.get(metric, (np.nan, np.nan)) for run in runs], float)
    return (pairs[0, 0], pairs[0, 1]) if len(runs) == 1 else mean_and_deviation(pairs[:, 0])
