"""The comparisons of chapter 4 over several seeds: every generator, what the adversary sees, how long a window is.

One seed is a fluke on ten minutes of speech. So every network is trained with several, everything that judges motion
judges each of them on the same test part, and a table has mean and deviation over the seeds.
"""

from dataclasses import replace

import numpy as np

from cospeech.evaluation import columns
from cospeech.evaluation.baseline_rows import BASELINES
from cospeech.evaluation.columns import csv_headings
from cospeech.evaluation.evaluate import evaluate_baseline, evaluate_model
from cospeech.evaluation.generated import generate_clips
from cospeech.evaluation.metrics.lips import judge_lips
from cospeech.evaluation.metrics.sync_classifier import WARNING
from cospeech.evaluation.tables import summarise
from cospeech.formats.result_table import mean_and_deviation, write_table
from cospeech.gestures.baselines import MeanPose, RandomTake, mismatched

COLUMNS = (
    columns.FGD,
    columns.FGD_TRAIN,
    columns.DIVERSITY,
    columns.MOTION_VARIANCE,
    columns.BEAT_EXCESS,
    columns.SYNCHRONY,
    columns.SPEED_HELLINGER,
    columns.JERK,
)
LIPS, SYNC = columns.LIP_ERROR, columns.JUDGED_IN_SYNC  # kept as attributes of an Evaluation, in mm and as a share


def compare(networks, truth, train, reference, classifiers, face=None):
    """Judge networks of several seeds and the baselines: -> list of Evaluation, with `LIPS` and `SYNC` as attributes.

    Parameters
    ----------
    networks : {row: {seed: generator}}. classifiers : {seed: SyncClassifier}, each judges the networks of its seed.
    truth : {clip id: Clip}, the test part. train : list of Clip, the training part. reference : their `Reference`.
    face : see `judge_lips`.
    """
    baselines = {row: evaluate_baseline(row, reference) for row in BASELINES}
    still = {"ground_truth": truth, "mean_pose": generate_clips(MeanPose(train), truth, "mean_pose")}
    if len(truth) > 1:
        still["mismatched"] = mismatched(truth)
    found = []
    for seed, classifier in classifiers.items():
        made = {row: generate_clips(by_seed[seed], truth, row, seed) for row, by_seed in networks.items()}
        made["random"] = generate_clips(RandomTake(train), truth, "random", seed)
        lips = judge_lips(truth, made, train, face, seed)
        rows = [replace(one, seed=seed) for one in baselines.values()]
        rows += [replace(evaluate_model(row, clips, reference), seed=seed) for row, clips in made.items()]
        for one in rows:
            clips = (made | still).get(one.row, {})
            attributes = {LIPS: _lips(lips, one.row), SYNC: _in_sync(classifier, clips)}
            found.append(replace(one, attributes=one.attributes | attributes))
    return found


def _lips(lips, row):
    if row == "ground_truth":
        return 0.0 if lips.clips else float("nan")
    return lips.mean(row) if row in lips.errors else float("nan")


def _in_sync(classifier, clips):
    """Share of all clips' windows that a classifier takes for in sync with the clips' speech; NaN without any."""
    shares = [classifier.score(clip.features, clip.motion) for clip in clips.values()]
    return float(np.mean(shares)) if shares else float("nan")


def write_comparison(path, evaluations, rows):
    """A table of these rows {name in `evaluations`: label}: one line a subject and row, mean and sample deviation over
    seeds. The baselines are rows of every table. `judged in sync` is no measure of quality; a column says so.
    """
    rows = {row: row for row in (*BASELINES, "random")} | rows
    chosen = [one for row in rows for one in evaluations if one.row == row]
    subjects = list(dict.fromkeys(one.subject for one in evaluations))
    lines = sorted(summarise(chosen), key=lambda line: subjects.index(line.subject))
    heads = [heading for name in (*COLUMNS, LIPS, SYNC) for heading in csv_headings(name)]
    cells = []
    for line in lines:
        runs = [one for one in chosen if (one.subject, one.row) == (line.subject, line.row)]
        judged = [scale * np.array([one.attributes[name] for one in runs]) for name, scale in ((LIPS, 1), (SYNC, 100))]
        numbers = line.cells(COLUMNS) + [x for values in judged for x in mean_and_deviation(values)]
        cells.append([line.subject, rows[line.row], line.runs, line.clips, *numbers, WARNING])
    write_table(path, ["subject", "row", "runs", "clips", *heads, "warning"], cells)
