"""results/report.html: one file that opens offline, with tables, curves, films and the facts they were made from."""

import base64
import csv
import io
import math
import os
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from urllib.parse import quote

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.evaluation.result import BASELINES, METRICS
from cospeech.evaluation.tables import cell
from cospeech.evaluation.variants import LABELS
from cospeech.evaluation.variants import METRICS as COMPARED
from cospeech.files import reading_hdf5, writing
from cospeech.render.control import control_section

FILMS, FILM_BYTES = 12, 40e6  # embedded at most; the others are linked
ARROWS = {"lower": "↓ lower is better", "higher": "↑ higher is better", "truth": "≈ close to ground truth is better"}
ROWS = {"ground_truth": "ground truth", "mismatched": "mismatched ground truth", "mean_pose": "mean pose"}
MEANING = {
    "fgd": "Fréchet distance between features of 34-frame windows of this motion and of the test recordings; it judges "
    "whether the poses look like the speaker's, not whether they fit the speech.",
    "fgd_train": "The same against the training part: how far the test recordings themselves are from it shows how "
    "much of a distance is only chance.",
    "diversity": "Mean distance between features of random pairs of windows; a mean pose has none, noise has too much.",
    "beat_consistency": "How close each speech onset has a motion beat, 0 to 1; many beats alone already raise it, so "
    "read it together with the beat rate and the mismatched row.",
    "beat_excess": "Beat consistency less what the same beats score against the speech at any other time: 0 is chance, "
    "and more beats do not raise it.",
    "beat_rate": "Motion beats a second.",
    "synchrony": "Correlation of wrist speed with what the speech predicts; the mismatched row shows what is left when "
    "motion and speech have nothing to do with each other.",
    "motion_variance": "Variance of the joints over time; regression to the mean makes it small.",
    "wrist_speed_left": "Mean speed of the wrist.",
    "wrist_speed_right": "Mean speed of the wrist.",
    "wrist_speed_spread": "Standard deviation of the wrists' speeds over time.",
    "wrist_height_left": "Mean height of the wrist above the pelvis.",
    "wrist_height_right": "Mean height of the wrist above the pelvis.",
    "wrist_height_spread": "Standard deviation of the wrists' heights over time.",
    "wrist_asymmetry": "Mean difference of the wrists' heights.",
    "speed_hellinger": "Distance between the histograms of joint speeds, 0 (equal) to 1.",
    "acceleration": "Mean size of the joints' acceleration.",
    "jerk": "Mean size of the change of acceleration; jitter makes it large, over-smoothing small.",
}


def write_report(
    path, *, title, evaluation=(), histories=None, videos=(), config="", versions=None, timings=(), notices=(),
    subtitle="", film_bytes=FILM_BYTES, control=(), variants=(), figures=(),
):  # fmt: skip
    """Write the report as one HTML file that needs no other file and no network.

    Parameters
    ----------
    evaluation : list of `cospeech.evaluation.tables.Summary`, one a subject and row.
    histories : {label: path of a history.h5}; every loss term becomes a curve.
    videos : list of (label, path of an mp4). The first 12 that fit into `film_bytes` together are embedded; the others
        are linked by their path relative to the report.
    control : list of `cospeech.evaluation.control.ControlRow`; figures : list of (label, path) shown beside them.
    variants : list of Summary, of the search's variants and what they are compared with (thesis Table 5.4).
    config : the configuration as text (YAML). versions : {package: version}. notices : lines worth knowing.
    timings : list of (label, path of a benchmark TSV with the columns s and max_rss), or {label: path}.

    Whatever is empty has no section. Text is escaped. Same input, same bytes.
    """
    timings = list(timings.items() if isinstance(timings, dict) else timings)
    sections = {
        "Evaluation": _evaluation(evaluation),
        "Control": control_section(control, figures),
        "Variants": _variants(variants),
        "Films": _films(videos, Path(path).parent, film_bytes),
        "Training": _curves(histories or {}),
        "Notices": _notices(notices),
        "Run times": _timings(timings),
        "Configuration": f'<div class="card"><pre>{escape(config)}</pre></div>' if config else "",
        "Versions": _versions(versions or {}),
    }
    present = {name: body for name, body in sections.items() if body}
    anchor = {name: name.lower().replace(" ", "-") for name in present}
    page = Template((files("cospeech.render") / "report.html").read_text(encoding="utf-8")).substitute(
        title=escape(title),
        subtitle=escape(subtitle),
        navigation="".join(f'<a href="#{anchor[name]}">{name}</a>' for name in present),
        sections="\n".join(f'<section id="{anchor[name]}"><h2>{name}</h2>\n{body}</section>'
                           for name, body in present.items()),
    )  # fmt: skip
    with writing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


# -------------------------------------------------------------------------------------------------------- evaluation


def _evaluation(summaries):
    if not summaries:
        return ""
    metrics = [name for name in METRICS if any(math.isfinite(line.mean.get(name, math.nan)) for line in summaries)]
    subjects = dict.fromkeys(line.subject for line in summaries)
    tables = [f"<h3>{escape(subject)}</h3>" + _table([line for line in summaries if line.subject == subject], metrics)
              for subject in subjects]  # fmt: skip
    explained = "".join(
        f"<dt>{escape(METRICS[name].label)}</dt>"
        f'<dd>{escape(MEANING.get(name, ""))} <span class="soft">{ARROWS[METRICS[name].better]}</span></dd>'
        for name in metrics
    )
    return f"""<p>Shaded rows are no models: recorded motion, recorded motion under other speech, and a pose that never
moves. A number means little without them. Values are mean ± standard deviation: over seeds where there are several
runs, over test clips where there is one; differences smaller than the deviations show nothing, so no value is marked as
the best. Every trained row is the last epoch. <i>n/a</i>: the metric does not apply.</p>
{"".join(tables)}
<div class="card"><dl>{explained}</dl></div>"""


def _variants(summaries):
    subjects = dict.fromkeys(line.subject for line in summaries)
    tables = [f"<h3>{escape(name)}</h3>" + _table([s for s in summaries if s.subject == name], COMPARED, LABELS)
              for name in subjects]  # fmt: skip
    about = "<p>The variants of the search in thesis Table 5.4, where people judged them.</p>" if tables else ""
    return about + "".join(tables)


def _table(lines, metrics, names=ROWS):
    arrow = {"lower": "↓", "higher": "↑", "truth": "≈"}
    head = "".join(f"<th>{escape(METRICS[name].label)} {arrow[METRICS[name].better]}"
                   f"<small>{escape(METRICS[name].unit) or '&nbsp;'}</small></th>" for name in metrics)  # fmt: skip
    body = ""
    for line in lines:
        cells = [cell(line, name) for name in metrics]
        values = "".join(f"<td{' class=none' if text == 'n/a' else ''}>{escape(text)}</td>" for text in cells)
        real = ' class="real"' if line.row in BASELINES else ""
        body += (f"<tr{real}><td>{escape(names.get(line.row, line.row))}</td><td>{line.runs}</td><td>{line.clips}</td>"
                 f"{values}</tr>\n")  # fmt: skip
    return (f'<div class="card scroll"><table><thead><tr><th>row</th><th>runs</th><th>clips</th>{head}</tr></thead>'
            f"<tbody>\n{body}</tbody></table></div>")  # fmt: skip


# ------------------------------------------------------------------------------------------------------------- films


def _films(videos, folder, most_bytes):
    figures, total, embedded = [], 0, 0
    for label, path in videos:
        path = Path(path)
        if not path.is_file():
            raise CospeechError(f"{path}: no such film for the report")
        size = path.stat().st_size
        if embedded < FILMS and total + size <= most_bytes:
            data = base64.b64encode(path.read_bytes()).decode()
            source = f"data:video/mp4;base64,{data}"
            total, embedded = total + size, embedded + 1
            figures.append(f'<figure><video controls preload="metadata" src="{source}"></video>'
                           f"<figcaption>{escape(label)}</figcaption></figure>")  # fmt: skip
        else:
            figures.append(f'<figure><a href="{_relative(path, folder)}">{escape(path.name)}</a>'
                           f"<figcaption>{escape(label)}: beside the report, not embedded for its size</figcaption>"
                           "</figure>")  # fmt: skip
    return f'<div class="films">{"".join(figures)}</div>' if figures else ""


def _relative(path, folder):
    return quote(Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix())


# ------------------------------------------------------------------------------------------------------------ curves


def _curves(histories):
    figures = [_curve(label, path) for label, path in histories.items()]
    return f'<div class="curves">{"".join(figures)}</div>' if figures else ""


def _curve(label, path):
    """All loss terms of one training in one picture, on a logarithmic axis where all are positive."""
    with reading_hdf5(path, "cospeech.history") as file:
        steps, seconds = file["step"][()], float(file.attrs.get("seconds", math.nan))
        losses = {term: data[()] for term, data in sorted(file["loss"].items())}
    took = f", {seconds:.0f} s" if math.isfinite(seconds) else ""
    caption = f"{label}: {int(steps[-1]) if len(steps) else 0} iterations{took}"
    source = f"data:image/svg+xml;base64,{base64.b64encode(_svg(steps, losses)).decode()}"
    return (f'<figure class="card"><img src="{source}" alt="training curves of {escape(label)}">'
            f"<figcaption>{escape(caption)}</figcaption></figure>")  # fmt: skip


def _svg(steps, losses):
    """The curves as the bytes of an SVG file, transparent, without date."""
    import matplotlib
    from matplotlib.figure import Figure

    positive = all((values[np.isfinite(values)] > 0).all() for values in losses.values())
    # A fixed salt and no date: the same curves give the same bytes. Text stays text, without fonts to embed.
    with matplotlib.rc_context({"svg.hashsalt": "cospeech", "svg.fonttype": "none", "font.size": 9}):
        figure = Figure(figsize=(6.4, 3.2), layout="constrained")
        axes = figure.subplots()
        for term, values in losses.items():
            shown = np.isfinite(values)
            axes.plot(steps[shown], values[shown], linewidth=1.2, label=term)
        axes.set(xlabel="iterations", ylabel="loss", yscale="log" if positive and losses else "linear")
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        if losses:
            axes.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
        data = io.BytesIO()
        figure.savefig(data, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return data.getvalue()


# ------------------------------------------------------------------------------------------------------------- facts


def _notices(notices):
    items = "".join(f"<li>{escape(line)}</li>" for line in notices)
    return f'<div class="card"><ul>{items}</ul></div>' if items else ""


def _timings(timings):
    rows = []
    for label, path in timings:
        measured = _benchmark(path)
        if measured:
            rows.append((label, *measured))
    if not rows:
        return ""
    total = sum(seconds for _, seconds, _ in rows)
    body = "".join(f"<tr><td>{escape(label)}</td><td>{_clock(seconds)}</td><td>{_or_none(memory, '{:,.0f}')}</td></tr>"
                   for label, seconds, memory in sorted(rows, key=lambda row: -row[1]))  # fmt: skip
    return (f'<p class="soft">{len(rows)} jobs, {_clock(total)} of work in all.</p><div class="card scroll"><table>'
            f"<thead><tr><th>job</th><th>time</th><th>memory<small>MB at most</small></th></tr></thead><tbody>{body}"
            "</tbody></table></div>")  # fmt: skip


def _benchmark(path):
    """(seconds, MB) of the last run in a benchmark TSV; None, with a notice, when it holds no such numbers."""
    with open(path, newline="", encoding="utf-8") as file:
        runs = list(csv.DictReader(file, delimiter="\t"))
    try:
        return float(runs[-1]["s"]), _number(runs[-1].get("max_rss"))
    except (IndexError, KeyError, TypeError, ValueError):
        notice(f"{path}: no benchmark with a column 's'; left out of the report")
        return None


def _number(text):
    try:
        return float(text)
    except (TypeError, ValueError):
        return math.nan


def _or_none(value, form):
    return form.format(value) if math.isfinite(value) else "n/a"


def _clock(seconds):
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{seconds:.1f} s"


def _versions(versions):
    items = "".join(f"<dt>{escape(name)}</dt><dd>{escape(str(version))}</dd>" for name, version in versions.items())
    return f'<div class="card"><dl>{items}</dl></div>' if items else ""
