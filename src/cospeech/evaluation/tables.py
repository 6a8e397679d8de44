"""From one file a row to results/evaluation.h5, results/summary.csv and the cells of the report's tables."""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.columns import METRICS, csv_headings
from cospeech.evaluation.result import BASELINES, Evaluation
from cospeech.files import writing_hdf5
from cospeech.formats.result_table import mean_and_deviation, plus_minus, write_table

SCHEMA = "cospeech.evaluations"


@dataclass
class Summary:
    """One line of a table: {metric: mean}, {metric: deviation}; `runs` seeds, `clips` test clips, NaN where n/a.

    Sample deviations: that of one run is over clips (diversity: over draws), that of several over the runs' means.
    """

    subject: str
    row: str
    runs: int
    clips: int
    mean: dict
    deviation: dict

    def cells(self, metrics):
        """Mean and deviation of each of these metrics, one after the other."""
        return [x for name in metrics for x in (self.mean[name], self.deviation[name])]


def read_evaluations(paths):
    """Evaluations of the files `paths`, by subject, then baselines before models, in the order given."""
    evaluations = [Evaluation.read(path) for path in paths]
    if not evaluations:
        raise CospeechError("summary: no evaluation file was given")
    subjects = list(dict.fromkeys(e.subject for e in evaluations))
    rank = {row: i for i, row in enumerate(BASELINES)}
    return sorted(evaluations, key=lambda e: (subjects.index(e.subject), rank.get(e.row, len(rank))))


def summarise(evaluations):
    """List of Evaluation -> list of Summary, one for each subject and row, runs of several seeds merged."""
    groups = {}
    for evaluation in evaluations:
        groups.setdefault((evaluation.subject, evaluation.row), []).append(evaluation)
    return [_summary(subject, row, runs) for (subject, row), runs in groups.items()]


def _summary(subject, row, runs):
    means = np.array([run.mean for run in runs])
    mean, deviation = mean_and_deviation(means)
    deviation = runs[0].deviation if len(runs) == 1 else deviation
    columns = [dict(zip(METRICS, map(float, values), strict=True)) for values in (mean, deviation)]
    return Summary(subject, row, len(runs), len(runs[0].clips), *columns)


def write_hdf5(path, evaluations):
    """results/evaluation.h5: the content of every evaluation file as group /<subject>/<row>/<seed>."""
    with writing_hdf5(path, SCHEMA) as file:
        for evaluation in evaluations:
            name = f"{evaluation.subject}/{evaluation.row}/{evaluation.seed}"
            if name in file:
                raise CospeechError(f"{path}: two evaluations of {name}; give each run a seed of its own")
            group = file.create_group(name)
            group.attrs.update(evaluation.attributes)
            evaluation.put(group)


def write_csv(path, evaluations, metrics=tuple(METRICS)):
    """results/summary.csv: one line a subject and row; two columns a metric, mean and deviation, "n/a" where none."""
    head = ["subject", "row", "runs", "clips", *(heading for name in metrics for heading in csv_headings(name))]
    write_table(
        path,
        head,
        ([line.subject, line.row, line.runs, line.clips, *line.cells(metrics)] for line in summarise(evaluations)),
    )


def cell(line, metric):
    """`plus_minus` of a metric in a `Summary`."""
    return plus_minus(line.mean[metric], line.deviation[metric])
