"""MPI-INF-3DHP (Mehta et al. 2017) as its owners ship it: the training films and the test images.

    train   S1..S8/Seq1..2/{annot.mat, camera.calibration, imageSequence/video_0..13.avi[, FGmasks/, ChairMasks/]}
    test    TS1..TS6/{annot_data.mat, imageSequence/img_000001.jpg...}

`annot3` is metric; `univ_annot3` is the same pose at the universal size (920 mm from knee to neck), which the official
evaluation uses and which is the default here, for training too: a network trained on the one and tested on the other
is wrong by the ratio of the sizes.
"""

import re

import h5py
import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.posenet import JOINTS17, JOINTS28
from cospeech.posenet.camera import camera_matrix
from cospeech.posenet.datasets.reading import (
    NOWHERE,
    body2d,
    body3d,
    existing,
    frames,
    load_mat,
    read_image,
    seen,
    skipping,
)
from cospeech.posenet.evaluation.pose_metrics import SCENES
from cospeech.posenet.samples import Sample

SCALES = {"universal": "univ_annot3", "metric": "annot3"}
CAMERAS = (0, 1, 2, 4, 5, 6, 7, 8)  # the authors' subset
FRAMES = {
    (1, 1): 6416,
    (1, 2): 12430,
    (2, 1): 6502,
    (2, 2): 6081,
    (3, 1): 12488,
    (3, 2): 12283,
    (4, 1): 6171,
    (4, 2): 6675,
    (5, 1): 12820,
    (5, 2): 12312,
    (6, 1): 6188,
    (6, 2): 6145,
    (7, 1): 6239,
    (7, 2): 6320,
    (8, 1): 6468,
    (8, 2): 6054,
}  # of (subject, sequence), as the owners' scripts list them; the annotation has rows beyond
NO_GREEN_SCREEN = {(1, 2), (4, 2)}  # whose background masks the owners tell not to use
BEYOND = "annotation without a frame of the film"
FOCAL = {1: 1499.2 / 2048, 5: 1684.0 / 1920}  # of TS1 to TS4 and of TS5 and TS6, in widths of the image


def train(folder, dropped, every=1, subjects=range(1, 9), cameras=CAMERAS, scale="universal", masks=True):
    """Samples of the training films.

    every : n-th frame (a few sequences have 50 frames a second, the others 25). scale : "universal" or "metric".
    masks : read the green-screen masks where they are shipped and good.
    """
    _check(scale, every)
    sequences = [(s, q) for s in subjects for q in (1, 2) if (folder / f"S{s}" / f"Seq{q}").is_dir()]
    if not sequences:
        raise CospeechError(f"{folder}: has no S1/Seq1 to S8/Seq2; give the folder of MPI-INF-3DHP's training films")
    for subject, sequence in sequences:
        with skipping(dropped, "sequence without readable annotation"):
            yield from _sequence(folder, dropped, subject, sequence, every, cameras, scale, masks)


def _check(scale, every):
    if scale not in SCALES:
        raise CospeechError(f"scale {scale!r} is unknown; known: {', '.join(SCALES)}")
    if every < 1:
        raise CospeechError(f"every is {every}; expected 1 for all frames, or more")


def _sequence(folder, dropped, subject, sequence, every, cameras, scale, masks):
    place = folder / f"S{subject}" / f"Seq{sequence}"
    annotation = read_annotation(place / "annot.mat", SCALES[scale])
    calibration = read_calibration(place / "camera.calibration")
    masks = masks and (subject, sequence) not in NO_GREEN_SCREEN
    for camera in cameras:
        with skipping(dropped, "camera without annotation, calibration or film"):
            if camera not in annotation or camera not in calibration:
                raise CospeechError(f"{place}: camera {camera} is not in annot.mat and camera.calibration")
            numbers, joints2d, joints3d = annotation[camera]
            chosen = np.flatnonzero((numbers < FRAMES[subject, sequence]) & (numbers % every == 0))
            tags = {"subject": f"S{subject}", "sequence": f"S{subject}/Seq{sequence}", "camera": str(camera)}
            arrays = numbers[chosen], joints2d[chosen], joints3d[chosen]
            yield from _film(place, camera, *arrays, calibration[camera], masks, tags, dropped)


def _film(place, camera, numbers, joints2d, joints3d, matrix, masks, tags, dropped):
    name = f"video_{camera}.avi"
    found = 0
    masks = _masks(place, name, numbers) if masks else iter(())
    for i, image in enumerate(frames(place / "imageSequence" / name, numbers)):
        found += 1
        points, visible = seen(body2d(joints2d[i], JOINTS28), np.ones(14, bool), image)
        mask = next(masks, None)
        if not visible.any():
            dropped[NOWHERE] += 1
            continue
        pose = body3d(joints3d[i], JOINTS28) if np.isfinite(joints3d[i]).all() else None
        yield Sample(image, points, visible, pose, matrix, mask, tags | {"frame": str(numbers[i])})
    if found < len(numbers):
        dropped[BEYOND] += len(numbers) - found


def _masks(place, name, numbers):
    """Yield (H, W) uint8 masks of the person and what it sits on, for as long as both films of masks last.

    255 in the red channel of FGmasks is what is not green screen; 0 in that of ChairMasks is the chair.
    """
    films = [place / kind / name for kind in ("FGmasks", "ChairMasks")]
    if not films[0].is_file():
        return
    chairs = frames(films[1], numbers) if films[1].is_file() else iter(())
    for person in frames(films[0], numbers):
        chair = next(chairs, None)
        yield person[..., 0] if chair is None else np.maximum(person[..., 0], 255 - chair[..., 0])


def read_annotation(path, poses="univ_annot3"):
    """annot.mat -> {camera: (frame numbers (n,) from 0, joints2d (n, 28, 2), joints3d (n, 28, 3) mm)}.

    The camera frame is x right, y down, z forward. Where the arrays of a camera differ in length the shortest counts.
    """
    found = load_mat(path, "annot2", poses, "cameras")
    numbering = np.atleast_1d(found["cameras"]).astype(int).ravel()
    cells = {name: np.atleast_1d(found[name]) for name in ("annot2", poses)}
    if any(len(cell) != len(numbering) for cell in cells.values()) or numbering.tolist() != list(range(len(numbering))):
        raise CospeechError(f"{path}: 'cameras' is {numbering.tolist()}, expected 0, 1, 2... with a cell for each")
    result = {}
    for camera in numbering:
        arrays = [np.atleast_2d(cells[name][camera]) for name in ("annot2", poses)]
        if [a.shape[-1] for a in arrays] != [56, 84]:
            raise CospeechError(
                f"{path}: camera {camera} has rows of {[a.shape[-1] for a in arrays]}, expected 56 and 84"
            )
        numbers = np.atleast_1d(found.get("frames", np.arange(max(map(len, arrays))))).astype(int).ravel()
        count = min(len(numbers), *map(len, arrays))
        if count < max(map(len, arrays)):
            lengths = ", ".join(str(len(a)) for a in arrays)
            notice(f"{path}: camera {camera} has {lengths} rows and {len(numbers)} frames; the first {count} are used")
        joints2d, joints3d = arrays[0][:count].reshape(count, 28, 2), arrays[1][:count].reshape(count, 28, 3)
        result[int(camera)] = numbers[:count] - numbers[0], joints2d.astype(float), joints3d.astype(float)
    return result


def read_calibration(path):
    """camera.calibration -> {camera: K (3, 3) float64}. Parsed by its keys: lines may move, columns differ in width."""
    try:
        text = existing(path).read_text()
    except UnicodeDecodeError as error:
        raise CospeechError(f"{path}: not the text file that its owners ship") from error
    cameras = {}
    for block in re.split(r"^\s*name\s+", text, flags=re.MULTILINE)[1:]:
        intrinsic = re.search(r"^\s*intrinsic\s+(.+)$", block, flags=re.MULTILINE)
        try:
            matrix = np.array([float(number) for number in intrinsic[1].split()]).reshape(4, 4)
            cameras[int(block.split()[0])] = matrix[:3, :3]
        except (TypeError, ValueError) as error:
            raise CospeechError(f"{path}: camera {block.split()[:1]} has no intrinsic matrix of 16 numbers") from error
    if not cameras:
        raise CospeechError(f"{path}: no camera in it")
    return cameras


# ---- test set -------------------------------------------------------------------------------------------------------


def test(folder, dropped, every=1, scale="universal", sequences=range(1, 7)):
    """Samples of the valid test frames; tags `sequence` 1 to 6, `activity` 1 to 7 (as the metrics count) and `scene`.

    Hands and toes are not labelled: NaN in 3D. The focal length is the published one, the principal point the middle.
    """
    _check(scale, every)
    there = [s for s in sequences if (folder / f"TS{s}").is_dir()]
    if not there:
        raise CospeechError(f"{folder}: has no TS1 to TS6; give the folder of MPI-INF-3DHP's test set")
    if absent := [f"TS{s}" for s in sequences if s not in there]:
        notice(f"{folder}: {', '.join(absent)} not there; the other test sequences are used")
    for sequence in there:
        with skipping(dropped, "sequence without readable annotation"):
            yield from _test_sequence(folder / f"TS{sequence}", dropped, sequence, every, SCALES[scale])


def _test_sequence(place, dropped, sequence, every, poses):
    joints2d, joints3d, valid, activity = read_test_annotation(place / "annot_data.mat", poses)
    files = sorted((place / "imageSequence").glob("img_*.jpg"))
    last = max((int(path.stem.removeprefix("img_")) for path in files), default=0)
    if last != len(valid):
        notice(f"{place}: {last} images and {len(valid)} annotated frames; frames that have both are used")
    dropped["frame that its owners call invalid"] += int((~valid).sum())
    for i in np.flatnonzero(valid)[::every]:
        image = read_image(place / "imageSequence" / f"img_{i + 1:06d}.jpg", dropped)  # images count from 1
        if image is None:
            continue
        points, visible = seen(body2d(joints2d[i], JOINTS17), np.ones(14, bool), image)
        if not visible.any():
            dropped[NOWHERE] += 1
            continue
        height, width = image.shape[:2]
        matrix = camera_matrix(FOCAL[1 if sequence < 5 else 5] * width, width, height)
        tags = {
            "subject": f"TS{sequence}",
            "sequence": str(sequence),
            "scene": SCENES[sequence - 1],
            "activity": str(activity[i]),
            "frame": str(i + 1),
        }
        yield Sample(image, points, visible, body3d(joints3d[i], JOINTS17), matrix, None, tags)


def read_test_annotation(path, poses="univ_annot3"):
    """annot_data.mat (MATLAB v7.3) -> joints2d (n, 17, 2), joints3d (n, 17, 3) mm, valid (n,) bool, activity (n,)."""
    activity = "activity_annotation"
    try:
        with h5py.File(existing(path)) as file:
            activity = activity if activity in file else "activity_annnotation"  # as the owners' README spells it
            names = ("annot2", poses, "valid_frame", activity)
            if missing := [name for name in names if name not in file]:
                raise CospeechError(f"{path}: has no variable {missing[0]!r}")
            arrays = [np.asarray(file[name][:]) for name in names]
    except OSError as error:
        raise CospeechError(f"{path}: not a readable MATLAB v7.3 file (truncated, or another format)") from error
    if arrays[0].shape[-2:] != (17, 2) or arrays[1].shape[-2:] != (17, 3):
        shapes = f"{arrays[0].shape} and {arrays[1].shape}"
        raise CospeechError(f"{path}: annot2 and {poses} are {shapes}, expected (n, 1, 17, 2) and (n, 1, 17, 3)")
    arrays = [arrays[0].reshape(-1, 17, 2), arrays[1].reshape(-1, 17, 3), arrays[2].ravel() > 0, arrays[3].ravel()]
    count = min(map(len, arrays))
    if count < max(map(len, arrays)):
        notice(f"{path}: arrays of {', '.join(str(len(a)) for a in arrays)} frames; the first {count} are used")
    joints2d, joints3d, valid, activity = (a[:count] for a in arrays)
    return joints2d, joints3d, valid, activity.astype(int)
