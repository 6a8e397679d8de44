"""Curves over time of what a control asks for and what came of it, after thesis figure 5.5."""

from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.control import BEFORE, FREE
from cospeech.files import writing
from cospeech.matching.control.signals import SIGNALS

PANELS = (
    ("left_wrist_height", "high"),
    ("left_wrist_speed", "fast"),
    ("left_wrist_height", "low"),
    ("left_wrist_speed", "slow"),
)
TITLES = {"left_wrist_height": "left wrist height", "left_wrist_speed": "left wrist speed"}
COLOURS = {"knn": "#2f6fae", "resync": "#d9822b", "moglow": "#3b8f5a", FREE: "#9aa2ab"}
NAMES = {"knn": "k-NN", "resync": "k-NN + cGAN", "moglow": "MoGlow", FREE: "k-NN, unconstrained"}
SUFFIXES = (".png", ".svg")


def plot_control(path, study, clip=None, seconds=20.0):
    """Draw one test clip of a `ControlStudy` as PNG or SVG, named by the suffix: the same bytes for the same numbers.

    Parameters
    ----------
    clip : id of the test clip, by default the first. seconds : how much of it is shown.
    """
    import matplotlib
    from matplotlib.figure import Figure

    suffix, clip = Path(path).suffix.lower(), clip or next(iter(study.valid))
    if suffix not in SUFFIXES:
        raise CospeechError(f"{path}: unknown suffix {suffix!r}; choose one of {' '.join(SUFFIXES)}")
    with matplotlib.rc_context({"svg.hashsalt": "cospeech", "svg.fonttype": "none", "font.size": 9}):
        figure = Figure(figsize=(9.6, 5.0), layout="constrained", dpi=110)
        panels = figure.subplots(2, 2, sharex=True).flat
        for axes, letter, (signal, level) in zip(panels, "abcd", PANELS, strict=True):
            _panel(axes, study, clip, signal, level, seconds)
            axes.set(title=f"({letter}) {TITLES[signal]}: {level}", ylabel=SIGNALS[signal].unit)
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
        figure.suptitle(f"{study.subject}, {clip}", fontsize=10)
        facts = {"Date": None, "Creator": None} if suffix == ".svg" else {"Software": None}
        with writing(path) as temporary:
            figure.savefig(temporary, metadata=facts)


def _panel(axes, study, clip, signal, level, seconds):
    frames = min(len(study.valid[clip]), round(seconds * study.fps))
    clock = np.arange(frames) / study.fps
    axes.plot(clock, study.series[clip, BEFORE, signal, FREE][:frames], color=COLOURS[FREE], lw=0.9, label=NAMES[FREE])
    for model in sorted(study.models, key=lambda model: model != BEFORE):
        line = study.series[clip, model, signal, level][:frames]
        axes.plot(clock, line, color=COLOURS.get(model), lw=1.3, label=NAMES.get(model, model))
    axes.axhline(study.thresholds[signal, level], color="#b3261e", lw=1.0, ls="--", label="threshold")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    if signal.endswith("speed"):
        axes.set_ylim(bottom=0)
    if axes.get_subplotspec().is_last_row():
        axes.set_xlabel("seconds")
