"""Numbers of a study: means and deviations, Wilcoxon's test for pairs of methods, strengths after Bradley and Terry."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import stats
from scipy.special import expit

from cospeech.formats.result_table import mean_and_deviation

CONFIDENCE = 0.95
RESAMPLES = 1000  # of participants, for intervals of strengths
PRIOR = 0.5  # wins of both sides, a draw, added to every pair where somebody has won or lost all: else infinite


@dataclass(frozen=True)
class Line:
    """A condition's row of a table: mean and deviation (n - 1) over all ratings, and the interval of the mean over
    participants (Student's t), NaN where there is one participant."""

    condition: str
    question: str
    participants: int
    ratings: int
    mean: float
    deviation: float
    low: float
    high: float


@dataclass(frozen=True)
class Comparison:
    """Two conditions: mean difference a - b over `participants`, Wilcoxon's statistic, p, and p after Holm."""

    question: str
    a: str
    b: str
    participants: int
    difference: float
    statistic: float
    p: float
    p_holm: float


@dataclass(frozen=True)
class Strength:
    """A condition among pairs: wins (a draw is half), comparisons, and log strength with its bootstrap interval."""

    condition: str
    question: str
    wins: float
    comparisons: int
    strength: float
    low: float
    high: float


def summarise(ratings, question, conditions):
    """[Line] of ratings {condition: {participant: [value, ...]}}, in the order of `conditions`."""
    lines = []
    for condition in conditions:
        people = ratings[condition]
        values = np.concatenate([np.asarray(v, float) for v in people.values()])
        means = np.array([np.mean(v) for v in people.values()])
        middle, apart = mean_and_deviation(means)
        half = stats.t.ppf((1 + CONFIDENCE) / 2, max(len(means) - 1, 1)) * apart / np.sqrt(len(means))
        found = (*mean_and_deviation(values), middle - half, middle + half)
        lines.append(Line(condition, question, len(people), len(values), *map(float, found)))
    return lines


def compare(scores, question, conditions):
    """[Comparison] of all pairs of conditions, of scores {condition: {participant: number}}; Holm over these pairs."""
    rows = []
    for a, b in combinations(conditions, 2):
        people = sorted(scores[a].keys() & scores[b].keys())
        rows.append((a, b, [scores[a][one] - scores[b][one] for one in people]))
    return tests(rows, question)


def tests(rows, question):
    """[Comparison] of [(a, b, differences of participants)]; Holm's correction over all of them."""
    found = [signed_rank(differences) for _, _, differences in rows]
    corrected = holm([p for _, p in found])
    return [
        Comparison(question, a, b, len(d), float(np.mean(d)), statistic, p, float(adjusted))
        for (a, b, d), (statistic, p), adjusted in zip(rows, found, corrected, strict=True)
    ]


def signed_rank(differences):
    """(statistic, p) of Wilcoxon's signed-rank test, two-sided; differences of zero are left out, p = 1 if all are."""
    differences = np.round(np.asarray(differences, float), 9)  # means of whole numbers: equal ones must tie
    if not differences.any():
        return 0.0, 1.0
    found = stats.wilcoxon(differences, zero_method="wilcox")
    return float(found.statistic), float(found.pvalue)


def holm(p):
    """Holm's step-down correction of p values, in their order."""
    p = np.asarray(p, float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate((len(p) - np.arange(len(p))) * p[order]), 1)
    return adjusted


# ---------------------------------------------------------------------------------------------------- Bradley and Terry


def bradley_terry(wins, prior=0.0):
    """Log strengths (..., M) of wins (..., M, M), entry i, j the times that i won over j (a draw counts half for both).

    Maximum likelihood of P(i over j) = 1 / (1 + e^(sj - si)) (Bradley and Terry, Biometrika 39, 1952) by Newton's
    method, with mean 0. `prior` wins are added to both sides of every pair. NaN where no finite answer exists:
    somebody has won, or lost, against all others.
    """
    wins = np.asarray(wins, float)
    size = wins.shape[-1]
    wins = (wins + prior) * (1 - np.eye(size))
    finite = connected(wins)[..., None]
    wins = np.where(finite[..., None], wins, 1 - np.eye(size))
    played, strength = wins + np.swapaxes(wins, -1, -2), np.zeros(wins.shape[:-1])
    for _ in range(100):
        chance = expit(strength[..., :, None] - strength[..., None, :])
        slope = (wins - played * chance).sum(-1)
        weight = played * chance * (1 - chance)
        curvature = weight.sum(-1)[..., None] * np.eye(size) - weight + 1 / size  # the last: strengths keep their mean
        step = np.linalg.solve(curvature, slope[..., None])[..., 0]
        strength = strength + np.clip(step, -1, 1)
        if np.abs(step).max(initial=0) < 1e-10:
            break
    return np.where(finite, strength - strength.mean(-1, keepdims=True), np.nan)


def connected(wins):
    """Whether, in wins (..., M, M), everybody has beaten everybody, if through others: then strengths are finite."""
    reach = (wins > 0) | np.eye(wins.shape[-1], dtype=bool)
    for _ in range(max(wins.shape[-1] - 1, 1).bit_length()):
        reach = (reach.astype(np.int64) @ reach.astype(np.int64)) > 0
    return reach.all((-1, -2))


def strengths(duels, question, conditions, seed=0, resamples=RESAMPLES):
    """([Strength], finite) of duels (P, M, M), the wins of each participant; intervals by resampling participants.

    Where somebody has won or lost against all, a draw is added between every two (`finite` is False); so it is in the
    resamples of which that is true.
    """
    duels = np.asarray(duels, float)
    total = duels.sum(0)
    finite = bool(connected(total))
    best = bradley_terry(total, 0.0 if finite else PRIOR)
    picks = np.random.default_rng(seed).integers(len(duels), size=(resamples, len(duels)))
    again = duels[picks].sum(1)
    spread = bradley_terry(again) if finite else bradley_terry(again, PRIOR)
    lost = np.isnan(spread).any(-1)
    spread[lost] = bradley_terry(again[lost], PRIOR)
    low, high = np.quantile(spread, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    played = (total + total.T).sum(-1)
    return [
        Strength(name, question, float(total[i].sum()), round(played[i]), float(best[i]), float(low[i]), float(high[i]))
        for i, name in enumerate(conditions)
    ], finite
