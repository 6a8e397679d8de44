"""From files of evaluations to one file of all, to CSV files, and to the cells of the report's tables."""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.baseline_rows import BASELINES
from cospeech.evaluation.columns import METRICS, csv_headings
from cospeech.evaluation.result import read_many
from cospeech.formats.result_table import mean_and_deviation, plus_minus, write_table

FIRST = {"subject": "subject", "row": "row", "runs": "runs", "clips": "clips"}  # {heading: of a Summary}


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
        """Mean and deviation of each of these metrics, one after the other; NaN where it was not measured."""
        return [x.get(name, np.nan) for name in metrics for x in (self.mean, self.deviation)]


def read_evaluations(paths):
    """Evaluations of the files `paths`, by subject, then baselines before models, in the order given.

    CospeechError when two are of one row and run.
    """
    evaluations, known = [], set()
    for path in paths:
        for one in read_many(path):
            if (one.subject, one.row, one.seed) in known:
                raise CospeechError(
                    f"{path}: run {one.seed} of {one.row} is in another file too; give each its own seed"
                )
            known.add((one.subject, one.row, one.seed))
            evaluations.append(one)
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
    found = [run.found for run in runs]
    metrics = list(dict.fromkeys(name for one in found for name in one))
    pairs = np.array([[one.get(name, (np.nan, np.nan)) for name in metrics] for one in found], float)
    mean, deviation = mean_and_deviation(pairs[:, :, 0])
    deviation = pairs[0, :, 1] if len(runs) == 1 else deviation
    columns = [dict(zip(metrics, map(float, values), strict=True)) for values in (mean, deviation)]
    return Summary(subject, row, len(runs), len(runs[0].clips), *columns)


def write_csv(path, evaluations, metrics=tuple(METRICS), rows=None, first=FIRST, headings=csv_headings):
    """A CSV file, results/summary.csv say: one line a subject and row; two columns a metric, "n/a" where it is none.

    metrics : names; None for all that were found. rows : {name: label} of the lines, in their order, names without an
    evaluation left out; None for all. first : {heading: attribute of a Summary} of the columns before. headings : of a
    metric.
    """
    lines = summarise(evaluations)
    if rows is not None:
        lines = [line for row in rows for line in lines if line.row == row]
    if metrics is None:
        metrics = list(dict.fromkeys(name for line in lines for name in line.mean))
    shown = lambda line, name: (rows or {}).get(line.row, line.row) if name == "row" else getattr(line, name)
    write_table(
        path,
        [*first, *(heading for name in metrics for heading in headings(name))],
        ([*(shown(line, name) for name in first.values()), *line.cells(metrics)] for line in lines),
    )


def cell(line, metric):
    """`plus_minus` of a metric in a `Summary`."""
    return plus_minus(line.mean[metric], line.deviation[metric])
