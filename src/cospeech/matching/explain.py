"""Tables for people: where a motion is from, and what can be controlled."""

from cospeech.matching.control.controls import OUTER
from cospeech.matching.control.signals import SIGNALS
from cospeech.matching.database.descriptors import WINDOW


def explain(trace, fps):
    """A table, one line per window of a `Trace` and per change of source inside one."""
    rows = [("seconds", "source", "pose rank", "audio rank", "pose dist.", "audio dist.", "left", "control")]
    columns, texts = trace.columns, {name: trace.texts(name) for name in trace.labels}
    for t in range(len(columns["time"])):
        known = columns["take"][t] >= 0
        if t % WINDOW and columns["take"][t] == columns["take"][t - 1] and _goes_on(columns["time"], t, fps, known):
            continue
        source = f"{texts['take'][t]} {columns['time'][t]:.2f} s" if known else "generated"
        numbers = [columns[name][t] for name in ("pose_rank", "audio_rank", "pose_distance", "audio_distance")]
        cells = ["-" if n < 0 else f"{n}" if i < 2 else f"{n:.2f}" for i, n in enumerate(numbers)]
        left = "-" if columns["candidates"][t] < 0 else str(columns["candidates"][t])
        step = f" ({texts['widened'][t]})" if texts["widened"][t] else ""
        rows.append((f"{t / fps:.2f}", source, *cells, left, texts["control"][t] + step))
    head = ", ".join(f"{name} {value}" for name, value in trace.settings.items())
    return "\n".join([head, table(rows)] if head else [table(rows)])


def _goes_on(time, t, fps, known):
    return not known or abs(time[t] - time[t - 1] - 1 / fps) < 0.5 / fps


def listing(signals=None):
    """A table of what can be controlled; with a subject's `ControlSignals`, of the thresholds of its levels too."""
    rows = [("signal", "levels", "unit", "")]
    for name, one in SIGNALS.items():
        levels = f"{one.lower}, {one.upper}"
        if signals:
            low, high = (signals.percentile(name, percentile) for percentile in (100 - OUTER, OUTER))
            levels = f"{one.lower} <= {low:.3f}, {one.upper} >= {high:.3f}"
        rows.append((name, levels, one.unit, one.about))
    return table(rows)


def table(rows):
    """Rows of texts as aligned lines."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
