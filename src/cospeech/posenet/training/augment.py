"""Augmentation of crops (thesis 3.4.1): every step moves image, mask, 2D and 3D joints together.

A crop that is scaled, shifted and turned is the picture of a camera K' = A K whose frame is turned about z by the same
angle: with square pixels that is exact for any centre of the turn. A mirror image is that of the mirrored person, left
and right swapped, x negated in 3D.
"""

import cv2
import numpy as np

from cospeech.errors import CospeechError
from cospeech.posenet.datasets.parts import PARTS
from cospeech.posenet.samples import Batch
from cospeech.posenet.threads import in_threads


def augment(
    batch,
    rng,
    size,
    *,
    part="body",
    margin=1.0,
    scale=0.2,
    rotate=30.0,
    translate=0.1,
    flip=0.5,
    colour=0.2,
    background=None,
    replace=0.5,
    occlude=0.0,
    blur=0.0,
):
    """Random crops of a batch: `Batch` of N crops of any side -> new `Batch` of N crops of side `size`.

    Parameters
    ----------
    rng : numpy Generator; the same state gives the same bytes.
    margin : how many times wider than the network's crop the given images are (`Store.margin`).
    scale : zoom by a factor drawn log-uniformly between 1 / (1 + scale) and 1 + scale.
    rotate : turn in the image plane by at most so many degrees. translate : shift by at most this share of the side.
    flip : chance of a mirror image; parts without one (hands) are never mirrored.
    colour : contrast and each channel by a factor within 1 +- colour, brightness by as much of 64 grey levels.
    background : (M, h, w, 3) uint8 images, put behind the person (`mask`) with chance `replace`, and pieces of them in
        front of it with chance `occlude`; joints behind a piece are no longer visible.
    blur : Gaussian blur of at most so many pixels, of every second crop.
    """
    count = len(batch)
    result = _moved(batch, rng, size, batch.images.shape[1], part, margin, scale, rotate, translate, flip)
    if background is not None and len(background) and batch.mask is not None:
        _replace_background(result, rng, background, rng.random(count) < replace)
    if background is not None and len(background) and occlude:
        _occlude(result, rng, background, rng.random(count) < occlude)
    if blur:
        _blur(result.images, rng.uniform(-blur, blur, count))
    if colour:
        _jitter(result.images, rng, colour)
    return result


def augment_labels(batch, rng, size, *, side, part="body", margin=1.0, scale=0.2, rotate=30.0, translate=0.1, flip=0.5):
    """`augment` of a batch of labels without images (None), which are of crops of `side` pixels."""
    return _moved(batch, rng, size, side, part, margin, scale, rotate, translate, flip)


def _moved(batch, rng, size, side, part, margin, scale, rotate, translate, flip):
    count = len(batch)
    flipped = (rng.random(count) < flip) & PARTS[part].mirrored
    zoom = side / margin / np.exp(rng.uniform(-1, 1, count) * np.log1p(scale)) / size  # stored pixels per new pixel
    angle = np.radians(rng.uniform(-rotate, rotate, count))
    shift = rng.uniform(-translate, translate, (count, 2)) * size
    return transform(batch, size, zoom, angle, shift, flipped, part, side)


def center(batch, size, *, part="body", margin=1.0):
    """The middle of each crop at the network's size, nothing at random: for validation and tests."""
    none = np.zeros(len(batch))
    zoom = np.full(len(batch), batch.images.shape[1] / margin / size)
    return transform(batch, size, zoom, none, np.zeros((len(batch), 2)), none.astype(bool), part)


def transform(batch, size, zoom, angle, shift, flipped, part="body", side=None):
    """Crops of side `size` about the middle of those of a batch -> `Batch`.

    side : of the given crops in pixels, where the batch has no images (None).

    zoom (N,) : pixels of the given crop per pixel of the new one. angle (N,) : radians, from x towards y.
    shift (N, 2) : pixels of the new crop. flipped (N,) bool : mirrored in x after all else.
    """
    side = batch.images.shape[1] if side is None else side
    if part not in PARTS:
        raise CospeechError(f"augment: part {part!r} is unknown; known: {', '.join(PARTS)}")
    matrices = _matrices(side, size, zoom, angle, shift, flipped)
    points = batch.joints2d @ matrices[:, :, :2].swapaxes(1, 2) + matrices[:, None, :, 2]
    points = np.where(flipped[:, None, None], points[:, PARTS[part].mirror2d], points)
    visible = np.where(flipped[:, None], batch.visible[:, PARTS[part].mirror2d], batch.visible)
    inside = ((points >= -0.5) & (points < size - 0.5)).all(axis=2)
    poses = np.where(
        flipped[:, None, None], batch.joints3d[:, PARTS[part].skeleton.mirror] * [-1, 1, 1], batch.joints3d
    )
    turn = np.where(flipped, -angle, angle)  # of the mirrored person
    poses = np.concatenate([_turned(poses[..., :2], turn), poses[..., 2:]], axis=2)
    visible &= inside
    images = None if batch.images is None else _warp(batch.images, matrices, size, zoom)
    return Batch(
        images,
        np.where(visible[..., None], points, 0).astype(np.float32),
        visible,
        poses.astype(np.float32),
        batch.labelled3d.copy(),
        None if batch.mask is None else _warp(batch.mask, matrices, size, zoom),
        dict(batch.tags),
    )


def _matrices(side, size, zoom, angle, shift, flipped):
    """(N, 2, 3) from given to new pixels."""
    count = len(zoom)
    turn = _rotation(angle) / zoom[:, None, None]
    offset = (size - 1) / 2 + shift - (turn @ np.full(2, (side - 1) / 2))
    matrices = np.concatenate([turn, offset[..., None]], axis=2)
    mirror = np.tile(np.eye(2), (count, 1, 1))
    mirror[flipped, 0, 0] = -1
    matrices = mirror @ matrices
    matrices[flipped, 0, 2] += size - 1
    return matrices


def _rotation(angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)


def _turned(points, angle):
    return points @ _rotation(angle).swapaxes(1, 2)


def _warp(images, matrices, size, zoom):
    """Images (N, S, S[, 3]) -> (N, size, size[, 3]); one that shrinks to half or less is averaged down first."""
    result = np.empty((len(images), size, size, *images.shape[3:]), np.uint8)

    def warp(chosen):
        for i in chosen:
            image, matrix = _shrunk(images[i], matrices[i], zoom[i])
            cv2.warpAffine(image, matrix, (size, size), dst=result[i], flags=cv2.INTER_LINEAR)

    in_threads(warp, len(images))
    return result


def _shrunk(image, matrix, zoom):
    """The image averaged down by the whole part of a zoom of 2 or more, and the matrix for what is left."""
    if zoom < 2:
        return image, matrix
    small = max(1, round(image.shape[0] / int(zoom)))
    ratio = image.shape[0] / small
    middle = np.full(2, (ratio - 1) / 2)  # a small pixel's centre in pixels of the larger image
    image = cv2.resize(image, (small, small), interpolation=cv2.INTER_AREA)
    return image, np.column_stack([matrix[:, :2] * ratio, matrix[:, :2] @ middle + matrix[:, 2]])


def _replace_background(batch, rng, background, chosen):
    """Other pictures behind the persons, in place: a random square of one, at most as large as it is, at least half."""
    size = batch.images.shape[1]
    height, width = background.shape[1:3]
    picture = rng.integers(len(background), size=len(batch))
    sides = np.maximum(1, rng.uniform(0.5, 1, len(batch)) * min(height, width)).astype(int)
    corners = (rng.random((len(batch), 2)) * (np.array([width, height]) - sides[:, None] + 1)).astype(int)

    def compose(indices):
        for i in indices:
            if not chosen[i] or batch.mask[i].all():
                continue
            (x, y), side = corners[i], sides[i]
            behind = cv2.resize(background[picture[i], y : y + side, x : x + side], (size, size))
            alpha = cv2.cvtColor(batch.mask[i], cv2.COLOR_GRAY2RGB)
            person = cv2.multiply(batch.images[i], alpha, scale=1 / 255)
            batch.images[i] = cv2.add(person, cv2.multiply(behind, cv2.bitwise_not(alpha), scale=1 / 255))

    in_threads(compose, len(batch))


def _occlude(batch, rng, background, chosen):
    """A rectangle of another picture, a sixth to a half of the side wide and high, in front of the person, in place."""
    size, count = batch.images.shape[1], len(batch)
    extents = np.maximum(1, rng.uniform(1 / 6, 1 / 2, (count, 2)) * size).astype(int)
    corners = (rng.random((count, 2)) * (size - extents + 1)).astype(int)
    pictures = rng.integers(len(background), size=count)
    for i in np.flatnonzero(chosen):
        (x, y), (width, height) = corners[i], extents[i]
        piece = cv2.resize(background[pictures[i]], (size, size))[y : y + height, x : x + width]
        batch.images[i, y : y + height, x : x + width] = piece[::-1, ::-1]  # turned, so that it does not continue
        inside = (batch.joints2d[i] >= corners[i]) & (batch.joints2d[i] < corners[i] + extents[i])
        batch.visible[i] &= ~inside.all(axis=1)
    batch.joints2d[~batch.visible] = 0


def _blur(images, deviations):
    """Gaussian blur by these deviations in pixels, those below 0.3 none, in place."""

    def soften(indices):
        for i in indices:
            if deviations[i] > 0.3:
                cv2.GaussianBlur(images[i], (0, 0), deviations[i], dst=images[i])

    in_threads(soften, len(images))


def _jitter(images, rng, strength):
    """Contrast, brightness and white balance, in place, by one table a channel."""
    count = len(images)
    gain = (1 + strength * rng.uniform(-1, 1, (count, 1))) * (1 + strength * rng.uniform(-1, 1, (count, 3)))
    bias = strength * 64 * rng.uniform(-1, 1, (count, 1))
    levels = np.arange(256)[:, None]
    tables = np.clip((levels - 128) * gain[:, None] + 128 + bias[:, None], 0, 255).round().astype(np.uint8)

    def look_up(indices):
        for i in indices:
            cv2.LUT(images[i], tables[i][None], dst=images[i])

    in_threads(look_up, count)
