"""The player's page: its size against plain numbers, and its frames per second in headless Chromium.

python benchmarks/bench_player.py [CLIP.h5 ...]      (default: four synthetic clips of 60 s)
"""

import json
import sys
import tempfile
import time
import zlib
from pathlib import Path

import numpy as np
from timing import PROCESSOR, timed

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks.bench_render import moving
from cospeech.clip import Clip
from cospeech.face.expressions import COSPEECH64
from cospeech.render.character.figure import Figure
from cospeech.render.pages.player_page import player_html, write_player
from tests.render.browser import Browser, chromium

SECONDS, FPS, WINDOW = 60, 15, (1280, 720)


def synthetic(seed):
    """A minute of swinging joints that tremble, with a restless face."""
    rng = np.random.default_rng(seed)
    frames = SECONDS * FPS
    positions = moving(frames) + rng.normal(0, 0.001, (frames, 55, 3)).astype(np.float32)
    expression = np.abs(rng.normal(0, 0.2, (frames, len(COSPEECH64)))).astype(np.float32)
    rotation = (0.2 * np.sin(np.arange(frames)[:, None] / [9, 13, 17])).astype(np.float32)
    return Clip(
        "bench",
        "take",
        FPS,
        positions,
        np.zeros((frames, 28), np.float32),
        expression=expression,
        rotation=rotation,
        face_model="cospeech64",
    )


def plain(clips):
    """Megabytes of the obvious pages: joints and coefficients as JSON, and all vertices as base64 of float32."""
    lists = [[np.round(each, 4).tolist() for each in (c.positions, c.rotation, c.expression)] for c in clips]
    vertices = sum((Figure(c.positions).triangles.max() + 1) * 12 * c.frames * 4 / 3 for c in clips)
    return len(json.dumps(lists, separators=(",", ":"))) / 1e6, vertices / 1e6


def play(page, seconds=8):
    """Pictures of all panels per second, milliseconds to draw them, and seconds of sound per second, while playing."""
    with tempfile.TemporaryDirectory() as profile, Browser(profile, WINDOW) as browser:
        browser.open(page)
        browser.run("player.ready.then(() => 1)")
        browser.click(".bar button")
        time.sleep(3)
        state = "[player.drawn, player.spent, player.time, performance.now() / 1000, player.canvases[0].width]"
        before, _ = browser.run(state), time.sleep(seconds)
        after = browser.run(state)
        drawn, spent, heard, passed, _ = np.subtract(after, before)
    return drawn / passed, spent / drawn, heard / passed, after[-1]


def main():
    clips = [Clip.read(path) for path in sys.argv[1:]] or [synthetic(seed) for seed in range(4)]
    panels = [(clip.generator or "clip", clip) for clip in clips]
    seconds = max(clip.duration for clip in clips)
    sound = np.random.default_rng(0).normal(0, 0.1, round(seconds * 16000)).astype(np.float32), 16000
    made, page = timed(lambda: player_html(panels, sound).encode(), PROCESSOR)
    print(f"{len(clips)} clips of {seconds:.0f} s: {made:.1f} s of processor time to make the page")
    size = len(page) / 1e6
    print(f"page                         {size:6.2f} MB with its sound")
    packed = len(zlib.compress(np.concatenate([c.positions.ravel() for c in clips]).tobytes(), 9)) / 1e6 * 4 / 3
    print(f"joints as deflated float32   {packed:6.2f} MB = {packed / size:.1f} times as large, without sound and face")
    if all(clip.expression is not None and clip.rotation is not None for clip in clips):
        numbers, vertices = plain(clips)
        print(f"joints and face as JSON      {numbers:6.2f} MB = {numbers / size:.1f} times as large, without sound")
        print(f"all vertices, base64         {vertices:6.2f} MB = {vertices / size:.0f} times as large, without sound")
    if not chromium():
        print("no Chromium here: frames per second were not measured")
        return
    for count in (1, 2, 4):
        with tempfile.TemporaryDirectory() as folder:
            write_player(Path(folder) / "page.html", panels[:count], audio=sound)
            rate, cost, clock, width = play(Path(folder) / "page.html")
        print(
            f"{min(count, len(panels))} side by side: {rate:5.1f} pictures/s, {cost:5.1f} ms to draw all, clock runs "
            f"{clock:.3f} s a second, {width} samples across a panel"
        )


if __name__ == "__main__":
    main()
