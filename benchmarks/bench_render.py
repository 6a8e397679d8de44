"""One picture by our rasteriser, by OpenCV's, and as lines in matplotlib; then whole films against real time.

python benchmarks/bench_render.py
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np
from timing import PROCESSOR, fastest

from cospeech.clip import Clip
from cospeech.face.expressions import COSPEECH64
from cospeech.render.character.figure import BACKGROUND, Figure, framing
from cospeech.render.character.triangles import SAMPLES, Painter
from cospeech.render.video import render_video
from cospeech.skeleton import UPPER55

WIDTH, HEIGHT, FRAMES, FPS = 960, 540, 90, 15.0


def moving(frames):
    """(T, 55, 3) of a rough figure whose joints swing."""
    rng = np.random.default_rng(0)
    pose = np.zeros((55, 3))
    places = {"spine": (0, 0.28), "neck": (0, 0.5), "head": (0, 0.62), "head_top": (0, 0.76)}
    for side, sign in (("left", 1), ("right", -1)):
        for joint, x, y in (("shoulder", 0.18, 0.48), ("elbow", 0.3, 0.25), ("wrist", 0.3, 0.3), ("hip", 0.1, 0)):
            places[f"{side}_{joint}"] = (sign * x, y)
    for name, place in places.items():
        pose[UPPER55.index[name], :2] = place
    for joint in UPPER55.order:
        if UPPER55.names[joint] not in places and joint != UPPER55.root:
            step = 0 if "root" in UPPER55.names[joint] else rng.uniform(0.01, 0.03, 3)
            pose[joint] = pose[UPPER55.tree[joint]] + step
    swing = 0.05 * np.sin(np.arange(frames)[:, None, None] / FPS * rng.uniform(2, 6, (1, 55, 1)) + 1)
    return (pose + swing * np.linspace(0, 1, 55)[:, None]).astype(np.float32)


def best(function, times=30):
    """Shortest milliseconds of processor time of several runs: what else runs on the machine only adds."""
    return 1000 * fastest(function, times, PROCESSOR, warm=True)


def opencv(camera, points, bright, figure):
    """The same mesh by cv2.triangleRasterize, as finely sampled and averaged; it wants a colour for each vertex."""
    colors = np.zeros((len(points), 3), np.float32)
    colors[figure.triangles] = figure.colors[:, None]
    colors = np.clip(colors * bright[:, None], 0, 255)
    size = HEIGHT * SAMPLES, WIDTH * SAMPLES
    samples, depth = np.full((*size, 3), BACKGROUND[0] / 255, np.float32), np.full(size, 10, np.float32)
    view = np.eye(4, dtype=np.float32)
    view[:3, :3] = camera.axes
    view[:3, 3] = -camera.axes @ np.float32(camera.target) - [0, 0, camera.distance]
    settings = cv2.TriangleRasterizeSettings().setCullingMode(cv2.RASTERIZE_CULLING_CW)
    fov = 2 * np.arctan(HEIGHT / 2 / camera.focal)
    cv2.triangleRasterize(points, figure.triangles, colors / 255, samples, depth, view, fov, 0.1, 10.0, settings)
    return cv2.resize(cv2.convertScaleAbs(samples, alpha=255), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


def matplotlib_lines(positions):
    """The bones alone, as lines: the usual way to look at motion."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure as Page

    page = Page(figsize=(WIDTH / 100, HEIGHT / 100), dpi=100)
    axes = page.subplots()
    bones = [(positions[j, :2], positions[p, :2]) for j, p in enumerate(UPPER55.tree) if p >= 0]
    axes.add_collection(LineCollection(bones))
    axes.set(xlim=(-1, 1), ylim=(-0.3, 0.9))
    canvas = FigureCanvasAgg(page)
    canvas.draw()
    return canvas.buffer_rgba()


def main():
    cv2.setNumThreads(1)
    positions = moving(FRAMES)
    figure = Figure(positions)
    camera = framing([figure], [positions], WIDTH, HEIGHT)
    points, bright = figure.pose(positions[:1])
    picture, painter = np.full((HEIGHT, WIDTH, 3), BACKGROUND, np.uint8), Painter(camera)
    ours = best(lambda: painter.draw(picture, points[0], bright[0], figure.triangles, figure.colors))
    pose = best(lambda: figure.pose(positions[:64])) / 64
    print(f"{len(figure.triangles)} triangles at {WIDTH}x{HEIGHT}")
    print(f"pose the mesh                {pose:7.2f} ms a frame")
    print(f"draw it                      {ours:7.2f} ms")
    other = best(lambda: opencv(camera, points[0], bright[0], figure), 10)
    print(f"cv2.triangleRasterize        {other:7.2f} ms = {other / ours:.1f} times as long, without the shadow")
    lines = best(lambda: matplotlib_lines(positions[0]), 5)
    print(f"matplotlib, bones as lines   {lines:7.2f} ms = {lines / ours:.1f} times as long")
    restless = np.abs(np.random.default_rng(1).normal(0, 0.2, (FRAMES, len(COSPEECH64)))).astype(np.float32)
    clip = Clip(
        "bench",
        "take",
        FPS,
        positions,
        np.zeros((FRAMES, 28), np.float32),
        expression=restless,
        rotation=np.zeros((FRAMES, 3), np.float32),
        face_model="cospeech64",
    )
    sound = np.random.default_rng(0).normal(0, 0.1, round(clip.duration * 16000)).astype(np.float32), 16000
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        for panels in (1, 2, 4):
            took = best(lambda n=panels: render_video(film, [("title", clip)] * n, audio=sound), 6) / 1000
            speed, size = clip.duration / took, film.stat().st_size / clip.duration / 1000
            rate = 2 * FRAMES / took
            print(f"film, {panels} side by side: {rate:4.0f} frames/s, {speed:.1f} times real time, {size:.0f} kB/s")


if __name__ == "__main__":
    main()
