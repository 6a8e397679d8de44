"""What a question's answers look like: means with their intervals and how often each point was chosen, or strengths."""

import numpy as np

from cospeech.evaluation.variants import LABELS
from cospeech.files import writing

INK, ACCENT, GRID = "#2e343e", "#2f6fae", "#d6d8dc"
SHADES = "RdYlBu"  # of the points of a scale, lowest to highest


def label(condition):
    """A condition as the publications' tables call it."""
    return LABELS.get(condition, condition)


def plot_question(path, results, question):
    """Draw one question of `Results` as PNG: the same bytes for the same numbers."""
    import matplotlib
    from matplotlib.figure import Figure

    rows = [row for row in results.table if row.question == question]
    with matplotlib.rc_context({"font.size": 9, "text.color": INK}):
        figure = Figure(figsize=(9.0, 1.1 + 0.42 * len(rows)), layout="constrained", dpi=120)
        if results.pairs:
            _strengths(figure.subplots(), rows)
        else:
            means, shares = figure.subplots(1, 2, sharey=True)
            _means(means, rows, results.study["points"])
            _shares(shares, rows, results, question)
        figure.suptitle(results.study["questions"][question].replace("$", r"\$"), fontsize=10)
        with writing(path) as temporary:
            figure.savefig(temporary, metadata={"Software": None})


def _rows_of(axes, rows):
    axes.set_yticks(range(len(rows)), [label(row.condition).replace("$", r"\$") for row in rows])
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)


def _interval(axes, rows, value):
    middle = np.array([getattr(row, value) for row in rows])
    ends = np.array([[row.low for row in rows], [row.high for row in rows]])
    known = np.isfinite(ends).all(0)
    axes.hlines(np.flatnonzero(known), *ends[:, known], color=ACCENT, lw=2)
    axes.plot(middle, range(len(rows)), "o", color=ACCENT, ms=6)
    axes.grid(axis="x", color=GRID, lw=0.7)
    axes.set_axisbelow(True)
    _rows_of(axes, rows)


def _means(axes, rows, points):
    _interval(axes, rows, "mean")
    axes.set(xlim=(0.8, points + 0.2), xlabel="mean, 95% interval over participants")
    axes.set_xticks(range(1, points + 1))


def _shares(axes, rows, results, question):
    from matplotlib import colormaps

    points = results.study["points"]
    colors = colormaps[SHADES](np.linspace(0.08, 0.92, points))
    for y, row in enumerate(rows):
        values = [v for _, condition, _, key, v in results.answers if (condition, key) == (row.condition, question)]
        share = np.bincount(values, minlength=points + 1)[1:] / len(values)
        for point, (start, width) in enumerate(zip(np.cumsum(share) - share, share, strict=True), 1):
            axes.barh(y, width, left=start, color=colors[point - 1], label=str(point) if y == 0 else None, height=0.7)
    axes.set(xlim=(0, 1), xlabel="share of the answers")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, title="points", fontsize=8)


def _strengths(axes, rows):
    _interval(axes, rows, "strength")
    axes.axvline(0, color=INK, lw=0.7)
    axes.set_xlabel("log strength (Bradley-Terry), 95% interval over participants")
