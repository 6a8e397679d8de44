"""The tracker `tracks`: what another program saw, read from its files. Arrays only: nothing is ever unpickled."""

import json
import re
from pathlib import Path

import numpy as np

from cospeech.capture.trackers.smplx import smplx_parts
from cospeech.errors import CospeechError, notice
from cospeech.files import load_arrays
from cospeech.formats.smplx_motion import is_smplx
from cospeech.skeleton import UPPER55, Skeleton
from cospeech.track import FaceCoefficients, Points, Track

HAND = "coco_wholebody_hand21"
OPENPOSE = {  # part: (key of the JSON file, skeleton)
    "body": ("pose_keypoints_2d", "openpose25"),
    "left_hand": ("hand_left_keypoints_2d", HAND),
    "right_hand": ("hand_right_keypoints_2d", HAND),
    "face_landmarks": ("face_keypoints_2d", "openpose_face70"),
}
PUBLISHED_RATE = 15.0  # Hz, of the published 2D key points and of the published 3D annotation
MOST_FRAMES = 2_000_000  # 18 hours at 30 Hz; greater numbers in names are dates and the like
# Ginosar et al.'s 49 key points: neck, arms, then each hand's root and 20 points of its fingers, the left hand first
ARMS49 = ("neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist")
LEFT49, RIGHT49 = slice(7, 28), slice(28, 49)
DROPPED52 = [7, 8, 9]  # columns of the 52-point files that the 49 lack
SPLIT137 = {"body": (0, 25), "face_landmarks": (25, 95), "left_hand": (95, 116), "right_hand": (116, 137)}


class PrecomputedTracker:
    """Files of another program as a Tracker (`registry.Tracker`): frames are matched to the film's by their times.

    path: a track file of ours; a folder of OpenPose's *_keypoints.json, or of the published key points' .txt; an .npz
    of the published key points or of SMPL-X parameters. body_model: a SMPL-X model file (.npz) for the latter.
    """

    name, version, model_sha256 = "tracks", "", ""

    def __init__(self, path, body_model=None):
        self.path, self.body_model = Path(path), body_model
        if not self.path.exists():
            raise CospeechError(f"{path}: no such file or folder")
        self._own = Track.read(self.path) if self.path.suffix == ".h5" else None
        kept = self._own.parts if self._own else OPENPOSE
        self.parts = (*kept, *(["face"] if self._own and self._own.face else []))
        self.licence_note = self._own.licence_note if self._own else f"as of {self.path.name}"

    def track(self, film, pictures, seen):
        """{part: Points} at the film's frames; see `registry.Tracker`. Pictures are looked at for shots only."""
        count = sum(1 for _ in pictures)
        times = film.start + np.arange(count) / film.fps
        if self._own is not None:
            parts, frames = self._own.parts | {"face": self._own.face}, (times - self._own.start) * self._own.fps
            return _at(parts, np.round(frames).astype(int))
        parts, rate = read_parts(self.path, film, self.body_model)
        if rate is None:  # OpenPose's folder holds the whole film, a file a picture
            return _at(parts, _nearest(film.picture_times(), times))
        # the published formats and SMPL-X files hold the take alone
        return _at(parts, np.round((times - film.start) * rate).astype(int))


def read_parts(path, film=None, body_model=None):
    """({part: Points}, frames per second or None for the film's own) of files that are no track of ours."""
    path = Path(path)
    if path.is_dir():
        if files := sorted(path.glob("*_keypoints.json")):
            return _openpose(files), None
        if files := sorted(path.glob("*.txt")):
            tables = np.stack([_text(file) for file in files])
            numbered = all(file.stem.isdecimal() for file in files)
            return _spread(_points49(tables), _since_first(files) if numbered else None), PUBLISHED_RATE
        raise CospeechError(f"{path}: neither *_keypoints.json (OpenPose) nor *.txt (published key points) in it")
    arrays = load_arrays(path)
    if is_smplx(arrays):
        return smplx_parts(arrays, path, body_model)
    pose = arrays.get("pose")
    if pose is not None and pose.ndim == 3 and pose.shape[1:] == (3, 137):
        return _points137(pose), PUBLISHED_RATE
    if pose is not None and pose.ndim == 3 and pose.shape[1] == 2 and pose.shape[2] in (49, 52):
        return _points49(pose), PUBLISHED_RATE
    shapes = ", ".join(f"{key} {array.shape}" for key, array in arrays.items())
    raise CospeechError(f"{path}: none of the formats of docs/capture.md (it holds {shapes or 'nothing'})")


def read_release(path, number=None):
    """Tracks of the published 3D annotation, one a clip: <speaker>/<part>_<speaker>_data.npz.

    body (n, T, 165): metres, three rows of 55; face (n, T, 257), of which expression and rotation are kept. Hands may
    be absolute or relative to their wrists: what is found is said in a notice. `number` reads one clip alone.
    """
    arrays = load_arrays(path)
    if "body" not in arrays or arrays["body"].ndim != 3 or arrays["body"].shape[2] != 165:
        raise CospeechError(f"{path}: no array 'body' (n, T, 165); expected the published 3D annotation")
    chosen = range(len(arrays["body"])) if number is None else [number]
    if chosen and max(chosen) >= len(arrays["body"]):
        raise CospeechError(f"{path}: no clip {number}; it has {len(arrays['body'])}")
    return [_release_track(arrays, k, path) for k in chosen]


def _release_track(arrays, k, path):
    joints = arrays["body"][k].reshape(-1, 3, 55).swapaxes(1, 2).astype(np.float32)
    parts = {"body": _in_space("upper13", joints[:, :13], "root", "pelvis")}
    for side in ("right", "left"):
        root, wrist = UPPER55.joints(f"{side}_hand_root", f"{side}_wrist")
        hand = joints[:, root : root + 21]
        apart = float(np.median(np.linalg.norm(hand[:, 0] - joints[:, wrist], axis=1)))
        if apart > 1e-3 and np.abs(hand[:, 0]).max() > 1e-3:
            raise CospeechError(f"{path}: clip {k}: the {side} hand's root is neither the wrist nor zero")
        if side == "right":
            notice(f"{path}: hands are {'absolute' if apart <= 1e-3 else 'relative to their wrists'}")
        parts[f"{side}_hand"] = _in_space("hand21", _by_name(hand - hand[:, :1], side), "wrist", "hand_root")
    face = None
    if "face" in arrays:
        values = arrays["face"][k].astype(np.float32)
        face = FaceCoefficients(values[:, 166:230], values[:, 163:166], np.ones(len(values), np.float32), "release64")
    return Track(
        PUBLISHED_RATE,
        len(joints),
        1,
        1,
        **parts,
        face=face,
        source=f"{Path(path).name}:{k}",
        backend="release",
        licence_note="published 3D annotation (Habibie et al. 2021): research only",
    )


def _by_name(hand, side):
    """A hand (T, 21, 3) in the order of upper55 -> in that of skeleton hand21, by name."""
    names = [n.removeprefix(f"{side}_") for n in UPPER55.names[UPPER55.joints(f"{side}_hand_root")[0] :][:21]]
    return hand[:, [names.index(name) for name in Skeleton.load("hand21").names]]


def _in_space(skeleton, xyz, space, root):
    count = xyz.shape[:2]
    observed = np.ones(count[0], bool)
    return Points(
        skeleton,
        np.zeros((*count, 2), np.float32),
        np.ones(count, np.float32),
        observed,
        np.ascontiguousarray(xyz),
        space,
        root,
        metric=True,
    )


def _nearest(sorted_times, times):
    """(F,) index of the one of `sorted_times` (N,) that is nearest to each of `times` (F,)."""
    return np.searchsorted((sorted_times[1:] + sorted_times[:-1]) / 2, times, side="right")


def _spread(parts, numbers):
    """The parts with frame i at frame numbers[i]; what lies between was not seen."""
    if numbers is None or np.array_equal(numbers, np.arange(len(numbers))):
        return parts
    place = np.full(numbers.max() + 1, -1)
    place[numbers] = np.arange(len(numbers))
    return _at(parts, place)


def _since_first(files):
    numbers = np.array([int(file.stem) for file in files])
    return _checked_numbers(files, numbers - numbers.min())


def _checked_numbers(files, numbers):
    """`numbers` (F,) of the files' frames; None, with a notice, if they are too large to be frames; CospeechError for
    two that are alike."""
    order = np.argsort(numbers, kind="stable")
    if len(twice := np.flatnonzero(np.diff(numbers[order]) == 0)):
        first, second = (files[order[twice[0] + i]].name for i in (0, 1))
        raise CospeechError(f"{files[0].parent}: {first} and {second} are both of frame {numbers[order[twice[0]]]}")
    if numbers.max() > MOST_FRAMES:
        notice(
            f"{files[0].parent}: the numbers in its files' names are no frames' ({files[-1].name}); files are counted"
        )
        return None
    return numbers


def _at(parts, frame):
    """The parts at these frames (F,) of theirs; not observed before the first and after the last."""
    found = {}
    for part, points in parts.items():
        if points is None:
            continue
        inside = (frame >= 0) & (frame < len(points.score))
        kept = np.clip(frame, 0, len(points.score) - 1)
        taken = {k: v[kept].copy() if isinstance(v, np.ndarray) else v for k, v in vars(points).items()}
        for array in taken.values():
            if isinstance(array, np.ndarray):
                array[~inside] = 0
        found[part] = type(points)(**taken)
    return found


def _openpose(files):
    """{part: Points} of OpenPose's files, each of the frame whose number its name has. Of several people the largest is
    taken; a frame without a file, or without people, is not observed."""
    people = [_largest(file, _people(file)) for file in files]
    parts = {}
    for part, (key, skeleton) in OPENPOSE.items():
        count = len(Skeleton.load(skeleton))
        rows = [_numbers(file, person, key, count) for file, person in zip(files, people, strict=True)]
        parts[part] = _flat(skeleton, np.stack(rows))
    return _spread(parts, _frame_numbers(files))


def _frame_numbers(files):
    """(F,) the number before "_keypoints" in each name, or None where a name has none. OpenPose writes 12 digits, from
    0, for a film; pictures of one's own may be numbered from 1."""
    texts = [re.search(r"(\d+)\D*$", file.name.removesuffix("_keypoints.json")) for file in files]
    if not all(texts):
        return None
    numbers = np.array([int(text[1][-18:]) for text in texts])
    if numbers.min() == 1 and any(len(text[1]) != 12 for text in texts):
        notice(
            f"{files[0].parent}: its files are numbered from 1; {files[0].name} is taken as the film's first picture"
        )
        numbers = numbers - 1
    return _checked_numbers(files, numbers)


def _people(file):
    """The people of one file: dicts; none where the list is null or absent."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise CospeechError(f"{file}: not a key point file of OpenPose") from error
    people = content.get("people") or [] if isinstance(content, dict) else None
    if not isinstance(people, list) or not all(isinstance(person, dict | None) for person in people):
        raise CospeechError(f"{file}: not a key point file of OpenPose (people: a list of objects)")
    return [person for person in people if person]


def _numbers(file, person, key, count):
    """(count, 3) x, y and score of one part of a person; zero where it is null, empty or absent."""
    try:
        row = np.array(person.get(key) or np.zeros(3 * count), np.float64)
    except (TypeError, ValueError) as error:
        raise CospeechError(f"{file}: {key} holds something else than numbers") from error
    if row.shape != (3 * count,):
        raise CospeechError(f"{file}: {key} does not hold {count} points of x, y and score")
    return row.reshape(count, 3)


def _largest(file, people):
    key, skeleton = OPENPOSE["body"]

    def height(person):
        points = np.nan_to_num(_numbers(file, person, key, len(Skeleton.load(skeleton))))
        seen = points[points[:, 2] > 0.1]
        return np.ptp(seen[:, 1]) if len(seen) else 0.0

    return max(people, key=height, default={})


def _flat(skeleton, points):
    """Points in the picture alone: (T, K, 3) of x, y, score; a point at (0, 0) with score 0 was not seen."""
    score = np.clip(np.nan_to_num(points[..., 2]), 0, 1).astype(np.float32)
    xy = np.where(score[..., None] > 0, np.nan_to_num(points[..., :2]), 0).astype(np.float32)
    return Points(skeleton, xy, score, score.max(axis=1) > 0, space="crop")


def _text(file):
    try:
        values = np.loadtxt(file, ndmin=2)
    except (OSError, ValueError) as error:
        raise CospeechError(f"{file}: not a table of numbers") from error
    if values.shape not in ((2, 49), (2, 52)):
        raise CospeechError(f"{file}: {values.shape[0]} rows of {values.shape[1]} numbers; expected 2 of 49 or 52")
    return np.delete(values, DROPPED52, axis=1) if values.shape[1] == 52 else values


def _points49(pose):
    """{part: Points} of (T, 2, 49 | 52). No confidences are published: every point counts as seen."""
    if pose.shape[2] == 52:
        pose = np.delete(pose, DROPPED52, axis=2)
    xy = pose.swapaxes(1, 2).astype(np.float32)
    points = np.concatenate([xy, np.ones((*xy.shape[:2], 1), np.float32)], axis=2)
    table = Skeleton.load("openpose25")
    body = np.zeros((len(points), len(table), 3), np.float32)
    body[:, table.joints(*ARMS49)] = points[:, : len(ARMS49)]
    return {
        "body": _flat("openpose25", body),
        "left_hand": _flat(HAND, points[:, LEFT49]),
        "right_hand": _flat(HAND, points[:, RIGHT49]),
    }


def _points137(pose):
    """{part: Points} of (T, 3, 137): BODY_25, 70 of the face, 21 of each hand, with scores."""
    points = pose.swapaxes(1, 2).astype(np.float32)
    return {part: _flat(OPENPOSE[part][1], points[:, first:last]) for part, (first, last) in SPLIT137.items()}
