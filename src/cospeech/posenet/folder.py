"""`cospeech posenet predict`: the pose in every image of a folder, as pictures, a table and HDF5."""

from pathlib import Path

import cv2
import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.files import put, writing, writing_hdf5
from cospeech.formats.result_table import write_table
from cospeech.posenet.camera import camera_matrix
from cospeech.posenet.draw import draw_pose
from cospeech.posenet.predict import PosePredictor

SCHEMA = "cospeech.posenet.poses"
SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
AT_ONCE = 16  # images in memory


def predict_folder(source, onnx, out, *, box=None, focal=None, threads=None):
    """Find the person in an image, or in each image of a folder; write what was found into the folder `out`.

    Writes <image>.png (2D and 3D drawn), poses.csv (a line a joint) and poses.h5. An image that does not decode gets a
    notice and is left out. Returns (used, left out).

    box : left, top, right, bottom of the person's joints in pixels, in every image; looked for without. focal : pixels;
        assumed to be an image's larger side without.
    """
    paths, out = image_paths(source), Path(out)
    predictor = PosePredictor(onnx, threads)
    names, found, dropped = [], [], 0
    for start in range(0, len(paths), AT_ONCE):
        images = {path: image for path in paths[start : start + AT_ONCE] if (image := read_image(path)) is not None}
        dropped += len(paths[start : start + AT_ONCE]) - len(images)
        if not images:
            continue
        shown = list(images.values())
        cameras = None if focal is None else [camera_matrix(focal, i.shape[1], i.shape[0]) for i in shown]
        poses = predictor.predict_images(shown, None if box is None else [box] * len(shown), cameras)
        for i, (path, image) in enumerate(images.items()):
            picture = draw_pose(image, poses.joints2d[i], poses.joints3d[i], predictor.joints, predictor.parents)
            write_image(out / f"{path.name}.png", picture)
        names += [path.name for path in images]
        found.append((poses.joints2d, poses.joints3d, poses.score))
    if not names:
        raise CospeechError(f"{source}: no image in it decodes")
    write_poses(out, names, [np.concatenate(arrays) for arrays in zip(*found, strict=True)], predictor)
    return len(names), dropped


def image_paths(source):
    """The image, or the images of a folder in order of their names; CospeechError when there is none."""
    source = Path(source)
    if source.is_file():
        return [source]
    if not source.is_dir():
        raise CospeechError(f"{source}: no such file or folder")
    paths = sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES)
    if not paths:
        raise CospeechError(f"{source}: no image in it; known: {', '.join(SUFFIXES)}")
    return paths


def read_image(path):
    """(H, W, 3) uint8 RGB, or None after a notice when the file does not decode."""
    data = np.fromfile(path, np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB) if len(data) else None
    if image is None:
        notice(f"{path}: does not decode as an image; left out")
    return image


def write_image(path, image):
    """Write (H, W, 3) uint8 RGB as a file of the path's type."""
    with writing(path) as temporary:
        temporary.write_bytes(cv2.imencode(path.suffix, image[..., ::-1])[1].tobytes())


def write_poses(out, names, arrays, predictor):
    """poses.csv and poses.h5: names of N images; joints2d (N, J, 2), joints3d (N, J, 3) and score (N, J)."""
    joints2d, joints3d, score = arrays
    lines = (
        [name, joint, *(f"{v:.2f}" for v in (*pixels[j], *pose[j])), f"{confidence[j]:.3f}"]
        for name, pixels, pose, confidence in zip(names, joints2d, joints3d, score, strict=True)
        for j, joint in enumerate(predictor.joints)
    )
    write_table(out / "poses.csv", ["image", "joint", "x [px]", "y [px]", "x [mm]", "y [mm]", "z [mm]", "score"], lines)
    facts = {"part": predictor.part, "licence_note": predictor.licence_note, "axes": "x right, y down, z away"}
    with writing_hdf5(out / "poses.h5", SCHEMA, unit="mm", root=predictor.joints[predictor.root], **facts) as file:
        file["image"], file["joint"] = ([name.encode() for name in column] for column in (names, predictor.joints))
        for name, array in {"joints2d": joints2d, "joints3d": joints3d, "score": score}.items():
            put(file, name, array)
