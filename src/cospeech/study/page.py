"""The page of a study's results: one HTML file with its tables and plots inside."""

import base64
import math
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from cospeech.files import writing
from cospeech.formats.result_table import plus_minus
from cospeech.study.plots import label

CLEAR = 0.05
READING = {
    "rating": "Mean ± sample deviation over all ratings, as in thesis Tables 4.1, 4.2, 5.2 and 5.4.",
    "pairs": "Log strength after Bradley and Terry with its 95% interval (participants resampled), and in brackets the "
    "share of its comparisons that a method has won, a draw counting half.",
}


def write_page(path, results, plots):
    """Write the page of `Results` (results.html); `plots` are PNG files that go into it."""
    study, people = results.study, len(results.participants)
    template = Template((files("cospeech.study") / "results.html").read_text("utf-8"))
    text = template.substitute(
        title=escape(study["title"]),
        summary=escape(
            f"{people} participant{'s' * (people != 1)}, {len(study['conditions'])} methods, "
            f"{len({one['track'] for one in study['stimuli']})} tracks; study {study['id']}, "
            f"{'pairwise preference' if results.pairs else str(study['points']) + ' points'}."
        ),
        notes="".join(f"<p>{escape(note)}.</p>" for note in results.notes),
        heading="Strengths" if results.pairs else "Ratings",
        table=_table(results),
        reading=escape(READING[study["kind"]]),
        plots="\n".join(_picture(plot) for plot in plots),
        comparisons=_comparisons(results),
        left=_left(results.left),
        questions="\n".join(f"<li>{escape(key)}: {escape(text)}</li>" for key, text in study["questions"].items()),
    )
    with writing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _table(results):
    """A row for each method and a column for each question, as the publications print it."""
    questions = results.study["questions"]
    cells = {(row.condition, row.question): row for row in results.table}
    head = _row(["Method", *(key.replace("_", " ").capitalize() for key in questions)], "th")
    show = _strength if results.pairs else lambda row: plus_minus(row.mean, row.deviation, 2)
    lines = [
        _row([label(name), *(show(cells[name, key]) for key in questions)]) for name in results.study["conditions"]
    ]
    return "\n".join([head, *lines])


def _strength(row):
    share = row.wins / row.comparisons if row.comparisons else math.nan
    return f"{row.strength:.2f} [{row.low:.2f}, {row.high:.2f}] ({share:.0%})"


def _comparisons(results):
    head = "".join(f"<th>{name}</th>" for name in ("participants", "difference", "p", "p (Holm)"))
    lines = [f"<tr><th>Question</th><th class=text>Methods</th>{head}</tr>"]
    for row in results.comparisons:
        numbers = [str(row.participants), f"{row.difference:+.2f}", _p(row.p), _p(row.p_holm)]
        cells = "".join(f"<td{' class=clear' * (row.p_holm < CLEAR)}>{number}</td>" for number in numbers)
        methods = (
            f"<td>{escape(row.question)}</td><td class=text>{escape(label(row.a))} &minus; {escape(label(row.b))}</td>"
        )
        lines.append(f"<tr>{methods}{cells}</tr>")
    return "\n".join(lines)


def _p(value):
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def _left(left):
    if not left:
        return "<p>Nothing: every file counts.</p>"
    lines = [f"<li>{escape(Path(one.path).name)}: {escape(one.reason)}</li>" for one in left]
    return "<ul>\n" + "\n".join(lines) + "\n</ul>"


def _row(cells, kind="td"):
    return "<tr>" + "".join(f"<{kind}>{escape(str(cell))}</{kind}>" for cell in cells) + "</tr>"


def _picture(path):
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<p><img src="data:image/png;base64,{data}" alt="{escape(path.stem, quote=True)}"></p>'
