"""Where to look: boxes about a person, a hand or a face, and the upright crops that networks are fed with."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

HAND_SIZE = 0.5  # side of a hand's first box, in shoulder widths
HAND_BEYOND = 0.3  # its centre, beyond the wrist in the same direction, in forearms (elbow to wrist)
HEAD_SIZE = 0.75  # side of a head's first box, in shoulder widths
FACE_SIZE = 0.5  # the same of the landmarks alone, which end at brows and chin
SPREAD = (-0.8, -0.4, 0.0, 0.4, 0.8)  # where a part is searched for around its first box, in the box's sides
WIDTHS = [
    ("left_shoulder", "right_shoulder", 1.0),
    ("left_shoulder", "left_elbow", 1.1),
    ("right_shoulder", "right_elbow", 1.1),
]
FRAMES = 31  # over which such a width is steadied
ALIKE = 0.6, 1.5  # how much smaller and larger than the first box a box may become
HEADS = (("nose",), ("left_ear", "right_ear"), ("head",), ("head_top", "neck"))  # the first that a skeleton has


@dataclass
class Crop:
    """An upright rectangle of a picture as a network sees it: centre and size in the picture's pixels.

    `flipped` crops are mirrored: a network that knows right hands sees a left one. Pixel (0, 0) is the centre of the
    first pixel, in crop and picture.
    """

    centre: np.ndarray
    size: np.ndarray
    pixels: tuple  # (width, height) of the crop itself
    flipped: bool = False

    def cut(self, rgb):
        """(height, width, 3) uint8; black beyond the picture, averaged down first where it shrinks."""
        import cv2

        shrink = int(max(1, min(self.size / self.pixels)))
        if shrink > 1:
            low = np.clip(np.floor(self.centre - self.size / 2).astype(int) - shrink, 0, None)
            high = np.ceil(self.centre + self.size / 2).astype(int) + shrink
            part = rgb[low[1] : high[1], low[0] : high[0]]
            if min(part.shape[:2]) < shrink:
                return np.zeros((*self.pixels[::-1], 3), np.uint8)
            small = (part.shape[1] // shrink, part.shape[0] // shrink)
            rgb = cv2.resize(part[: small[1] * shrink, : small[0] * shrink], small, interpolation=cv2.INTER_AREA)
            to_small = lambda xy: (xy - low + 0.5) / shrink - 0.5
        else:
            to_small = lambda xy: xy
        corners = np.array([[0, 0], [1, 0], [0, 1]], float)
        source = np.float32([to_small(xy) for xy in self.to_picture(corners)])
        inverse = np.column_stack([source[1] - source[0], source[2] - source[0], source[0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(rgb, inverse.astype(np.float64), self.pixels, flags=flags)

    def to_picture(self, xy):
        """Pixels of the crop (..., 2) -> of the picture."""
        width, height = self.pixels
        share = (np.asarray(xy, np.float64) + 0.5) / (width, height) - 0.5
        if self.flipped:
            share = share * (-1, 1)
        return self.centre + share * self.size


def crop_about(box, margin, pixels, flipped=False):
    """The `Crop` of a network's width and height about a box (x, y, width, height: centre and size), `margin` wider."""
    aspect = pixels[0] / pixels[1]
    width = max(box[2] * margin, box[3] * margin * aspect, 2.0)
    return Crop(np.asarray(box[:2], float), np.array([width, width / aspect]), tuple(pixels), flipped)


def whole_picture(width, height):
    """The box of a whole picture."""
    return np.array([(width - 1) / 2, (height - 1) / 2, width, height])


def box_of(xy, score, least):
    """(4,) box of those of the (K, 2) points whose score is at least `least`, or None for fewer than three."""
    sure = xy[score >= least]
    if len(sure) < 3:
        return None
    low, high = sure.min(axis=0), sure.max(axis=0)
    return np.concatenate([(low + high) / 2, high - low])


def hand_boxes(body, side):
    """(F, 4) first boxes of the "left" or "right" hand by the forearm of a body's `Points`; NaN where unobserved."""
    elbow, wrist = (body.xy[:, j] for j in body.table.joints(f"{side}_elbow", f"{side}_wrist"))
    centre = wrist + HAND_BEYOND * (wrist - elbow)
    return _squares(centre, HAND_SIZE * _shoulders(body), body.observed)


def face_boxes(body, size=HEAD_SIZE):
    """(F, 4) first boxes of the face, `size` shoulder widths wide, by a body's `Points`; NaN where unobserved."""
    index = body.table.index
    names = next(names for names in HEADS if all(name in index for name in names))
    return _squares(body.xy[:, body.table.joints(*names)].mean(axis=1), size * _shoulders(body), body.observed)


def around(box):
    """[(4,)] boxes of the same size in a grid about a box (4,)."""
    return [box + box[2] * np.array([x, y, 0, 0]) for x in SPREAD for y in SPREAD]


def like(box, first):
    """A square (4,) about a box's centre, as large as the box, but not much smaller or larger than the first box."""
    side = np.clip(max(box[2:]), ALIKE[0] * first[2], ALIKE[1] * first[2])
    return np.array([*box[:2], side, side])


def landmark_boxes(points):
    """(F, 4) boxes about landmarks that were seen before; NaN where unobserved."""
    low, high = points.xy.min(axis=1), points.xy.max(axis=1)
    return _squares((low + high) / 2, (high - low).max(axis=1), points.observed)


def _shoulders(body):
    """(F,) width of the shoulders in pixels, or of what would be as wide where they are seen from the side: the median
    over a second or two, as one frame's is easily wrong."""
    width = np.zeros(len(body))
    for start, end, share in WIDTHS:
        a, b = (body.xy[:, j] for j in body.table.joints(start, end))
        width = np.maximum(width, share * np.linalg.norm(a - b, axis=1))
    known = np.flatnonzero(body.observed)
    filled = np.interp(np.arange(len(body)), known, width[known]) if len(known) else width
    return median_filter(filled, FRAMES, mode="nearest")


def _squares(centre, side, observed):
    boxes = np.column_stack([centre, side, side]).astype(float)
    boxes[~observed | (side < 2)] = np.nan
    return boxes
