"""The quality page of a take: one HTML file with what was seen when, beside the overlay film."""

from html import escape
from importlib.resources import files
from string import Template
from urllib.parse import quote

import numpy as np

from cospeech.files import writing

NUMBERS = {
    "bone_deviation_raw": ("bones differ from the speaker's, as tracked", "{:.1%}"),
    "bone_deviation": ("bones differ from the speaker's, cleaned", "{:.2%}"),
    "jitter_raw": ("mean joint acceleration, as tracked", "{:.2f} m/s²"),
    "jitter_clean": ("mean joint acceleration, cleaned", "{:.2f} m/s²"),
    "valid": ("frames that training may use", "{:.0%}"),
    "tilt": ("turned upright by", "{:.1f}°"),
}
GATES = {
    "joined": "joints dropped: hand not at its arm",
    "agreement": "joints dropped: 2D and 3D disagree",
    "bone": "joints dropped: bone length",
    "speed": "joints dropped: jump there and back",
}


def write_page(path, quality, film=""):
    """Write the page of a `Quality`. `film`: the overlay film's path from the page, shown and linked if given."""
    template = Template((files("cospeech.render.pages") / "quality.html").read_text("utf-8"))
    text = template.substitute(
        title=escape(f"{quality.subject} / {quality.clip}: annotation"),
        summary=escape(
            f"Refused: {quality.refused}"
            if quality.refused
            else f"{quality.frames} frames at {quality.fps:g} Hz ({quality.frames / quality.fps:.1f} s), tracked by "
            f"{quality.backend or 'an unnamed tracker'}."
        ),
        film=_film(film),
        shares="\n".join(
            _row(part, *(getattr(quality, key)[part] for key in ("observed", "interpolated", "excluded")))
            for part in quality.observed
        ),
        timelines="\n".join(_timeline(part, known) for part, known in quality.timeline.items()),
        numbers="\n".join(
            [
                *(_line(text, style.format(getattr(quality, key))) for key, (text, style) in NUMBERS.items()),
                *(_line(GATES.get(gate, gate), f"{share:.1%}") for gate, share in quality.dropped.items()),
            ]
        ),
        licence=escape(quality.licence_note),
    )
    with writing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _film(film):
    if not film:
        return ""
    address = escape(quote(str(film)))
    return f'<video controls src="{address}"></video><p><a href="{address}">overlay film</a></p>'


def _row(part, *shares):
    cells = "".join(f"<td>{share:.1%}</td>" for share in shares)
    return f"<tr><td>{escape(part.replace('_', ' '))}</td>{cells}</tr>"


def _line(text, value):
    return f"<tr><td>{escape(text)}</td><td>{escape(value)}</td></tr>"


def _timeline(part, known):
    """A bar whose darkness over time is the share of the part's joints that are known."""
    known = np.asarray(known, float)
    edges = np.flatnonzero(np.diff(known, prepend=-1.0))
    widths = np.diff([*edges, len(known)])
    bars = "".join(
        f'<rect x="{x}" width="{w}" height="1" fill="#3b6e8f" fill-opacity="{known[x]:.2f}"/>'
        for x, w in zip(edges, widths, strict=True)
        if known[x] > 0
    )
    name = escape(part.replace("_", " "))
    return f'<div class="part">{name}</div><svg viewBox="0 0 {len(known)} 1" preserveAspectRatio="none">{bars}</svg>'
