"""Long exposures: a stretch of motion as one still picture, as the publications' figures show gestures."""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import writing
from cospeech.render.character.figure import LEFT_SLEEVE, RIGHT_SLEEVE
from cospeech.render.character.triangles import SHADOW
from cospeech.render.video import Stage, _check, _sampled
from cospeech.skeleton import UPPER55

FAINTEST, STRONGEST = 0.16, 0.42  # opacity of the first pose and of the last but one; the last is solid
PATHS = {"right_wrist": RIGHT_SLEEVE, "left_wrist": LEFT_SLEEVE}
STEPS = 60  # a second, of the wrists' paths


def long_exposure(path, panels, start, end=None, poses=6, size=(960, 540), paths=True, **character):
    """Write one picture (`.png`) of a stretch of motion: some of its poses laid over each other.

    Parameters
    ----------
    panels : list of (title, Clip), drawn left to right; more than three go into two rows. All share one camera.
    start, end : seconds; without `end` it is a plain still of one pose.
    poses : how many, evenly spread from start to end; the earlier, the fainter.
    size : (width, height) in even pixels of the whole picture.
    character : as of `render_video`.
    paths : whether the wrists' paths are drawn, thin where the stretch begins and thick where it ends.
    """
    path = Path(path)
    _check(path, panels, size, suffix=".png")
    end = start if end is None else end
    lasts = min(clip.duration for _, clip in panels)
    if not 0 <= start <= end <= lasts:
        raise CospeechError(f"{path}: no stretch from {start:g} s to {end:g} s; the shortest clip lasts {lasts:.2f} s")
    if poses < 1:
        raise CospeechError(f"{path}: {poses} poses; expected 1 or more")
    times = np.linspace(end, start, poses if end > start else 1)[::-1]
    stage = Stage(panels, size, **character)
    picture = stage.empty.copy()
    for area, figure, clip, expression in stage.areas(picture):
        _expose(area, stage.painter, figure, _sampled(clip, times, expression))
        if paths and end > start:
            _trace(area, stage.painter.camera, clip, start, end)
        stage.fade(area)
    with writing(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", picture)[1].tobytes())


def _expose(area, painter, figure, motion):
    """Lay the poses of `motion` over each other in `area` (H, W, 3), in place; only the last casts a shadow."""
    points, bright = figure.pose(*motion)
    for part, place, light in zip(np.linspace(FAINTEST, STRONGEST, len(points) - 1), points, bright, strict=False):
        drawn, mask = area.copy(), np.full_like(area, 255)
        painter.draw(drawn, place, light, figure.triangles, figure.colors)
        painter.draw(mask, place, np.zeros_like(light), figure.triangles, figure.colors)  # black on a white wall
        cover = part * np.clip(1 - mask / (255 * (1 - SHADOW)), 0, 1)  # the shadow on the wall does not count
        area[:] = np.rint(area * (1 - cover) + drawn * cover)
    painter.draw(area, points[-1], bright[-1], figure.triangles, figure.colors)


def _trace(area, camera, clip, start, end):
    """Draw where the wrists went from start to end (seconds), in place."""
    times = np.linspace(start, end, max(round((end - start) * STEPS), 2))
    positions = _sampled(clip, times)[0]
    for name, color in PATHS.items():
        seen = camera.project(positions[:, UPPER55.index[name]])[:, :2]
        for i, (a, b) in enumerate(pairwise(seen)):
            thick = max(round(len(area) / 400 * (0.6 + 1.6 * i / len(seen))), 1)
            ends = (tuple(round(float(v) * 16) for v in point) for point in (a, b))  # cv2 counts sixteenths
            cv2.line(area, *ends, color, thick, cv2.LINE_AA, shift=4)
