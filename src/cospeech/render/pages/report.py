"""results/report.html: one file that opens offline, with tables, curves, films and the facts they were made from."""

import base64
import csv
import math
import os
import re
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from urllib.parse import quote

import numpy as np

from cospeech.clip import Clip
from cospeech.errors import CospeechError, notice
from cospeech.evaluation.baseline_rows import BASELINES
from cospeech.evaluation.columns import METRICS
from cospeech.evaluation.tables import cell
from cospeech.evaluation.variants import LABELS
from cospeech.evaluation.variants import METRICS as COMPARED
from cospeech.files import reading_hdf5, writing
from cospeech.formats.result_table import ABSENT
from cospeech.render.chart import line_chart
from cospeech.render.pages.control_section import control_section
from cospeech.render.pages.player_page import embedded, player_data, player_script
from cospeech.render.pages.table_sections import ROWS, table_section

OPENING = """<p>Programs learnt from recordings of speakers how they gesture, and made motion for speech that they had
not heard. Here are their characters beside the recorded motion, measures of how alike the two are, and everything
needed to repeat the run. Measures are no judges: look first, then read.</p>"""
FILMS, FILM_BYTES = 12, 40e6  # embedded at most; the others are linked
ARROWS = {"lower": "↓ lower is better", "higher": "↑ higher is better", "truth": "≈ close to ground truth is better"}


def write_report(
    path,
    *,
    title,
    evaluation=(),
    histories=None,
    videos=(),
    config="",
    versions=None,
    timings=(),
    notices=(),
    subtitle="",
    film_bytes=FILM_BYTES,
    control=(),
    variants=(),
    figures=(),
    tables=(),
    captions=None,
    players=(),
):
    """Write the report as one HTML file that needs no other file and no network.

    Parameters
    ----------
    evaluation : list of `cospeech.evaluation.tables.Summary`, one a subject and row.
    histories : {label: path of a history.h5}; every loss term becomes a curve.
    players : list of (label, panels, sound) as of `player_data`, shown first, to be turned and scrubbed.
    videos : list of (label, path of an mp4). The first 12 that fit into `film_bytes` together are embedded; the others
        are linked by their path relative to the report.
    control : list of `cospeech.evaluation.control.ControlRow`; figures : list of (label, path) shown beside them.
    variants : list of Summary, of the search's variants and what they are compared with (thesis Table 5.4).
    tables : paths of CSV files, each shown as its own section. captions : {name of such a file without `.csv`: dict of
        `title`, and of `about` and `curve` as `table_section` takes them}; its order is the page's, others follow.
    config : the configuration as text (YAML). versions : {package: version}. notices : lines worth knowing.
    timings : list of (label, path of a benchmark TSV with the columns s and max_rss), or {label: path}.

    Whatever is empty has no section. Text is escaped. Same input, same bytes.
    """
    timings = list(timings.items() if isinstance(timings, dict) else timings)
    sections = {
        "Side by side": _players(players),
        "Evaluation": _evaluation(evaluation),
        "Control": control_section(control, figures),
        "Variants": _variants(variants),
        **_further(tables, captions or {}),
        "Films": _films(videos, Path(path).parent, film_bytes),
        "Training": _curves(histories or {}),
        "Notices": _notices(notices),
        "Run times": _timings(timings),
        "Configuration": f'<div class="card"><pre>{escape(config)}</pre></div>' if config else "",
        "Versions": _versions(versions or {}),
    }
    present = {name: body for name, body in sections.items() if body}
    anchor = {name: re.sub(r"\W+", "-", name.lower()).strip("-") for name in present}
    page = Template((files("cospeech.render.pages") / "report.html").read_text(encoding="utf-8")).substitute(
        title=escape(title),
        subtitle=escape(subtitle),
        opening=OPENING if present else "",
        navigation="".join(f'<a href="#{anchor[name]}">{escape(name)}</a>' for name in present),
        sections="\n".join(
            f'<section id="{anchor[name]}"><h2>{escape(name)}</h2>\n{body}</section>' for name, body in present.items()
        ),
    )
    with writing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


# -------------------------------------------------------------------------------------------------------- evaluation


def _evaluation(summaries):
    if not summaries:
        return ""
    metrics = [name for name in METRICS if any(math.isfinite(line.mean.get(name, math.nan)) for line in summaries)]
    subjects = dict.fromkeys(line.subject for line in summaries)
    tables = [
        f"<h3>{escape(subject)}</h3>" + _table([line for line in summaries if line.subject == subject], metrics)
        for subject in subjects
    ]
    explained = "".join(
        f"<dt>{escape(METRICS[name].label)}</dt>"
        f'<dd>{escape(METRICS[name].about)} <span class="soft">{ARROWS[METRICS[name].better]}</span></dd>'
        for name in metrics
    )
    return f"""<p>Shaded rows are no models: recorded motion, recorded motion under other speech, and a pose that never
moves. A number means little without them. Values are mean ± sample deviation: over seeds where there are several
runs, over test clips where there is one; differences smaller than the deviations show nothing, so no value is marked as
the best. Every trained row is the last epoch. <i>n/a</i>: the metric does not apply.</p>
{"".join(tables)}
<div class="card"><dl>{explained}</dl></div>"""


def _variants(summaries):
    subjects = dict.fromkeys(line.subject for line in summaries)
    tables = [
        f"<h3>{escape(name)}</h3>" + _table([s for s in summaries if s.subject == name], COMPARED, LABELS)
        for name in subjects
    ]
    about = """<p>The variants of the search in thesis Table 5.4, where people judged them. Values are mean ± sample
deviation over test clips.</p>"""
    return about + "".join(tables) if tables else ""


def _further(paths, captions):
    """{title: HTML} of CSV files, in the order of their captions."""
    paths = {Path(path).stem: path for path in paths}
    order = [name for name in captions if name in paths] + [name for name in paths if name not in captions]
    told = {name: dict(captions.get(name, {})) for name in order}
    return {told[name].pop("title", _title(name)): table_section(paths[name], **told[name]) for name in order}


def _title(name):
    """`table_4_4` -> `Table 4.4`"""
    return re.sub(r"(?<=\d)_(?=\d)", ".", name).replace("_", " ").capitalize()


def _table(lines, metrics, names=ROWS):
    arrow = {"lower": "↓", "higher": "↑", "truth": "≈"}
    head = "".join(
        f"<th>{escape(METRICS[name].label)} {arrow[METRICS[name].better]}"
        f"<small>{escape(METRICS[name].unit) or '&nbsp;'}</small></th>"
        for name in metrics
    )
    body = ""
    for line in lines:
        cells = [cell(line, name) for name in metrics]
        values = "".join(f"<td{' class=none' if text == ABSENT else ''}>{escape(text)}</td>" for text in cells)
        real = ' class="real"' if line.row in BASELINES else ""
        body += (
            f"<tr{real}><td>{escape(names.get(line.row, line.row))}</td><td>{line.runs}</td><td>{line.clips}</td>"
            f"{values}</tr>\n"
        )
    return (
        f'<div class="card scroll"><table><thead><tr><th>row</th><th>runs</th><th>clips</th>{head}</tr></thead>'
        f"<tbody>\n{body}</tbody></table></div>"
    )


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
            figures.append(
                f'<figure><video controls preload="metadata" src="{source}"></video>'
                f"<figcaption>{escape(label)}</figcaption></figure>"
            )
        else:
            figures.append(
                f'<figure><a href="{_relative(path, folder)}">{escape(path.name)}</a>'
                f"<figcaption>{escape(label)}: beside the report, not embedded for its size</figcaption>"
                "</figure>"
            )
    return f'<div class="films">{"".join(figures)}</div>' if figures else ""


def side_by_side(paths, sounds):
    """Players for `write_report`: of every subject one, with all its clips of `paths`; sounds, a path a subject."""
    clips = [Clip.read(path) for path in paths]
    subjects = dict.fromkeys(clip.subject for clip in clips)
    panels = [[(clip.generator or "recorded", clip) for clip in clips if clip.subject == name] for name in subjects]
    return list(zip(subjects, panels, sounds, strict=True))


def _players(players):
    """Players, each with the motion in the page, and once the script that runs them."""
    figures = [
        f'<figure><div class="player"></div><script type="application/json">{embedded(player_data(*shown))}'
        f"</script><figcaption>{escape(label)}</figcaption></figure>"
        for label, *shown in players
    ]
    if not figures:
        return ""
    start = """for (const place of document.querySelectorAll(".player")) {
  new CospeechPlayer(place, JSON.parse(place.nextElementSibling.textContent), { wheel: false });
}"""
    about = "<p>The same speech by the recorded person and by every model. Drag to turn, double click to turn back.</p>"
    return f"{about}{''.join(figures)}<script>{player_script()}\n{start}</script>"


def _relative(path, folder):
    return quote(Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix())


# ------------------------------------------------------------------------------------------------------------ curves


def _curves(histories):
    figures = [figure(label, path) for label, path in histories.items() for figure in (_curve, _learning_curve)]
    return f'<div class="curves">{"".join(figures)}</div>' if figures else ""


def _curve(label, path):
    """All loss terms of one training in one picture, on a logarithmic axis where all are positive."""
    with reading_hdf5(path, "cospeech.history") as file:
        steps, seconds = file["step"][()], float(file.attrs.get("seconds", math.nan))
        losses = {term: data[()] for term, data in sorted(file["loss"].items())}
    took = f", {seconds:.0f} s" if math.isfinite(seconds) else ""
    caption = f"{label}: {int(steps[-1]) if len(steps) else 0} iterations{took}"
    positive = losses and all((values[np.isfinite(values)] > 0).all() for values in losses.values())
    source = line_chart({term: (steps, values) for term, values in losses.items()}, "iterations", "loss", log=positive)
    return _figure(source, f"training curves of {label}", caption)


def _learning_curve(label, path):
    """Where a pose network's training has kept one: PCK on people that it did not see, by domain."""
    with reading_hdf5(path, "cospeech.history") as file:
        found = {name: data[()] for name, data in sorted(file.get("pck", {}).items())}
    if not found:
        return ""
    steps = found.pop("step")
    lines = {domain: (steps, values) for domain, values in found.items()}
    source = line_chart(lines, "iterations", "3D PCK, %")
    return _figure(source, f"learning curve of {label}", f"{label}: share of joints found, on people not trained with")


def _figure(source, described, caption):
    return (
        f'<figure class="card"><img src="{source}" alt="{escape(described)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


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
    body = "".join(
        f"<tr><td>{escape(label)}</td><td>{_clock(seconds)}</td><td>{_or_none(memory, '{:,.0f}')}</td></tr>"
        for label, seconds, memory in sorted(rows, key=lambda row: -row[1])
    )
    return (
        f'<p class="soft">{len(rows)} jobs, {_clock(total)} of work in all.</p><div class="card scroll"><table>'
        f"<thead><tr><th>job</th><th>time</th><th>memory<small>MB at most</small></th></tr></thead><tbody>{body}"
        "</tbody></table></div>"
    )


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
    return form.format(value) if math.isfinite(value) else ABSENT


def _clock(seconds):
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{seconds:.1f} s"


def _versions(versions):
    items = "".join(f"<dt>{escape(name)}</dt><dd>{escape(str(version))}</dd>" for name, version in versions.items())
    return f'<div class="card"><dl>{items}</dl></div>' if items else ""
