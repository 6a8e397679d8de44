"""Human3.6M (Ionescu et al. 2014): the owners' CDF files and films, or the npz files of mmpose.

    S1..S11/MyPoseFeatures/{D2_Positions, D3_Positions_mono}/<Action>[ n].<camera>.cdf   and   S*/Videos/<same>.mp4
    h36m_{train,test}.npz with imgname, part (n, 17, 2 | 3), S (n, 17, 3 | 4) in metres   and   images/<imgname>

Cameras are not shipped beside the poses: the intrinsic matrix is fitted to each recording's own 2D and 3D (lens
distortion leaves about a pixel).
"""

import csv
import re

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.posenet.datasets.reading import (
    NOWHERE,
    body2d,
    body3d,
    existing,
    find,
    frames,
    read_image,
    seen,
    skipping,
)
from cospeech.posenet.samples import Sample
from cospeech.skeleton import Skeleton

H36M32, H36M17 = Skeleton.load("h36m32"), Skeleton.load("h36m17")
SUBJECTS = {"train": (1, 5, 6, 7, 8), "test": (9, 11)}
ALIASES = {"TakingPhoto": "Photo", "WalkingDog": "WalkDog"}  # subjects are not named alike
UNIVERSAL = 920.0  # mm from left knee to hip, pelvis to spine and spine to neck: MPI-INF-3DHP's universal size
BEYOND = "annotation without a frame of the film"


def h36m(folder, dropped, subset="train", every=1, subjects=None, frame_list=None, scale="metric"):
    """Samples; tags `subject`, `action` (as Table 3.2 names it), `camera`, `frame` (from 0).

    every : n-th frame. frame_list : CSV of columns subject, action, camera, frame (H80K and the like), used instead.
    scale : "metric", or "universal" to train together with MPI-INF-3DHP.
    """
    if subset not in SUBJECTS or scale not in ("metric", "universal"):
        raise CospeechError("h36m: subset is train or test, and scale metric or universal")
    if every < 1:
        raise CospeechError(f"every is {every}; expected 1 for all frames, or more")
    listed = None if frame_list is None else read_frame_list(frame_list)
    places = [folder / f"S{subject}" for subject in subjects or SUBJECTS[subset]]
    recordings = [path for s in places for path in sorted((s / "MyPoseFeatures/D3_Positions_mono").glob("*.cdf"))]
    if recordings:
        for path in recordings:
            with skipping(dropped, "recording without readable poses or film"):
                yield from _recording(path, dropped, every, listed, scale)
        return
    archive = find(folder, f"h36m_{subset}.npz")
    if archive is None:
        raise CospeechError(
            f"{folder}: has neither S*/MyPoseFeatures/D3_Positions_mono/*.cdf of {subset} nor h36m_{subset}.npz"
        )
    yield from _archive(archive, folder, dropped, every, listed, scale)


# ---- CDF ------------------------------------------------------------------------------------------------------------


def _recording(path, dropped, every, listed, scale):
    joints3d = read_cdf(path, 96).reshape(-1, 32, 3)
    joints2d = read_cdf(path.parents[1] / "D2_Positions" / path.name, 64).reshape(-1, 32, 2)
    if len(joints2d) != len(joints3d):
        notice(f"{path}: {len(joints3d)} frames in 3D and {len(joints2d)} in 2D; those that have both are used")
    count = min(len(joints2d), len(joints3d))
    joints2d, joints3d = joints2d[:count], joints3d[:count]
    action, camera = path.stem.rsplit(".", 1)
    subject = path.parents[2].name
    key = (subject.removeprefix("S"), action_name(action, numbered=True), camera)
    numbers = np.arange(0, count, every) if listed is None else np.array(sorted(listed.get(key, ())), int)
    dropped[BEYOND] += int((numbers >= count).sum())
    numbers = numbers[numbers < count]
    if not len(numbers):
        return
    matrix = fit_camera(joints3d, joints2d)
    poses = body3d(joints3d, H36M32) * _factor(joints3d, H36M32, scale)
    tags = {"subject": subject, "action": action_name(action), "camera": camera}
    found = 0
    for i, image in zip(numbers, frames(path.parents[2] / "Videos" / f"{path.stem}.mp4", numbers), strict=False):
        found += 1
        points, visible = seen(body2d(joints2d[i], H36M32), np.ones(14, bool), image)
        if visible.any():
            yield Sample(image, points, visible, poses[i], matrix, None, tags | {"frame": str(i)})
        else:
            dropped[NOWHERE] += 1
    dropped[BEYOND] += len(numbers) - found


def read_cdf(path, width):
    """Variable `Pose` of an owners' CDF file -> (n, width) float64."""
    import cdflib

    try:
        with cdflib.CDF(existing(path)) as file:
            pose = np.asarray(file.varget("Pose"), float)
    except CospeechError:
        raise
    except Exception as error:  # cdflib raises whatever its parsing of damaged bytes runs into
        raise CospeechError(f"{path}: not a readable CDF file with a variable 'Pose' (truncated?)") from error
    if pose.shape[-1] != width:
        raise CospeechError(f"{path}: 'Pose' is {pose.shape}, expected (1, n, {width})")
    return pose.reshape(-1, width)


def action_name(action, numbered=False):
    """ "TakingPhoto 1" -> "Photo", or "Photo 1" if numbered."""
    word, _, number = action.replace("_", " ").partition(" ")
    word = ALIASES.get(word, word)
    return f"{word} {number}".strip() if numbered else word


def fit_camera(joints3d, joints2d):
    """K (3, 3) without skew that projects camera-frame points (..., 3) onto pixels (..., 2), by least squares."""
    points, pixels = joints3d.reshape(-1, 3), joints2d.reshape(-1, 2)
    usable = np.isfinite(points).all(axis=1) & np.isfinite(pixels).all(axis=1) & (points[:, 2] > 0)
    matrix = np.eye(3)
    for axis in (0, 1):
        ratio = points[usable, axis] / points[usable, 2]
        design = np.stack([ratio, np.ones_like(ratio)], axis=1)
        matrix[axis, axis], matrix[axis, 2] = np.linalg.lstsq(design, pixels[usable, axis], rcond=None)[0]
    return matrix


def _factor(poses, skeleton, scale):
    """What makes a recording (n, J, 3) metric (1) or of universal size."""
    if scale == "metric":
        return 1.0
    length = lambda a, b: np.linalg.norm(np.subtract(*(poses[:, skeleton.index[name]] for name in (a, b))), axis=-1)
    height = length("left_knee", "left_hip") + length("pelvis", "spine") + length("spine", "neck")
    return UNIVERSAL / np.median(height)


def read_frame_list(path):
    """CSV with columns subject, action, camera, frame (from 0) -> {(subject, action, camera): {frames}}."""
    listed = {}
    with existing(path).open(newline="") as file:
        rows = csv.DictReader(file)
        if missing := [c for c in ("subject", "action", "camera", "frame") if c not in (rows.fieldnames or ())]:
            raise CospeechError(f"{path}: has no column {missing[0]!r}; expected subject, action, camera, frame")
        for row in rows:
            if not (row["frame"] or "").strip().isdigit():
                raise CospeechError(
                    f"{path}: line {rows.line_num}: frame is {row['frame']!r}, expected a number from 0"
                )
            key = row["subject"].strip().removeprefix("S"), action_name(row["action"], True), row["camera"].strip()
            listed.setdefault(key, set()).add(int(row["frame"]))
    return listed


# ---- mmpose's npz ---------------------------------------------------------------------------------------------------

NAME = re.compile(r"S(\d+)_([A-Za-z]+)[_ ]?(\d*)\.(\d+)_(\d+)")  # S1_Directions_1.54138969_000001.jpg, from 1


def _archive(path, folder, dropped, every, listed, scale):
    """Hands and toes are not among its 17 joints: NaN in 3D."""
    names, part, poses = read_archive(path)
    images = next(place for place in (folder / "images", path.parent / "images", folder) if place.is_dir())
    found = [NAME.search(name) for name in names]
    if None in found:
        raise CospeechError(f"{path}: image {names[found.index(None)]!r} is not named S1_Action_1.camera_000001.jpg")
    keys = np.array([(m[1], action_name(f"{m[2]} {m[3]}".strip(), True), m[4]) for m in found])
    numbers = np.array([int(m[5]) - 1 for m in found])
    cameras = {c: fit_camera(poses[keys[:, 2] == c], part[keys[:, 2] == c]) for c in np.unique(keys[:, 2])}
    factors = {s: _factor(poses[keys[:, 0] == s], H36M17, scale) for s in np.unique(keys[:, 0])}
    for i, (subject, action, camera) in enumerate(keys.tolist()):
        wanted = numbers[i] % every == 0 if listed is None else numbers[i] in listed.get((subject, action, camera), ())
        image = read_image(images / names[i], dropped) if wanted else None
        if image is None:
            continue
        points, visible = seen(body2d(part[i], H36M17), np.ones(14, bool), image)
        tags = {"subject": f"S{subject}", "action": action_name(action), "camera": camera, "frame": str(numbers[i])}
        if visible.any():
            pose = body3d(poses[i], H36M17) * np.float32(factors[subject])
            yield Sample(image, points, visible, pose, cameras[camera], None, tags)
        else:
            dropped[NOWHERE] += 1


def read_archive(path):
    """(image names, pixels (n, 17, 2), camera-frame poses (n, 17, 3) mm) of mmpose's npz."""
    from zipfile import BadZipFile

    try:
        with np.load(existing(path), allow_pickle=False) as file:
            names, part, poses = file["imgname"], file["part"][..., :2], 1000.0 * file["S"][..., :3]  # metres there
    except (ValueError, KeyError, BadZipFile, OSError, EOFError) as error:
        raise CospeechError(
            f"{path}: not mmpose's npz of imgname, part and S (truncated, or pickled): {error}"
        ) from error
    if not len(names) == len(part) == len(poses) or part.shape[1:] != (17, 2) or poses.shape[1:] != (17, 3):
        raise CospeechError(
            f"{path}: {len(names)} images, part {part.shape}, S {poses.shape}; expected (n, 17, 2 and 3)"
        )
    return [str(name) for name in names], part.astype(float), poses.astype(float)
