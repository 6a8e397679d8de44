"""The report's sections of CSV files under results/tables/: a table for each subject, or curves over a column."""

import csv
import math
import re
from html import escape
from pathlib import Path

from cospeech.errors import CospeechError
from cospeech.evaluation.baseline_rows import BASELINES
from cospeech.formats.result_table import ABSENT, plus_minus
from cospeech.render.chart import line_chart

ROWS = {"ground_truth": "ground truth", "mismatched": "mismatched ground truth", "mean_pose": "mean pose"}
HEADING = re.compile(r"(?P<name>.*?)(?P<spread>[ _]?deviation)?(?: \[(?P<unit>[^\]]+)\])?")
NOTES = ("warning", "note")  # columns whose text is said once, below the table


def table_section(path, about="", curve=None):
    """HTML of a CSV file with a heading line; "" for one without further lines.

    A column `X deviation [unit]` goes into the cells of `X [unit]`, a bare `deviation` into those of `mean`, as
    mean ± deviation. Numbers have three significant digits; whole ones and text stay as they are. A first column
    `subject` makes one table for each subject. `about` stands above: plain text with `code` and *emphasis*. `curve`
    names the column over which the other numbers are drawn as lines instead, one for each combination of texts.
    """
    head, rows = _read(path)
    if not rows:
        return ""
    if curve is not None and curve not in head:
        raise CospeechError(f"{path}: no column {curve!r} to draw over; it has {', '.join(head)}")
    text = re.sub(r"\*(.+?)\*", r"<i>\1</i>", re.sub(r"`(.+?)`", r"<code>\1</code>", escape(about.strip())))
    body = _curves(Path(path).stem, head, rows, curve) if curve is not None else _tables(head, rows)
    return (f"<p>{text}</p>" if text else "") + body


def text_tables(path, names=None):
    """Markdown of the same tables with the same cells, for a document.

    names : the columns to show besides the first ones that hold text, without their units; None shows all.
    CospeechError if there is no such column.
    """
    head, rows = _read(path)
    columns = [column for column in _columns(head) if head[column[2]] not in NOTES]
    missing = set(names or ()) - {name for name, *_ in columns}
    if missing:
        raise CospeechError(f"{path}: no column {min(missing)!r}; it has {', '.join(name for name, *_ in columns)}")
    label = "subject" if head[0] == "subject" else None
    if names:
        texts = [column for column in columns if all(math.isnan(_number(row[column[2]])) for row in rows)]
        columns = [column for column in columns if column[0] in names or (column in texts and column[0] != label)]
    columns = [column for column in columns if column[0] != label]
    groups = {} if label else {"": rows}
    for row in rows if label else ():
        groups.setdefault(row[0], []).append(row)
    return "\n\n".join(_text_table(name, columns, lines) for name, lines in groups.items())


def _text_table(title, columns, rows):
    heads = [name.replace("_", " ") + (f", {unit}" if unit else "") for name, unit, *_ in columns]
    lines = [[_shown(row[i], "" if spread is None else row[spread]) for _, _, i, spread in columns] for row in rows]
    table = "\n".join(f"| {' | '.join(line)} |" for line in [heads, ["---"] * len(heads), *lines])
    return f"**{title}**\n\n{table}" if title else table


def _read(path):
    """(heading, lines) of a CSV file whose lines all have as many cells."""
    with open(path, newline="", encoding="utf-8") as file:
        head, *rows = list(csv.reader(file)) or [[]]
    wrong = next((number for number, row in enumerate(rows, 2) if len(row) != len(head)), None)
    if wrong:
        raise CospeechError(f"{path}: line {wrong} has {len(rows[wrong - 2])} cells for {len(head)} headings")
    return head, rows


def _tables(head, rows):
    said = [i for i, name in enumerate(head) if name in NOTES]
    notes = dict.fromkeys(row[i] for i in said for row in rows if row[i])
    below = "".join(f'<p class="soft">{escape(line)}</p>' for line in notes)
    columns = [column for column in _columns(head) if column[2] not in said]
    if head[0] != "subject":
        return _table(columns, rows) + below
    subjects = dict.fromkeys(row[0] for row in rows)
    tables = (
        f"<h3>{escape(name)}</h3>" + _table(columns[1:], [row for row in rows if row[0] == name]) for name in subjects
    )
    return "".join(tables) + below


def _columns(head):
    """[(name, unit, index, index of its deviation or None)] of the columns that are shown."""
    parts = [HEADING.fullmatch(name) for name in head]
    means = {part["name"]: i for i, part in enumerate(parts) if not part["spread"]}
    spreads = {means.get(part["name"] or "mean"): i for i, part in enumerate(parts) if part["spread"]}
    spreads.pop(None, None)  # a deviation of no mean is a column of its own
    return [
        (part["name"] + (part["spread"] or ""), part["unit"] or "", i, spreads.get(i))
        for i, part in enumerate(parts)
        if i not in spreads.values()
    ]


def _table(columns, rows):
    head = "".join(
        f"<th>{escape(name.replace('_', ' '))}<small>{escape(unit) or '&nbsp;'}</small></th>"
        for name, unit, *_ in columns
    )
    body = ""
    for row in rows:
        texts = [_shown(row[i], "" if spread is None else row[spread]) for _, _, i, spread in columns]
        cells = (f"<td{' class=none' if text == ABSENT else ''}>{escape(text)}</td>" for text in texts)
        real = ' class="real"' if any(row[i] in BASELINES for _, _, i, _ in columns) else ""
        body += f"<tr{real}>{''.join(cells)}</tr>\n"
    return f'<div class="card scroll"><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def _shown(text, spread):
    """One cell, its numbers as the evaluation's tables write them."""
    mean = _number(text)
    if math.isnan(mean) or (mean.is_integer() and "." not in text and not spread):
        return ROWS.get(text, text)
    return plus_minus(mean, _number(spread))


def _number(text):
    try:
        return float(text)
    except ValueError:
        return math.nan


def _curves(label, head, rows, over):
    """Every column of numbers as lines over the column `over`; deviations are left out."""
    at = head.index(over)
    numbers = [i for i in range(len(head)) if all(row[i] == ABSENT or math.isfinite(_number(row[i])) for row in rows)]
    values = [i for i in numbers if i != at and not HEADING.fullmatch(head[i])["spread"]]
    lines = {}
    for row in rows:
        texts = [row[i] for i in range(len(head)) if i not in numbers]
        for i in values:
            name = " ".join([*texts, head[i]] if len(values) > 1 or not texts else texts)
            across, line = lines.setdefault(name, ([], []))
            across.append(_number(row[at]))
            line.append(_number(row[i]))
    source = line_chart(lines, over, head[values[0]] if len(values) == 1 else "")
    return (
        f'<div class="curves"><figure class="card"><img src="{source}" alt="curves of {escape(label)}"></figure></div>'
    )
