"""Stores of stick people for tests: one coloured line a bone, so that a small network learns them in seconds."""

import cv2
import numpy as np

from cospeech.posenet.datasets.parts import PARTS
from cospeech.posenet.samples import Batch
from cospeech.posenet.store import write_store

BACKGROUND = {"studio": 40, "wild": 110}


def stick_people(count, domain, part="body", size=64, seed=0, spread=0.35):
    """A Batch of people whose joints move independently about one pose; 3D truth is kept in both domains."""
    rng = np.random.default_rng([seed, list(BACKGROUND).index(domain)])
    skeleton, names = PARTS[part].skeleton, PARTS[part].heatmaps
    usual = np.random.default_rng(5).normal(0, 0.22, (len(skeleton), 3))
    pose = usual + rng.normal(0, 0.22 * spread, (count, len(skeleton), 3))
    pose -= pose[:, skeleton.root, None]
    points = (pose[..., :2] / 1.6 + 0.5) * size
    images = np.full((count, size, size, 3), BACKGROUND[domain], np.uint8)
    for image, joints in zip(images, points, strict=True):
        for child, parent in enumerate(skeleton.parents):
            if parent >= 0:
                ends = [tuple(int(v) for v in joints[j]) for j in (child, parent)]
                cv2.line(image, *ends, ((40 * child) % 256, 255 - 9 * child % 256, (97 * child) % 256), 2)
    seen = points[:, skeleton.joints(*names)].astype(np.float32)
    visible = ((seen >= 0) & (seen < size - 1)).all(axis=2)
    tags = {name: np.full(count, value) for name, value in {"domain": domain, "subject": f"{domain}0"}.items()}
    millimetres = (1000 * pose).astype(np.float32)
    return Batch(images, seen, visible, millimetres, np.full(count, domain == "studio"), None, tags)


def write_stick_people(path, studio, wild, **options):
    """A store of so many of each domain; returns its path."""
    domains = {"studio": studio, "wild": wild}
    batches = (stick_people(count, domain, **options) for domain, count in domains.items() if count)
    write_store(path, batches, part=options.get("part", "body"), source="stick people", licence_note="none")
    return path
