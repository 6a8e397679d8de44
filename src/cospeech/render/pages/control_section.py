"""The report's section on control: Table 5.3 with its figures, and Table 5.4's variants of the search."""

import base64
import math
from html import escape
from pathlib import Path

from cospeech.evaluation.control import BEFORE
from cospeech.formats.result_table import plus_minus

COLUMNS = ("control", "model", "threshold", "mean ± deviation", "kept", "change", "unconstrained", "kept")
MODELS = {"knn": "k-NN", "resync": "k-NN + cGAN", "moglow": "MoGlow"}


def control_section(rows, figures):
    """HTML of the lines of Table 5.3 (list of ControlRow) and of figures (list of (label, path of an SVG or PNG))."""
    if not rows:
        return ""
    subjects = dict.fromkeys(row.subject for row in rows)
    tables = "".join(
        f"<h3>{escape(name)}</h3>{_table([row for row in rows if row.subject == name])}" for name in subjects
    )
    pictures = "".join(_picture(label, path) for label, path in figures)
    return f"""<p>Each control on the whole of every test clip (thesis Table 5.3). A threshold is a percentile of
the training part; <i>kept</i> is the share of frames at or beyond it, <i>change</i> the mean difference from the k-NN
motion that the network was given. The control bounds the first and the last frame of each window of eight, so that
motion stays free between them; the sample deviation over frames shows how much of it there is.</p>
{tables}<div class="curves">{pictures}</div>"""


def _table(rows):
    head = "".join(f"<th>{name}</th>" for name in COLUMNS)
    body = ""
    for row in rows:
        share = lambda x: f"{100 * x:.0f} %"
        cells = [
            MODELS.get(row.model, row.model),
            f"{row.threshold:.3f} {row.unit}",
            plus_minus(row.mean, row.deviation, 3),
            share(row.kept),
            f"{row.change:.3f}" if math.isfinite(row.change) else "",
            plus_minus(row.free_mean, row.free_deviation, 3),
            share(row.free_kept),
        ]
        name = f"{row.signal} = {row.level}".replace("_", " ") if row.model == BEFORE else ""
        body += f"<tr><td>{escape(name)}</td>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>\n"
    return f'<div class="card scroll"><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def _picture(label, path):
    kind = {".svg": "svg+xml", ".png": "png"}[Path(path).suffix]
    source = f"data:image/{kind};base64,{base64.b64encode(Path(path).read_bytes()).decode()}"
    return (
        f'<figure class="card"><img src="{source}" alt="{escape(label)}">'
        f"<figcaption>{escape(label)}</figcaption></figure>"
    )
