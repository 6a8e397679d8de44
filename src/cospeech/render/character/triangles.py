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
BRIGHT = 160  # steps of brightness to 1
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
    """Draws meshes through one camera; it keeps its sample buffer from picture to picture."""

    def __init__(self, camera):
        self.camera = camera
        self._samples = np.zeros(camera.height * camera.width * SAMPLES**2, np.uint32)
        self.samples = self._samples[:0].reshape(0, 0)  # of the last picture; 0 where nothing was drawn
        self._palettes = {}  # of the colours of meshes that were drawn

    def draw(self, picture, points, bright, triangles, colors):
        """Draw one mesh with a soft shadow onto `picture`, in place.

        picture (H, W, 3) uint8 BGR as the camera sees it; points (V, 3) metres; bright (V,) float32, 1 as the colours
        are, at most 1.5; triangles (F, 3) int32, counter-clockwise as seen from outside (others are not drawn); colors
        (F, 3) float32 0..255 BGR, at most 32 different ones.
        """
        camera = self.camera
        lens = np.float32([camera.distance, camera.focal, camera.width / 2, camera.height / 2])
        pixels, box = _project(np.asarray(points, np.float32), camera.axes, np.float32(camera.target), lens)
        x0, y0 = np.maximum(np.floor(box[:2]).astype(int) - 1, 0)
        x1, y1 = np.minimum(np.ceil(box[2:4]).astype(int) + 1, (camera.width, camera.height))
        if x0 >= x1 or y0 >= y1:
            return
        shape = int(y1 - y0) * SAMPLES, int(x1 - x0) * SAMPLES
        self.samples = self._samples[: shape[0] * shape[1]].reshape(shape)
        self.samples[:] = 0
        shades, chosen = self._palette(colors)
        _rasterise(pixels, np.float32([x0, y0]), box[4:], bright, triangles, chosen, self.samples)
        _cast_shadow(picture, self.samples, x0, y0)
        _resolve(picture[y0:y1, x0:x1], self.samples, shades)

    def _palette(self, colors):
        """Shades (C * 256,) uint32, each colour in 256 brightnesses; where each triangle's (F,) begin there."""
        if id(colors) not in self._palettes:
            palette, chosen = np.unique(colors, axis=0, return_inverse=True)
            shades = np.clip(palette[:, None] * (np.arange(256) / BRIGHT)[:, None], 0, 255).astype(np.uint32)
            packed = shades[..., 0] | shades[..., 1] << 8 | shades[..., 2] << 16
            self._palettes[id(colors)] = colors, packed.ravel(), (chosen.ravel() * 256).astype(np.int64)
        return self._palettes[id(colors)][1:]


def _cast_shadow(picture, samples, x0, y0):
    """Darken the wall right of and below the figure, softly: its mask on a coarse grid, blurred and shifted."""
    height, coarse, border = len(picture), 4 * SAMPLES, 8
    blur = [max(height // 110, 2)] * 2
    mask = (samples[::coarse, ::coarse] > 0).astype(np.uint8) * np.uint8(255)
    mask = cv2.copyMakeBorder(mask, *[border] * 4, cv2.BORDER_CONSTANT)
    mask = cv2.resize(cv2.blur(cv2.blur(mask, blur), blur), None, fx=4, fy=4)
    top, left = y0 - 4 * border + height // 32, x0 - 4 * border + height // 32
    y, x = max(top, 0), max(left, 0)
    _darken(picture[y : top + mask.shape[0], x : left + mask.shape[1]], mask[y - top :, x - left :])


@numba.njit(cache=True, error_model="numpy")
def _darken(area, mask):
    """Darken an area (H, W, 3) uint8 by up to SHADOW where a mask of at least its size has 255."""
    part = np.uint32(SHADOW * 257)
    for y in range(area.shape[0]):
        for x in range(area.shape[1]):
            if mask[y, x]:
                keep = np.uint32(65536) - part * np.uint32(mask[y, x])
                for c in range(3):
                    area[y, x, c] = (area[y, x, c] * keep + np.uint32(32768)) >> np.uint32(16)


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
def _project(points, axes, target, lens):
    """`Camera.project` of (V, 3) points, and their box (6,): least x, y, greatest x, y, farthest and nearest."""
    distance, focal, middle_x, middle_y = lens
    pixels, box = np.empty_like(points), np.array([np.inf, np.inf, -np.inf, -np.inf, np.inf, -np.inf], np.float32)
    for v in range(points.shape[0]):
        x, y, z = points[v, 0] - target[0], points[v, 1] - target[1], points[v, 2] - target[2]
        near = np.float32(1) / max(distance - (axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z), np.float32(0.05))
        across = middle_x + (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z) * near * focal
        down = middle_y - (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z) * near * focal
        pixels[v, 0], pixels[v, 1], pixels[v, 2] = across, down, near
        box[0], box[1], box[2], box[3] = min(box[0], across), min(box[1], down), max(box[2], across), max(box[3], down)
        box[4], box[5] = min(box[4], near), max(box[5], near)
    return pixels, box


@numba.njit(cache=True, error_model="numpy", fastmath=True, inline="always")
def _span(first, last, weight, step, inverse):
    """The part of the columns first..last in which `weight + column * step` is not negative; inverse = -1 / step."""
    if step > 0:
        return max(first, np.ceil(weight * inverse)), last
    if step < 0:
        return first, min(last, np.floor(weight * inverse))
    return first, (last if weight >= 0 else np.float32(-1.0))


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _rasterise(pixels, corner, depths, bright, triangles, chosen, samples):
    """Fill `samples` (H, W) uint32: nearness in the upper 19 bits, a shade's number in the lower 13, 0 for nothing.

    A triangle is walked row by row: barycentric weights of its corners tell where it begins and ends, SLACK farther
    out, so that rounding leaves no gap. Along a row, nearness and light are whole numbers that grow by whole steps.
    What is nearer is the greater number, so the nearest sample stays without a branch.
    """
    half, zero, one, scale = np.float32(0.5), np.float32(0), np.float32(1), np.float32(SAMPLES)
    height, width, flat = samples.shape[0], samples.shape[1], samples.ravel()
    far, deep = depths[0], np.float32(2**19 - 4) / max(depths[1] - depths[0], np.float32(1e-6))
    steps, above = np.float32(BRIGHT * 2**16), ~np.int64(2**13 - 1)
    for f in range(triangles.shape[0]):
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        ax, ay = (pixels[a, 0] - corner[0]) * scale, (pixels[a, 1] - corner[1]) * scale
        bx, by = (pixels[b, 0] - corner[0]) * scale - ax, (pixels[b, 1] - corner[1]) * scale - ay
        cx, cy = (pixels[c, 0] - corner[0]) * scale - ax, (pixels[c, 1] - corner[1]) * scale - ay
        area = bx * cy - by * cx
        if area >= np.float32(-1e-6):  # the picture's y runs down, so counter-clockwise outside means negative here
            continue
        left = max(int(np.ceil(ax + min(zero, bx, cx) - half - SLACK)), 0)
        right = min(int(np.floor(ax + max(zero, bx, cx) - half + SLACK)), width - 1)
        top = max(int(np.ceil(ay + min(zero, by, cy) - half - SLACK)), 0)
        bottom = min(int(np.floor(ay + max(zero, by, cy) - half + SLACK)), height - 1)
        if left > right or top > bottom:
            continue  # it lies between the samples
        b_x, c_x, b_y, c_y = cy / area, -by / area, -cx / area, bx / area  # change of weights per column and row
        a_x, slack = -b_x - c_x, SLACK * max(abs(b_x), abs(c_x), abs(b_y), abs(c_y))
        inverse_a, inverse_b, inverse_c = -one / a_x, -one / b_x, -one / c_x
        near_a, light_a = (pixels[a, 2] - far) * deep + 2, bright[a] * steps
        near_b, near_c = (pixels[b, 2] - pixels[a, 2]) * deep, (pixels[c, 2] - pixels[a, 2]) * deep
        light_b, light_c = bright[b] * steps - light_a, bright[c] * steps - light_a
        near_x = np.int64((b_x * near_b + c_x * near_c) * np.float32(2**24))
        light_x, shade = np.int64(b_x * light_b + c_x * light_c), chosen[f]
        px, py = np.float32(left) + half - ax, np.float32(top) + half - ay
        weight_b, weight_c = px * b_x + py * b_y, px * c_x + py * c_y
        for y in range(top, bottom + 1):
            first, last = zero, np.float32(right - left)
            first, last = _span(first, last, weight_b + slack, b_x, inverse_b)
            first, last = _span(first, last, weight_c + slack, c_x, inverse_c)
            first, last = _span(first, last, one - weight_b - weight_c + slack, a_x, inverse_a)
            begin = np.int64(first)
            near = np.int64((near_a + weight_b * near_b + weight_c * near_c) * np.float32(2**24)) + begin * near_x
            light = np.int64(light_a + weight_b * light_b + weight_c * light_c) + begin * light_x
            at = np.uint64(y * width + left + begin)
            for _ in range(np.int64(last) - begin + 1):
                flat[at] = max(flat[at], np.uint32(((near >> 11) & above) | (shade + (light >> 16))))
                near += near_x
                light += light_x
                at += np.uint64(1)
            weight_b += b_y
            weight_c += c_y


@numba.njit(cache=True, error_model="numpy")
def _resolve(picture, samples, shades):
    """Average each pixel's samples, taking the picture below where a sample hit nothing."""
    total = np.uint32(SAMPLES * SAMPLES)
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            # Two sums in one number each: blue and red 16 bits apart, green alone.
            below, outer, green = total, np.uint32(0), np.uint32(0)
            for j in range(SAMPLES):
                for i in range(SAMPLES):
                    sample = samples[y * SAMPLES + j, x * SAMPLES + i]
                    if sample > 0:
                        shade = shades[sample & np.uint32(2**13 - 1)]
                        below -= np.uint32(1)
                        outer += shade & np.uint32(0xFF00FF)
                        green += (shade >> np.uint32(8)) & np.uint32(0xFF)
            if below < total:
                picture[y, x, 0] = ((outer & np.uint32(0xFFFF)) + below * picture[y, x, 0]) // total
                picture[y, x, 1] = (green + below * picture[y, x, 1]) // total
                picture[y, x, 2] = ((outer >> np.uint32(16)) + below * picture[y, x, 2]) // total
