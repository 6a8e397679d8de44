"""One row of the results: a model, or a baseline, judged on the test clips of one speaker or of many.

Every row goes through the same low-pass, the same pieces of time and the same reference, so rows can be compared.
"""

from cospeech.evaluation.baseline_rows import HA2G_BASELINES, MISMATCHED, baseline_takes, ways_to_mismatch
from cospeech.evaluation.result import Evaluation


def evaluate_model(row, clips, reference, run=None):
    """Judge {clip id: generated Clip} for every test clip; return the Evaluation named `row`.

    run : number of the training; None for the seed that the clips say. CospeechError for a test clip that is missing or
    of another length.
    """
    seeds = {int(clip.extra.get("seed", 0)) for clip in clips.values()}
    run = min(seeds, default=0) if run is None else run
    return _evaluate(row, reference.under_speech(row, clips), reference, run)


def evaluate_baseline(row, reference, run=0):
    """Judge one of the rows of `baseline_rows.baseline_takes`; run : the way to mismatch, 0 for the first."""
    return _evaluate(row, baseline_takes(row, reference, max(run, 1)), reference, run)


def evaluate_baselines(reference):
    """Evaluations of `HA2G_BASELINES`, in their order; mismatched truth once for every way to mismatch the clips."""
    ways = range(1, ways_to_mismatch(reference) + 1)
    runs = [(row, run) for row in HA2G_BASELINES for run in (ways if row == MISMATCHED else [0])]
    return [evaluate_baseline(row, reference, run) for row, run in runs]


def _evaluate(row, takes, reference, run):
    found, values, attributes = reference.metrics.measure(row, takes, reference)
    frames = [len(take.positions) for take in takes.values()]
    return Evaluation.of(reference.subject, row, run, found, list(takes), frames, values, attributes)
