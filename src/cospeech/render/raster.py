"""Triangles to pixels: a perspective camera, a z-buffered Gouraud rasteriser and the blend over a background.

Per-pixel loops are compiled by numba. Samples are taken on a grid `SAMPLES` times finer than the picture in each
direction, so that edges are smooth; only the figure's bounding box is touched.
"""

from dataclasses import dataclass, replace

import cv2
import numba
import numpy as np

SAMPLES = 2  # per pixel and direction
SLACK = np.float32(1e-3)  # of a sample's width
SHADOW = 0.10  # how much the soft shadow on the wall darkens it


@dataclass(frozen=True)
class Camera:
    """A fixed pinhole camera in front of the character, looking along -z after a small pitch down.

    target (3,) metres is seen in the middle of the picture (width, height in pixels); distance in metres; focal in
    pixels; pitch in radians, positive when the camera stands above its target.
    """

    target: tuple
    distance: float
    focal: float
    pitch: float
    width: int
    height: int

    @property
    def axes(self):
        """(3, 3) rows: the picture's right, its up, and the direction towards the viewer."""
        cosine, sine = np.cos(self.pitch), np.sin(self.pitch)
        return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]], np.float32)

    def project(self, points):
        """(..., 3) metres -> (..., 3) float32: pixel x right, y down, and the inverse distance (greater is nearer)."""
        seen = (points - np.asarray(self.target, np.float32)) @ self.axes.T
        inverse = 1.0 / np.maximum(self.distance - seen[..., 2:], 0.05)
        flat = seen[..., :2] * inverse * self.focal
        half = np.array([self.width / 2, self.height / 2], np.float32)
        return np.concatenate([half + flat * np.array([1, -1], np.float32), inverse], -1).astype(np.float32)

    @classmethod
    def containing(cls, points, width, height, above=0.0, below=0.0, pitch=0.07, fov=0.42):
        """The nearest camera that sees all `points` (N, 3) and whose picture is centred between their extremes.

        `above` and `below` are shares of the height that stay free of them; x = 0 is in the middle; `fov` is the
        vertical angle of view in radians.
        """
        focal = height / 2 / np.tan(fov / 2)
        target = np.array([0, points[:, 1].min() + points[:, 1].max(), points[:, 2].min() + points[:, 2].max()]) / 2
        camera = cls(tuple(target), 1.0, float(focal), pitch, width, height)
        x, y, z = ((points - target) @ camera.axes.T).T
        # A point is inside when focal * y / (distance - z) stays below the edge; likewise for the other edges.
        edges = np.abs(x) / (0.48 * width), y / ((0.5 - above) * height), -y / ((0.5 - below) * height)
        return replace(camera, distance=float(max((z + focal * edge).max() for edge in edges)))


class Painter:
    """Draws meshes through one camera; it keeps its sample buffers from picture to picture."""

    def __init__(self, camera):
        self.camera = camera
        count = camera.height * camera.width * SAMPLES**2
        self._depth, self._samples = np.zeros(count, np.float32), np.zeros(count * 3, np.uint8)
        self.depth = self._depth[:0].reshape(0, 0)  # of the last picture's samples, 0 where nothing was drawn

    def draw(self, picture, points, colors, triangles):
        """Draw one mesh with a soft shadow onto `picture`, in place.

        picture (H, W, 3) uint8 BGR as the camera sees it; points (V, 3) metres; colors (V, 3) float32 0..255 BGR;
        triangles (F, 3) int32, counter-clockwise as seen from outside (others are not drawn).
        """
        pixels = self.camera.project(points)
        x0, y0 = np.maximum(np.floor(pixels[:, :2].min(0)).astype(int) - 1, 0)
        x1, y1 = np.minimum(np.ceil(pixels[:, :2].max(0)).astype(int) + 1, (self.camera.width, self.camera.height))
        if x0 >= x1 or y0 >= y1:
            return
        pixels[:, :2] = (pixels[:, :2] - np.array([x0, y0], np.float32)) * SAMPLES
        shape = int(y1 - y0) * SAMPLES, int(x1 - x0) * SAMPLES
        self.depth = depth = self._depth[: shape[0] * shape[1]].reshape(shape)
        samples = self._samples[: shape[0] * shape[1] * 3].reshape(*shape, 3)
        depth[:] = 0
        _rasterise(pixels, np.ascontiguousarray(colors, np.float32), triangles, depth, samples)
        _cast_shadow(picture, depth, x0, y0)
        _resolve(picture[y0:y1, x0:x1], depth, samples)


def _cast_shadow(picture, depth, x0, y0):
    """Darken the wall right of and below the figure, softly: its mask on a coarse grid, blurred and shifted."""
    height, coarse, border = len(picture), 4 * SAMPLES, 8
    blur = [max(height // 110, 2)] * 2
    mask = (depth[::coarse, ::coarse] > 0).astype(np.uint8) * np.uint8(255)
    mask = cv2.copyMakeBorder(mask, *[border] * 4, cv2.BORDER_CONSTANT)
    mask = cv2.resize(cv2.blur(cv2.blur(mask, blur), blur), None, fx=4, fy=4)
    top, left = y0 - 4 * border + height // 32, x0 - 4 * border + height // 32
    y, x = max(top, 0), max(left, 0)
    area = picture[y : top + mask.shape[0], x : left + mask.shape[1]]
    mask = mask[y - top : y - top + area.shape[0], x - left : x - left + area.shape[1]]
    area[:] = cv2.multiply(area, cv2.cvtColor(255 - cv2.convertScaleAbs(mask, alpha=SHADOW), cv2.COLOR_GRAY2BGR),
                           scale=1 / 255)  # fmt: skip


@numba.njit(cache=True, error_model="numpy")
def fade_out(picture, rows, color):
    """Blend the lowest `rows` of `picture` (H, W, 3) uint8 into `color`, in place: nothing above, nearly all below."""
    first = picture.shape[0] - rows
    for y in range(rows):
        part = 0.96 * np.sqrt((y + 1) / rows)
        for x in range(picture.shape[1]):
            for c in range(3):
                value = picture[first + y, x, c]
                picture[first + y, x, c] = np.uint8(value + (color[c] - value) * part + 0.5)


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _narrow(first, last, weight, step, inverse):
    """The part of the columns first..last in which `weight + column * step` is not negative; inverse = -1 / step.

    A little more is taken, so that rounding leaves no gap between neighbours.
    """
    if step > 0:
        return max(first, np.ceil(weight * inverse - SLACK)), last
    if step < 0:
        return first, min(last, np.floor(weight * inverse + SLACK))
    return first, (last if weight >= -SLACK else np.float32(-1.0))


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _rasterise(points, colors, triangles, depth, samples):
    """Fill `samples` (H, W, 3) uint8 and `depth` (H, W), the inverse distance, 0 where nothing was drawn.

    Row by row: a triangle's span follows from where its barycentric weights change sign; depth and colour are linear.
    """
    zero, half, one = np.float32(0), np.float32(0.5), np.float32(1)
    height, last_column = depth.shape[0], np.float32(depth.shape[1] - 1)
    for f in range(triangles.shape[0]):
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        ax, ay = points[a, 0], points[a, 1]
        bx, by, cx, cy = points[b, 0] - ax, points[b, 1] - ay, points[c, 0] - ax, points[c, 1] - ay
        area = bx * cy - by * cx
        if area >= np.float32(-1e-6):  # the picture's y runs down, so counter-clockwise outside means negative here
            continue
        step_b, step_c = cy / area, -by / area  # change of the weights of b and c per column
        step_a = -step_b - step_c
        inverse_a, inverse_b, inverse_c = -one / step_a, -one / step_b, -one / step_c
        near_b, near_c = points[b, 2] - points[a, 2], points[c, 2] - points[a, 2]
        blue_b, blue_c = colors[b, 0] - colors[a, 0], colors[c, 0] - colors[a, 0]
        green_b, green_c = colors[b, 1] - colors[a, 1], colors[c, 1] - colors[a, 1]
        red_b, red_c = colors[b, 2] - colors[a, 2], colors[c, 2] - colors[a, 2]
        top = max(int(np.ceil(ay + min(zero, by, cy) - half)), 0)
        bottom = min(int(ay + max(zero, by, cy) + half), height)
        for y in range(top, bottom):
            px, py = half - ax, np.float32(y) + half - ay
            start_b, start_c = (px * cy - py * cx) / area, (py * bx - px * by) / area
            first, last = _narrow(zero, last_column, start_b, step_b, inverse_b)
            first, last = _narrow(first, last, start_c, step_c, inverse_c)
            first, last = _narrow(first, last, one - start_b - start_c, step_a, inverse_a)
            if first > last:
                continue
            weight_b, weight_c = start_b + first * step_b, start_c + first * step_c
            near = points[a, 2] + weight_b * near_b + weight_c * near_c
            blue = colors[a, 0] + weight_b * blue_b + weight_c * blue_c
            green = colors[a, 1] + weight_b * green_b + weight_c * green_c
            red = colors[a, 2] + weight_b * red_b + weight_c * red_c
            for x in range(int(first), int(last) + 1):
                if near > depth[y, x]:
                    depth[y, x] = near
                    samples[y, x, 0], samples[y, x, 1], samples[y, x, 2] = (
                        np.uint8(blue),
                        np.uint8(green),
                        np.uint8(red),
                    )
                near += step_b * near_b + step_c * near_c
                blue += step_b * blue_b + step_c * blue_c
                green += step_b * green_b + step_c * green_c
                red += step_b * red_b + step_c * red_c


@numba.njit(cache=True, error_model="numpy")
def _resolve(picture, depth, samples):
    """Average each pixel's samples, taking the picture below where a sample hit nothing."""
    total = np.uint32(SAMPLES * SAMPLES)
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            below, blue, green, red = total, np.uint32(0), np.uint32(0), np.uint32(0)
            for j in range(SAMPLES):
                for i in range(SAMPLES):
                    if depth[y * SAMPLES + j, x * SAMPLES + i] > 0:
                        below -= np.uint32(1)
                        blue += samples[y * SAMPLES + j, x * SAMPLES + i, 0]
                        green += samples[y * SAMPLES + j, x * SAMPLES + i, 1]
                        red += samples[y * SAMPLES + j, x * SAMPLES + i, 2]
            if below < total:
                picture[y, x, 0] = (blue + below * picture[y, x, 0]) // total
                picture[y, x, 1] = (green + below * picture[y, x, 1]) // total
                picture[y, x, 2] = (red + below * picture[y, x, 2]) // total
