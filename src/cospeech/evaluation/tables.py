"""From one file a row to results/evaluation.h5, results/summary.csv and the cells of the report's tables."""

import csv
import math
from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.result import BASELINES, METRICS, Evaluation
from cospeech.files import writing, writing_hdf5
from cospeech.formats.result_table import mean_and_deviation

SCHEMA = "cospeech.evaluations"
ABSENT = "n/a"


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
    with writing(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(
            ["subject", "row", "runs", "clips", *(heading for name in metrics for heading in headings(name))]
        )
        for line in summarise(evaluations):
            cells = (number(x) for name in metrics for x in (line.mean[name], line.deviation[name]))
            table.writerow([line.subject, line.row, line.runs, line.clips, *cells])


def headings(metric):
    """The two CSV headings of a metric: `jerk [m/s^3]`, `jerk deviation [m/s^3]`."""
    unit = f" [{METRICS[metric].unit}]" if METRICS[metric].unit else ""
    return f"{metric}{unit}", f"{metric} deviation{unit}"


def number(value, digits=6):
    """`value` with so many significant digits, or "n/a"."""
    return f"{value:.{digits}g}" if math.isfinite(value) else ABSENT


def cell(line, metric):
    """A table cell for people: `0.412 ± 0.051`, `0.412` where there is no deviation, `n/a` where it does not apply.

    Both numbers have as many decimals as the mean needs for three significant digits.
    """
    mean, deviation = line.mean[metric], line.deviation[metric]
    if not math.isfinite(mean):
        return ABSENT
    decimals = min(6, max(0, 2 - math.floor(math.log10(abs(mean))))) if mean else 2
    spread = f" ± {deviation:.{decimals}f}" if math.isfinite(deviation) else ""
    return f"{mean:.{decimals}f}{spread}"
