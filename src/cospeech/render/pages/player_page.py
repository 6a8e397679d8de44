"""The player: one HTML file that shows clips side by side in step with their sound, without a network.

What the page holds is written by `player_data`; `player.js` and `puppet.js` beside this file show it.
"""

import base64
import json
import re
import tempfile
import zlib
from fractions import Fraction
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import writing
from cospeech.render.character.figure import BACKGROUND, FADE, LIGHT, TITLE
from cospeech.render.character.head import HEIGHT
from cospeech.render.character.puppet import JOINTS, STEP, make_puppets
from cospeech.render.video import SOUND_RATE, _captions, _encode_sound, _sound
from cospeech.skeleton import UPPER55

VERSION = 2  # of the data that the scripts understand
BIT_RATE = 64000  # of the sound, one channel
WEIGHT_STEP = 1e-4  # in units of the character: weights of shapes are rounded to it
PITCH, VIEW = 0.07, 0.42  # radians: how far the camera looks down, and its vertical angle of view
DIRECTIONS = 64  # in which the camera's room is measured


def write_player(path, panels, audio=None, **options):
    """Write `player_html` of the same arguments to `path` (.html), whole or not at all."""
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise CospeechError(f"{path}: cannot write this kind of file; give a name that ends in .html")
    page = player_html(panels, audio, **options)
    with writing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def player_html(panels, audio=None, title="", posture="standing", subtitles=True, face=None):
    """The whole page as a string: scripts, motion and sound inside it, nothing asked from a network.

    Parameters
    ----------
    panels : list of (title, Clip), any number of them; all share one camera and one clock.
    audio : (samples (N,) float32 mono, rate), the path of a sound file, or None for silence.
    title : of the page; by default the panels' titles.
    posture : of the legs, which clips do not have: "standing", "sitting" or "none".
    subtitles : whether the words of the first clip that has any are shown.
    face : a FaceModel or the file of one, whose coefficients the clips have; by default the embedded one.

    Same input, same bytes.
    """
    data = player_data(panels, audio, posture, subtitles, face)
    page = (files("cospeech.render.pages") / "player.html").read_text(encoding="utf-8")
    parts = {
        "TITLE": escape(title or " · ".join(str(name) for name, _ in panels)),
        "SCRIPT": player_script(),
        "DATA": embedded(data),
    }
    return re.sub("%(TITLE|SCRIPT|DATA)%", lambda place: parts[place[1]], page)


def player_script():
    """The JavaScript that defines `CospeechPlayer`, to stand in a page's <script> once for any number of players."""
    return "\n".join(
        (files("cospeech.render.pages") / f"{name}.js").read_text(encoding="utf-8") for name in ("puppet", "player")
    )


def embedded(data):
    """`data` as JSON that may stand inside a <script> of a page."""
    return json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def player_data(panels, audio=None, posture="standing", subtitles=True, face=None):
    """What one player shows, as a dict for JSON: `new CospeechPlayer(element, data)`. Arguments as `player_html`."""
    if not panels:
        raise CospeechError("player: no clip to show; give at least one")
    clips = [clip.validate() for _, clip in panels]
    figures, puppets, shapes = make_puppets(clips, posture, face)
    duration, sound = _length(clips, _sound(audio))
    spoken = next((clip.words for clip in clips if subtitles and len(clip.words)), None)
    captions = [] if spoken is None else [[round(a, 3), round(b, 3), text] for a, b, text in _captions(spoken)]
    arrays = _mesh(figures[0], shapes)
    steps = _motion(arrays, puppets, shapes)
    meta, blob = pack(arrays)
    return {
        "version": VERSION,
        "duration": duration,
        "posture": posture,
        "captions": captions,
        "arrays": meta,
        "panels": [
            {"title": str(name), "frames": clip.frames, "fps": float(clip.fps), "scale": figure.scale}
            for (name, clip), figure in zip(panels, figures, strict=True)
        ],
        "limbs": _limbs(figures[0]),
        "joints": list(JOINTS),
        "light": LIGHT.tolist(),
        "background": list(BACKGROUND[::-1]),
        "camera": _camera(puppets),
        **steps,
        "blob": base64.b64encode(blob).decode(),
        "audio": _encoded(sound, duration),
    }


def _length(clips, sound):
    """Seconds that the page lasts, and its sound: as in `render_video`."""
    duration = max(clip.duration for clip in clips)
    if sound is None:
        return duration, (np.zeros(1, np.float32), SOUND_RATE)
    length = len(sound[0]) / sound[1]
    return (length if abs(length - duration) <= 1 / clips[0].fps else duration), sound


# ------------------------------------------------------------------------------------------------------------- arrays


def _limbs(figure):
    """[[sides, [[start joint, end joint, radius, radius], ...]], ...]; radii in units of the character."""
    return [
        [sides, [[JOINTS.index(limb.start), JOINTS.index(limb.end), *limb.radii] for limb in group]]
        for sides, group in figure.limbs.items()
    ]


def _mesh(figure, shapes):
    """{name: array}: the triangles of one character, their colours, and what its vertices are made of.

    Vertices stand in the order of `Character`; a panel differs from another in its motion alone.
    """
    arrays = {"props": np.float32(figure.props / figure.scale)}
    for sides, (directions, end, _) in figure.templates.items():
        arrays |= {f"directions{sides}": np.float32(directions), f"end{sides}": end.astype(np.uint8)}
    palette, index = np.unique(figure.colors.round().astype(np.uint8), axis=0, return_inverse=True)
    arrays |= {
        "triangles": figure.triangles.astype(np.uint16),
        "palette": palette[:, ::-1],
        "colors": index.ravel().astype(np.uint8),
    }
    for name, shape in shapes.items():
        arrays |= {
            f"{name}_mean": np.float32(shape.mean),
            f"{name}_moving": shape.moving.astype(np.uint16),
            f"{name}_basis": np.round(shape.basis / _basis_step(shape)).astype(np.int16),
        }
    return arrays


def _motion(arrays, puppets, shapes):
    """Add every panel's motion to `arrays`, as whole steps; returns the steps' sizes."""
    step = {"joints": _step(STEP, [p.joints for p in puppets])}
    for name, shape in shapes.items():
        step[name] = _step(WEIGHT_STEP, [p.weights[name] for p in puppets])
        step[f"{name}_basis"] = _basis_step(shape)
    for i, puppet in enumerate(puppets):
        frames = len(puppet.joints)
        arrays[f"joints{i}"] = Series(np.round(puppet.joints.reshape(frames, -1) / step["joints"]))
        arrays[f"turn{i}"] = Series(np.round(puppet.head * 16384))
        arrays |= {f"{name}{i}": Series(np.round(w / step[name])) for name, w in puppet.weights.items()}
    return {"step": step}


def _step(fine, arrays):
    """The step `fine`, or a coarser one where the values would not fit into 16 bits."""
    return float(max(fine, max(np.abs(array).max(initial=0) for array in arrays) / 32000))


def _basis_step(shape):
    return float(max(np.abs(shape.basis).max(initial=0), 1e-9) / 32767)


class Series:
    """Whole numbers (T, C) within 16 bits that change little from row to row."""

    def __init__(self, values):
        self.values = values.astype(np.int32)

    def bytes(self):
        """Differences in time, channel by channel, small ones as small numbers; their low bytes, then the high."""
        change = np.diff(self.values, axis=0, prepend=0).T.ravel()
        folded = (np.where(change < 0, -2 * change - 1, 2 * change) & 0x1FFFF).astype(np.uint32)
        return b"".join((folded >> shift & 255).astype(np.uint8).tobytes() for shift in (0, 8, 16))


def pack(arrays):
    """[[name, type, shape], ...] and the deflated bytes of {name: array or Series}, little-endian, one after another.

    Types: u1, u2, i2, f4, and `series`. Each array starts at a multiple of 4 bytes.
    """
    meta, parts = [], []
    for name, array in arrays.items():
        series = isinstance(array, Series)
        values = array.values if series else np.ascontiguousarray(array)
        raw = array.bytes() if series else values.astype(values.dtype.newbyteorder("<")).tobytes()
        meta.append([name, "series" if series else values.dtype.str[1:], list(values.shape)])
        parts.append(raw + bytes(-len(raw) % 4))
    return meta, zlib.compress(b"".join(parts), 9)


# --------------------------------------------------------------------------------------------------- camera and sound


def _camera(puppets):
    """The points (N, 3) that the camera must see at first, and the rest of its settings.

    Panels change their size with the window, so that the camera is placed in JavaScript, as by `Camera.containing`.
    As in films, joints farther off than arms reach do not count, nor do legs: gestures are what people look at.
    """
    points = []
    for puppet in puppets:
        reach = np.array([[-1.1, -0.7, -0.6], [1.1, 1.6, 1.0]]) * puppet.scale
        crown = puppet.joints[:, UPPER55.index["neck"]] + np.array([0, 1.15 * HEIGHT * puppet.scale, 0])
        points += [np.clip(part.reshape(-1, 3), *reach) for part in (puppet.joints[:, : len(UPPER55)], crown)]
        points.append(np.array([[0.3, -0.12, 0.0]]) * puppet.scale)
    points = np.concatenate(points)
    height = np.linspace(-1, 1, DIRECTIONS)
    angle = np.arange(DIRECTIONS) * np.pi * (3 - np.sqrt(5))  # spread evenly: the golden angle
    around = np.sqrt(1 - height**2)
    ways = np.stack([around * np.cos(angle), height, around * np.sin(angle)], -1)
    outermost = np.unique((points @ ways.T).argmax(0))
    return {"points": points[outermost].round(4).tolist(), "above": TITLE, "below": FADE, "pitch": PITCH, "fov": VIEW}


def _encoded(sound, duration):
    """The sound as a data URI: AAC in mp4, which every browser plays, cut or filled up to `duration` seconds."""
    import av

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sound.mp4"
        options = {"movflags": "+faststart", "fflags": "+bitexact"}
        with av.open(str(path), "w", format="mp4", container_options=options) as film:
            voice = film.add_stream("aac", rate=SOUND_RATE, layout="mono")
            voice.bit_rate = BIT_RATE
            _encode_sound(film, voice, sound, Fraction(duration).limit_denominator(SOUND_RATE))
        return "data:audio/mp4;base64," + base64.b64encode(path.read_bytes()).decode()
