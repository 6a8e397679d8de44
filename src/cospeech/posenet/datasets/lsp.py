"""Leeds Sports Pose (Johnson and Everingham 2010) and its extension (2011): `joints.mat` and `images/im0001.jpg`...

The two differ in every convention: LSP is (3, 14, N) and its third row is 1 where a joint is *hidden*; the extension is
(14, 3, N) and 1 where it is *visible* (and its position is not to be trusted where it is not).
"""

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.posenet.datasets.reading import NOBODY, NOWHERE, body2d, find, load_mat, read_image, seen
from cospeech.posenet.samples import Sample
from cospeech.skeleton import Skeleton

LSP14 = Skeleton.load("lsp14")
TRAINING = 1000  # of LSP's 2000 images, the first


def lsp(folder, dropped, subset="train", occluded=False):
    """Samples of LSP. subset : "train" (the first 1000), "test" or "all". occluded : hidden joints count as visible."""
    chosen = {"train": slice(0, TRAINING), "test": slice(TRAINING, None), "all": slice(None)}
    if subset not in chosen:
        raise CospeechError(f"subset {subset!r} is unknown; known: {', '.join(chosen)}")
    path, joints = _read(folder, 3, 14)
    points, flags = joints[:2].transpose(2, 1, 0), joints[2].T
    labelled = np.ones_like(flags, bool) if occluded else flags == 0
    yield from _samples(path, points, labelled, chosen[subset], "im{:04d}.jpg", dropped)


def lspet(folder, dropped):
    """Samples of LSP-extended, all of them for training."""
    path, joints = _read(folder, 14, 3)
    points, flags = joints[:, :2].transpose(2, 0, 1), joints[:, 2].T
    yield from _samples(path, points, flags == 1, slice(None), "im{:05d}.jpg", dropped)


def _read(folder, *shape):
    path = find(folder, "joints.mat")
    if path is None:
        raise CospeechError(f"{folder}: has no joints.mat; give the folder of LSP or LSP-extended as it is shipped")
    joints = load_mat(path, "joints")["joints"]
    joints = joints[..., None] if joints.ndim == 2 else joints  # of one image
    if joints.ndim != 3 or joints.shape[:2] != shape:
        found, twin = joints.shape, "lspet" if joints.shape[:2] == (14, 3) else "lsp"
        raise CospeechError(f"{path}: joints are {found}, expected ({shape[0]}, {shape[1]}, N); is it {twin}?")
    return path, joints.astype(float)


def _samples(path, points, labelled, chosen, pattern, dropped):
    images = path.parent / "images"
    count = len(list(images.glob("im*.jpg")))
    if count != len(points):
        notice(f"{path}: joints of {len(points)} images, and {count} images; those that have both are used")
    for i in range(len(points))[chosen]:
        if not labelled[i].any():
            dropped[NOBODY] += 1
            continue
        image = read_image(images / pattern.format(i + 1), dropped)
        if image is None:
            continue
        joints2d, visible = seen(body2d(points[i], LSP14), body2d(labelled[i][:, None], LSP14)[:, 0], image)
        if visible.any():
            yield Sample(image, joints2d, visible, tags={"image": pattern.format(i + 1)})
        else:
            dropped[NOWHERE] += 1
