"""Line charts for the report, as pictures that stand inside the page."""

import base64
import io

import numpy as np


def line_chart(lines, x, y="", log=False):
    """A data URI of an SVG, transparent and without date: the same lines give the same bytes.

    lines: {label: (x values, y values)}, gaps where a value is NaN; x and y label the axes; `log` makes y logarithmic.
    """
    import matplotlib
    from matplotlib.figure import Figure

    # A fixed salt and no date: the same curves give the same bytes. Text stays text, without fonts to embed.
    with matplotlib.rc_context({"svg.hashsalt": "cospeech", "svg.fonttype": "none", "font.size": 9}):
        figure = Figure(figsize=(6.4, 3.2), layout="constrained")
        axes = figure.subplots()
        for label, (across, values) in lines.items():
            shown = np.isfinite(values)
            axes.plot(np.asarray(across)[shown], np.asarray(values)[shown], linewidth=1.2, label=label)
        axes.set(xlabel=x, ylabel=y, yscale="log" if log else "linear")
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        if lines:
            axes.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
        data = io.BytesIO()
        figure.savefig(data, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(data.getvalue()).decode()}"
