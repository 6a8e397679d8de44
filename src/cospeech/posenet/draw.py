"""Pictures of poses by OpenCV: joints over the image, and the 3D pose from the front and from the side."""

import cv2
import numpy as np

SIDES = {"right": (230, 120, 40), "left": (40, 120, 230)}  # RGB
MIDDLE = (60, 170, 90)
PAPER, LINE = 255, 210  # grey levels


def draw_pose(image, joints2d, joints3d, names, parents):
    """An image (H, W, 3) uint8 RGB with its pose, and two views of the 3D pose beside it -> (H, W + 2 H, 3) uint8.

    joints2d (J, 2) pixels; joints3d (J, 3) mm, x right, y down, z away. Left and right have colours of their own.
    """
    bones = [(child, parent, _colour(names[child])) for child, parent in enumerate(parents) if parent >= 0]
    views = [_view(joints3d, axis, image.shape[0], bones) for axis in ([0, 1], [2, 1])]
    return np.concatenate([_overlay(image, joints2d, bones), *views], axis=1)


def _colour(name):
    return SIDES.get(name.split("_")[0], MIDDLE)


def _overlay(image, joints2d, bones):
    width = max(1, round(max(image.shape[:2]) / 200))
    return _draw(np.ascontiguousarray(image).copy(), joints2d, bones, width)


def _view(joints3d, axes, side, bones):
    """The pose seen along the axis that is left out, in a square of its own."""
    canvas = np.full((side, side, 3), PAPER, np.uint8)
    points = joints3d[:, axes]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    reach = max(1.0, 1.1 * np.ptp(joints3d, axis=0).max())  # the same for both views
    cv2.line(canvas, (0, side // 2), (side, side // 2), (LINE,) * 3)
    cv2.line(canvas, (side // 2, 0), (side // 2, side), (LINE,) * 3)
    return _draw(canvas, (points - middle) / reach * side + side / 2, bones, max(1, side // 150))


def _draw(canvas, points, bones, width):
    at = [tuple(int(v) for v in point) for point in np.round(np.clip(points, -1e4, 1e4))]
    for child, parent, colour in bones:
        cv2.line(canvas, at[child], at[parent], colour, width, cv2.LINE_AA)
    for child, _, colour in bones:
        cv2.circle(canvas, at[child], width + 1, colour, -1, cv2.LINE_AA)
    return canvas
