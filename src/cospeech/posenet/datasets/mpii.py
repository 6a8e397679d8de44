"""MPII Human Pose (Andriluka et al. 2014): `mpii_human_pose_v1_u12_1.mat` as its owners ship it, or the usual JSON.

Pixels of both count from 1; they are made to count from 0 here. Persons of the owners' test images have no joints.
"""

import json

import numpy as np

from cospeech.errors import CospeechError
from cospeech.posenet.datasets.reading import NOBODY, NOWHERE, body2d, find, load_mat, read_image, seen
from cospeech.posenet.samples import Sample
from cospeech.skeleton import Skeleton

MPII16 = Skeleton.load("mpii16")
HIDDEN = "test image, whose joints its owners keep"


def mpii(folder, dropped, subset="train", occluded=False):
    """Samples, one a person. subset : "train", or "val" for the JSON of that name (the .mat has no such split).

    occluded : joints that are labelled and hidden count as visible (of the .mat, which alone tells).
    """
    matlab = find(folder, "mpii_human_pose_v1_u12_1.mat") if subset == "train" else None
    names = {"train": ("train.json", "mpii_train.json"), "val": ("valid.json", "val.json", "mpii_val.json")}
    if subset not in names:
        raise CospeechError(f"subset {subset!r} is unknown; known: {', '.join(names)}")
    path = matlab or find(folder, *names[subset])
    if path is None:
        raise CospeechError(f"{folder}: has neither mpii_human_pose_v1_u12_1.mat nor {names[subset][0]}")
    people = _of_matlab(path, occluded, dropped) if matlab else _of_json(path)
    images = next((place for place in (folder / "images", path.parent / "images") if place.is_dir()), folder)
    last, image = None, None
    for name, points, labelled in people:
        if not labelled.any():
            dropped[NOBODY] += 1
            continue
        if name != last:
            last, image = name, read_image(images / name, dropped)
        elif image is None:
            read_image(images / name, dropped)
        if image is None:
            continue
        joints2d, visible = seen(body2d(points - 1, MPII16), body2d(labelled[:, None], MPII16)[:, 0], image)
        if visible.any():
            yield Sample(image, joints2d, visible, tags={"image": name})
        else:
            dropped[NOWHERE] += 1


def _of_json(path):
    """(image, points (16, 2) from 1, labelled (16,)) of every person of a JSON file."""
    try:
        people = json.loads(path.read_text())
        for person in people:
            points = np.array(person["joints"], float).reshape(16, 2)
            labelled = (np.array(person["joints_vis"]).reshape(16) > 0) & (points > 0).any(axis=1)
            yield person["image"], points, labelled
    except (ValueError, KeyError, TypeError) as error:
        raise CospeechError(f"{path}: not MPII's JSON of image, joints and joints_vis (truncated?): {error}") from error


def _of_matlab(path, occluded, dropped):
    release = load_mat(path, "RELEASE")["RELEASE"]
    images, training = _list(getattr(release, "annolist", [])), np.atleast_1d(getattr(release, "img_train", []))
    if not images or len(images) != len(training):
        raise CospeechError(f"{path}: RELEASE has {len(images)} images in annolist and {len(training)} in img_train")
    for image, trained in zip(images, training, strict=True):
        if not trained:
            dropped[HIDDEN] += 1
            continue
        people = [person for person in _list(getattr(image, "annorect", [])) if _points(person)]
        if not people:
            dropped[NOBODY] += 1
        for person in people:
            points, labelled = np.zeros((16, 2)), np.zeros(16, bool)
            for point in _points(person):
                points[int(point.id)] = point.x, point.y
                labelled[int(point.id)] = occluded or _flag(getattr(point, "is_visible", 1))
            yield str(image.image.name), points, labelled


def _list(struct):
    """A struct array of MATLAB, which scipy gives as an array, as one struct, or as an empty array."""
    return (
        list(struct.ravel()) if isinstance(struct, np.ndarray) else [struct] if hasattr(struct, "_fieldnames") else []
    )


def _points(person):
    annotated = getattr(person, "annopoints", None)
    return _list(getattr(annotated, "point", [])) if hasattr(annotated, "_fieldnames") else []


def _flag(value):
    """is_visible is a number, a character or empty, which is how old entries say nothing: taken as visible."""
    return np.size(value) == 0 or str(np.ravel(value)[0]).strip() not in ("0", "0.0")
