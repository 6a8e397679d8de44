"""How fast are synthetic people: pictures a second, and the painter against a depth buffer in numpy and matplotlib.

python benchmarks/bench_posenet_people.py
"""

from functools import partial

import cv2
import matplotlib
import numpy as np
from timing import PROCESSOR, fastest

from cospeech.people import Canvas, draw_appearance, make_people, person_solids
from cospeech.people.batches import draw_people
from cospeech.people.painting import raster
from cospeech.people.painting.painter import LIGHT
from cospeech.skeleton import UPPER55

SIZE = 128
seconds = partial(fastest, clock=PROCESSOR)  # of one core, so that other work on the machine does not count


def trace(rows, camera):
    canvas = Canvas(np.zeros((SIZE, SIZE, 3), np.float32))
    canvas.paint(rows, camera)
    return canvas


def numpy_depth_buffer(rows, camera):
    """The same round cones (boxes and triangles left out), each over the pixels of its own window at once."""
    depth, color = np.full((SIZE, SIZE), raster.FAR), np.zeros((SIZE, SIZE, 3))
    v, u = np.mgrid[:SIZE, :SIZE]
    rays = np.stack([(u - camera[0, 2]) / camera[0, 0], (v - camera[1, 2]) / camera[1, 1], np.ones(u.shape)], axis=2)
    for s in rows[(rows[:, raster.KIND] == raster.CONE) & (rows[:, 15] > 0)]:
        axes, b, (ra, rb) = s[raster.AXES].reshape(3, 3), s[raster.END], s[raster.RADIUS]
        inverse = np.linalg.inv(axes)
        reach = np.linalg.norm(inverse, axis=1).max() * max(ra, rb)
        ends = np.stack([s[raster.ORIGIN], s[raster.ORIGIN] + inverse @ b])
        near = np.maximum(ends[:, 2] - reach, 0.05)
        middle = ends[:, :2] / near[:, None] * camera[0, 0] + camera[:2, 2]
        pad = reach / near.min() * camera[0, 0] + 1
        (u0, v0), (u1, v1) = np.clip([middle.min(0) - pad, middle.max(0) + pad], 0, SIZE).astype(int)
        if u0 >= u1 or v0 >= v1:
            continue
        d = rays[v0:v1, u0:u1] @ axes.T
        o = -axes @ s[raster.ORIGIN]
        best = np.full(d.shape[:2], np.inf)
        dd, db = (d * d).sum(2), d @ b
        e, y = b @ b - (ra - rb) ** 2, o @ b - ra * (ra - rb)
        with np.errstate(all="ignore"):
            if e > 1e-12:
                a_, b_ = e * dd - db**2, e * (d @ o) - y * db
                t = (-b_ - np.sqrt(b_**2 - a_ * (e * (o @ o - ra**2) - y * y))) / a_
                at = (y + t * db) / e
                best = np.where((at >= 0) & (at <= 1), t, best)
            for c, r in ((o, ra), (o - b, rb)):
                t = (-(d @ c) - np.sqrt((d @ c) ** 2 - dd * (c @ c - r * r))) / dd
                best = np.fmin(best, t)
        window = depth[v0:v1, u0:u1]
        hit = best < window
        window[hit], color[v0:v1, u0:u1][hit] = best[hit], s[raster.COLOR]
    return color


def matplotlib_limbs(figure, points):
    """Bones as thick lines: no depth, no shading, no face."""
    axes = figure.axes[0]
    axes.clear()
    for joint, parent in enumerate(UPPER55.tree):
        if parent >= 0:
            axes.plot(*points[[joint, parent], :2].T, linewidth=6, solid_capstyle="round")
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())


def film(joints, appearance, camera, size):
    solids = person_solids(joints, appearance)
    for rows in solids:
        canvas = Canvas(np.zeros((size[1], size[0], 3), np.uint8))
        canvas.paint(rows, camera, LIGHT)
        canvas.picture()


def main():
    cv2.setNumThreads(1)
    for part in ("body", "hand", "face"):
        rates = []
        for domain in ("studio", "wild"):
            list(make_people(64, domain=domain, part=part, size=SIZE))  # the first call compiles
            taken = seconds(lambda d=domain, p=part: list(make_people(256, domain=d, part=p, size=SIZE)), times=3)
            rates.append(256 / taken)
        print(f"{part:5s} {SIZE} px: {rates[0]:5.0f} pictures a second in the studio, {rates[1]:5.0f} in the wild")
    people = draw_people(0, "studio", "body", SIZE, 1.0, 0)
    some = range(16)
    ours = seconds(lambda: [trace(people.rows[i], people.camera[i]) for i in some]) / 16
    numpy = seconds(lambda: [numpy_depth_buffer(people.rows[i], people.camera[i]) for i in some], times=2) / 16
    matplotlib.use("agg")
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(1.28, 1.28), dpi=100)
    figure.add_subplot()
    lines = seconds(lambda: [matplotlib_limbs(figure, people.figure.joints[i]) for i in range(4)], times=2) / 4
    print(f"painting a person of {people.rows.shape[1]} solids: {1000 * ours:.2f} ms")
    print(f"    depth buffer in numpy, cones alone {1000 * numpy:.1f} ms: {numpy / ours:.0f} times as long")
    print(f"    bones as lines in matplotlib {1000 * lines:.1f} ms: {lines / ours:.0f} times as long")
    camera = np.array([[900.0, 0, 320], [0, 900.0, 240], [0, 0, 1]])
    joints = np.repeat(people.figure.joints[:1], 16, axis=0)
    joints = joints - joints[:, UPPER55.joints("neck")] + [0, 0, 2.2]
    taken = seconds(lambda: film(joints, draw_appearance("speaker"), camera, (640, 480)), times=3) / 16
    print(f"a frame of film, 640 x 480: {1000 * taken:.1f} ms")


if __name__ == "__main__":
    main()
