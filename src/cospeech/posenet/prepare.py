"""From a data set's samples to crops: the thesis' tight box with room around it, targets perspective-corrected."""

import cv2
import numpy as np
from tqdm import tqdm

from cospeech.errors import CospeechError
from cospeech.posenet.camera import CORRECTIONS, DEFAULT_MARGIN, camera_matrix, person_crop
from cospeech.posenet.datasets import open_dataset
from cospeech.posenet.datasets.parts import PARTS
from cospeech.posenet.samples import Batch
from cospeech.posenet.store import write_store

MARGIN = 1.5  # of the stored crop over the network's: a turn of 30 degrees and a shift of a tenth stay inside
HABITS = {  # every n-th frame, unless asked otherwise: as SPIN; thesis 3.4.1's 5 of 50 a second and every 64th
    "mpi_inf_3dhp_train": {"train": 10},
    "h36m": {"train": 10, "test": 64},
}
BATCH = 32  # crops held in memory
FEWEST = 3  # visible joints that a crop is cut around
FEW, SPANLESS = f"fewer than {FEWEST} visible joints", "visible joints that span no box"


def prepare(name, folder, out, *, part="body", correction="full", size=256, margin=MARGIN, progress=True, **options):
    """Turn a data set into one store: the work of `cospeech posenet prepare`.

    name, folder, options : of `open_dataset`.
    size : side of the network's crop; what is stored is `margin` times as wide.

    Returns (how many crops were written, {reason: count} of what was left out, the most frequent first).
    """
    _check(name, part, correction, size, margin)
    dataset = open_dataset(name, folder, **_options(name, part, options))
    if dataset.part != part:
        raise CospeechError(f"{name}: has no {part} to prepare; it is a data set of the {dataset.part}")
    samples = tqdm(dataset, name, unit=" samples", disable=not progress)
    count = write_store(
        out,
        crops(samples, part, dataset.dropped, round(size * margin), margin, correction),
        part=part,
        source=name,
        margin=margin,
        licence_note=dataset.licence_note,
        dropped=dataset.dropped,
        correction=correction,
        **{key: str(value) for key, value in options.items()},
    )
    return count, {reason: number for reason, number in dataset.dropped.most_common() if number}


def _check(name, part, correction, size, margin):
    if part not in PARTS:
        raise CospeechError(f"{name}: part {part!r} is unknown; known: {', '.join(PARTS)}")
    if correction not in CORRECTIONS:
        raise CospeechError(f"perspective correction {correction!r} is unknown; known: {', '.join(CORRECTIONS)}")
    if size < 16 or margin < 1:
        raise CospeechError(f"size {size} and margin {margin:g}: expected at least 16 pixels and 1")


def _options(name, part, options):
    """Those for `open_dataset`, with the habits of training. Joints that are hidden but labelled count: b_k of equation
    3.3 is about missing ones."""
    if name in HABITS and options.get("frame_list") is None:
        options = {"every": HABITS[name].get(options.get("subset", "train"), 1), **options}
    if name == "coco_wholebody":
        options = {"part": part, **options}
    if name in ("lsp", "mpii"):
        options = {"occluded": True, **options}
    return options


def crops(samples, part, dropped, size, margin=1.0, correction="full"):
    """Samples -> iterator of `Batch`es of at most `BATCH` crops of side `size`.

    margin : how many times wider than the network's crop. Samples that have no box are counted in `dropped`.
    """
    rows = []
    for sample in samples:
        row = crop_sample(sample, part, dropped, size, margin, correction)
        rows += [] if row is None else [row]
        if len(rows) == BATCH:
            yield _batch(rows)
            rows = []
    if rows:
        yield _batch(rows)


def crop_sample(sample, part, dropped, size, margin=1.0, correction="full"):
    """One sample cut out and turned into the crop's frame, {field of Batch: value}, or None if that is not possible."""
    seen = np.asarray(sample.visible, bool)
    if seen.sum() < FEWEST or not np.ptp(sample.joints2d[seen], axis=0).any():
        dropped[FEW if seen.sum() < FEWEST else SPANLESS] += 1
        return None
    image, mask = (_pixels(source) for source in (sample.image, sample.mask))
    height, width = image.shape[:2]
    camera = assumed_camera(width, height) if sample.camera is None else sample.camera
    toward = _pelvis(sample, part) if correction == "yaw" else None
    crop = person_crop(sample.joints2d[seen], camera, size, DEFAULT_MARGIN * margin, correction, toward)
    pixels = ((crop.points(sample.joints2d) + 1) * size - 1) / 2
    inside = seen & ((pixels >= -0.5) & (pixels < size - 0.5)).all(axis=1)
    poses = (
        np.full((len(PARTS[part].skeleton), 3), np.nan) if sample.joints3d is None else crop.targets(sample.joints3d)
    )
    return {
        "images": crop.image(image),
        "joints2d": np.where(inside[:, None], pixels, 0).astype(np.float32),
        "visible": inside,
        "joints3d": np.nan_to_num(poses).astype(np.float32),
        "labelled3d": bool(np.isfinite(poses).all()),
        "mask": None if mask is None else crop.image(mask),
        "tags": sample.tags,
    }


def assumed_camera(width, height):
    """K of an image that comes without calibration: a focal length of its longer side, about 53 degrees of view."""
    return camera_matrix(max(width, height), width, height)


def _pixels(source):
    if source is None or isinstance(source, np.ndarray):
        return source
    image = cv2.imread(str(source), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise CospeechError(f"{source}: not a readable image")
    return image


def _pelvis(sample, part):
    """Pixel between the hips, at which the official correction looks; None if they are not seen."""
    if part != "body":
        return None
    hips = [PARTS[part].heatmaps.index(name) for name in ("left_hip", "right_hip")]
    return sample.joints2d[hips].mean(axis=0) if sample.visible[hips].all() else None


def _batch(rows):
    """Rows of `crop_sample` -> Batch; a row without a mask has nothing that may be replaced."""
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    masks, tags = columns.pop("mask"), columns.pop("tags")
    whole = np.full(rows[0]["images"].shape[:2], 255, np.uint8)
    known = any(mask is not None for mask in masks)
    mask = np.stack([whole if mask is None else mask for mask in masks]) if known else None
    names = dict.fromkeys(name for tag in tags for name in tag)
    values = {name: np.array([tag.get(name, "") for tag in tags]) for name in names}
    return Batch(**{name: np.stack(column) for name, column in columns.items()}, mask=mask, tags=values)
