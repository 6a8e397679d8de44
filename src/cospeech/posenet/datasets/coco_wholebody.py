"""COCO-WholeBody (Jin et al. 2020): hands and faces, 2D, of COCO's images.

    annotations/coco_wholebody_{train,val}_v1.0.json, and COCO's images in train2017/ and val2017/

The hand network knows right hands, so a left hand comes mirrored: image and joints.
"""

import json
from collections import Counter

import numpy as np

from cospeech.errors import CospeechError
from cospeech.posenet.datasets.parts import HAND21
from cospeech.posenet.datasets.reading import NOWHERE, find, read_image, seen
from cospeech.posenet.samples import Sample
from cospeech.skeleton import Skeleton

COCO_HAND21 = Skeleton.load("coco_wholebody_hand21")
TO_HAND21 = COCO_HAND21.joints(*HAND21.names)
PIECES = {"hand": {"right": "righthand", "left": "lefthand"}, "face": {"": "face"}}  # part: {side: prefix of its keys}
COUNTS = {"hand": 21, "face": 68}


def coco_wholebody(folder, dropped, part="hand", subset="train", minimum=32.0):
    """Samples, one a hand or face. part : "hand" or "face". subset : "train" or "val".

    minimum : side in pixels below which a hand or face is too small to learn from.
    """
    if part not in PIECES:
        raise CospeechError(f"coco_wholebody: part {part!r} is unknown; known: {', '.join(PIECES)}")
    if subset not in ("train", "val"):
        raise CospeechError(f"subset {subset!r} is unknown; known: train, val")
    path = find(folder, f"coco_wholebody_{subset}_v1.0.json", f"coco_wholebody_{subset}*.json")
    if path is None:
        raise CospeechError(f"{folder}: has no coco_wholebody_{subset}_v1.0.json, neither there nor in annotations/")
    files, annotations = _read(path)
    places = (folder / f"{subset}2017", folder / "images" / f"{subset}2017", folder / "images", folder)
    images = next(place for place in places if place.is_dir())
    last, image = None, None
    for annotation in annotations:
        for side, points, labelled in _pieces(path, annotation, part, minimum, dropped):
            name = files.get(annotation.get("image_id"))
            if name is None:
                dropped["annotation of an image that is not listed"] += 1
                continue
            if name != last or image is None:
                last, image = name, read_image(images / name, dropped)
            if image is not None:
                yield from _sample(image, points, labelled, side, name, dropped)


def _read(path):
    try:
        table = json.loads(path.read_text())
        files = {image["id"]: image["file_name"] for image in table["images"]}
        return files, sorted(table["annotations"], key=lambda annotation: annotation["image_id"])
    except (ValueError, KeyError, TypeError) as error:
        raise CospeechError(f"{path}: not COCO-WholeBody's JSON (truncated, or another format): {error}") from error


def _pieces(path, annotation, part, minimum, dropped):
    """Yield (side, points (K, 2), labelled (K,)) of the hands or the face of one person, in the part's joint order."""
    for side, prefix in PIECES[part].items():
        if not annotation.get(f"{prefix}_valid", False):
            dropped[f"person without a labelled {f'{side} {part}'.strip()}"] += 1
            continue
        try:
            keypoints = np.array(annotation[f"{prefix}_kpts"], float).reshape(COUNTS[part], 3)
        except (KeyError, ValueError, TypeError) as error:
            expected = f"{prefix}_kpts of {3 * COUNTS[part]} numbers"
            raise CospeechError(f"{path}: annotation {annotation.get('id')} has no {expected}") from error
        keypoints = keypoints[TO_HAND21] if part == "hand" else keypoints
        labelled = keypoints[:, 2] > 0
        if labelled.sum() < 2 or np.ptp(keypoints[labelled, :2], axis=0).max() < minimum:
            dropped[f"{part} smaller than {minimum:g} pixels"] += 1
            continue
        yield side, keypoints[:, :2], labelled


def _sample(image, points, labelled, side, name, dropped: Counter):
    if side == "left":
        image = np.ascontiguousarray(image[:, ::-1])
        points = np.stack([image.shape[1] - 1 - points[:, 0], points[:, 1]], axis=1)
    joints2d, visible = seen(points, labelled, image)
    if visible.any():
        yield Sample(image, joints2d, visible, tags={"image": name, "side": side} if side else {"image": name})
    else:
        dropped[NOWHERE] += 1
