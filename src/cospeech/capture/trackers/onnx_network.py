"""The tracker `onnx`: any network that a manifest describes, through onnxruntime; `posenet` is three of our own."""

from itertools import islice
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.capture.trackers import codecs
from cospeech.capture.trackers.crops import (
    FACE_SIZE,
    around,
    box_of,
    crop_about,
    face_boxes,
    hand_boxes,
    landmark_boxes,
    like,
    whole_picture,
)
from cospeech.capture.trackers.manifest import Manifest, read_manifest
from cospeech.errors import CospeechError
from cospeech.files import sha256
from cospeech.skeleton import Skeleton
from cospeech.track import Camera, FaceCoefficients, Points

BATCH = 16  # crops in one run where the boxes are known beforehand
PASSES = 3  # looks at one picture where the first box is a guess
SEARCHED = 2  # pictures after which a part is searched for around: what is followed may be something else
LEAST_BOX = 0.03  # share of the picture's longer side; what follows a smaller body has lost it
SHOWN = 0.6  # share of a hand's or a face's points that lie in the picture where it is seen at all


class OnnxTracker:
    """One ONNX file and its manifest as a Tracker (`registry.Tracker`).

    A network that sees the body starts with the whole picture and then follows the box of its own points from frame to
    frame; hands and faces are looked for about the joints of a body, or the landmarks of a face, that an earlier
    tracker saw. threads: CPU threads of the network, all by default.
    """

    name = "onnx"

    def __init__(self, manifest, threads=None):
        self.manifest = manifest if isinstance(manifest, Manifest) else read_manifest(manifest)
        self.version = self.manifest.name
        self.parts = tuple(self.manifest.parts)
        self.model_sha256, self.licence_note = sha256(self.manifest.model), self.manifest.licence_note
        self.session = _session(self.manifest.model, threads)
        fixed = self.session.get_inputs()[0].shape[0]
        self.batch = fixed if isinstance(fixed, int) and fixed > 0 else BATCH

    def track(self, film, pictures, seen):
        """{part: Points or FaceCoefficients} of a `Film`; see `registry.Tracker`."""
        scale = film.width / film.size()[0]
        if "body" in self.parts:
            followed = list(self._follow(pictures))
            rows = {part: followed for part in self.parts}
        else:
            find = self._find_in_batches if self.manifest.codec["kind"] == "coefficients" else self._find
            rows = find(pictures, {part: _first_boxes(part, seen, film) / scale for part in self.parts})
        return {part: self._gathered(part, own, film, scale) for part, own in rows.items()}

    def _follow(self, pictures):
        """Yield what is seen in each picture, or None, where it was in the one before."""
        box = None
        for picture in pictures:
            height, width = picture.rgb.shape[:2]
            start = whole_picture(width, height) / [1, 1, self.manifest.margin, self.manifest.margin]
            fresh = box is None or picture.cut
            box = start if fresh else box
            for _ in range(PASSES if fresh else 1):
                (found,) = self._detect([box], [picture.rgb])
                inside = np.where(_within(found[0], width, height), found[2], 0)
                closer = box_of(found[0], inside, self.manifest.least)
                lost = closer is None or max(closer[2:]) < LEAST_BOX * max(width, height)
                if lost:
                    break
                box = closer
            box = None if lost else box
            yield None if lost else found

    def _find(self, pictures, boxes):
        """{part: [what is seen in each picture, or None]} about each part's boxes (F, 4), and where it was before."""
        rows, before = {part: [] for part in boxes}, {}
        for picture in pictures:
            before = {} if picture.cut else before
            for part, own in boxes.items():
                known = picture.index < len(own) and np.isfinite(own[picture.index]).all()
                found = self._searched(part, picture, own[picture.index], before.get(part)) if known else None
                before[part] = None if found is None else like(_box(found), own[picture.index])
                rows[part].append(found)
        return rows

    def _find_in_batches(self, pictures, boxes):
        """The same, in batches, for coefficients: they say neither where the face is nor how sure they are."""
        rows, pictures = {part: [] for part in boxes}, iter(pictures)
        while group := list(islice(pictures, self.batch)):
            for part, own in boxes.items():
                there = [p for p in group if p.index < len(own) and np.isfinite(own[p.index]).all()]
                found = self._detect([own[p.index] for p in there], [p.rgb for p in there]) if there else []
                detected = dict(zip((p.index for p in there), found, strict=True))
                rows[part] += [detected.get(p.index) for p in group]
        return rows

    def _searched(self, part, picture, expected, before):
        """What is seen of a part in a picture: of looks about the box `expected`, where it was `before` (or None), now
        and then around, and then twice more about what was seen, the surest."""

        def surest(*places):
            flipped = self.manifest.mirrored and part == "left_hand"
            return max(self._detect(places, [picture.rgb] * len(places), flipped), key=_sureness)

        best = surest(expected) if before is None else surest(expected, before)
        if picture.cut or picture.index % SEARCHED == 0:
            best = max(best, surest(*around(expected)), key=_sureness)
        for _ in range(PASSES - 1):
            best = max(best, surest(like(_box(best), expected)), key=_sureness)
        return best

    def _detect(self, boxes, images, flipped=False):
        """What the network finds about each of N boxes: N times (xy (K, 2) pixels of the picture, xyz, score (K,)); for
        a face's coefficients (expression (E,), rotation (3,), score (1,))."""
        crops = [crop_about(box, self.manifest.margin, self.manifest.size, flipped) for box in boxes]
        tensors = self._tensors([crop.cut(image) for crop, image in zip(crops, images, strict=True)])
        outputs = [self._run(tensors[i : i + self.batch]) for i in range(0, len(tensors), self.batch)]
        outputs = {key: np.concatenate([o[key] for o in outputs]) for key in outputs[0]}
        codec = self.manifest.codec | {"size": self.manifest.size}
        if codec["kind"] == "coefficients":
            expression, angles = codecs.coefficients(outputs, codec)
            turns = Rotation.from_euler("xyz", angles).as_rotvec()
            return [(e, turn, np.ones(1)) for e, turn in zip(expression, turns, strict=True)]
        if codec["kind"] == "pose":
            points, space, score = codecs.pose(outputs, codec)
            space = [_turned(xyz, crop, image) for xyz, crop, image in zip(space, crops, images, strict=True)]
        else:
            points, score = codecs.POINTS[codec["kind"]](outputs, codec)
            space = points[..., 2:] if points.shape[-1] == 3 else [None] * len(points)
        detections = zip(crops, points, space, score, strict=True)
        # s is copied: no batch is kept alive
        return [(crop.to_picture(xy[:, :2]), z, s.copy()) for crop, xy, z, s in detections]

    def _tensors(self, images):
        """(N, height, width, 3) uint8 RGB -> what the network takes."""
        m = self.manifest
        tensors = np.stack(images)[..., :: 1 if m.channels == "RGB" else -1].astype(np.float32) * np.float32(m.scale)
        tensors = (tensors - np.float32(m.mean)) / np.float32(m.std)
        return np.ascontiguousarray(tensors.transpose(0, 3, 1, 2) if m.layout == "NCHW" else tensors)

    def _run(self, tensors):
        """{output name, and its number: array} of at most a batch; one of fixed size is filled up."""
        count, inputs = len(tensors), self.session.get_inputs()[0]
        if isinstance(inputs.shape[0], int) and count < self.batch:
            tensors = np.concatenate([tensors, np.zeros((self.batch - count, *tensors.shape[1:]), np.float32)])
        try:
            values = self.session.run(None, {inputs.name: tensors})
        except Exception as error:  # onnxruntime's own exception classes have no common parent but Exception
            reason = " ".join(str(error).split())[:200]
            raise CospeechError(f"{self.manifest.model}: does not run as its manifest says ({reason})") from error
        names = [output.name for output in self.session.get_outputs()]
        return {key: v[:count] for i, v in enumerate(values) for key in (names[i], i)}

    def _gathered(self, part, rows, film, scale):
        """What was seen of one part in all frames, in pixels of the full picture."""
        m = self.manifest
        if part == "face":
            width = m.codec["expression"][1] - m.codec["expression"][0]
            empty = np.zeros(width, np.float32), np.zeros(3), np.zeros(1)
            columns = [np.stack(column) for column in zip(*(row or empty for row in rows), strict=True)]
            return FaceCoefficients(columns[0], columns[1].astype(np.float32), columns[2][:, 0], m.parts[part]["model"])
        skeleton, first = m.parts[part]["skeleton"], m.parts[part]["first"]
        points = Points.empty(skeleton, len(rows), **self._space(part))
        own = slice(first, first + len(Skeleton.load(skeleton)))
        for i, row in enumerate(rows):
            if row is None or row[2][own].mean() < m.least:
                continue
            if part != "body" and _within(row[0][own], *film.size()).mean() < SHOWN:
                continue  # networks are trained on hands that are there, and imagine one below the picture's edge
            points.observed[i], points.score[i], points.xy[i] = True, row[2][own], row[0][own] * scale
            if points.xyz is not None:
                points.xyz[i] = self._in_space(points.xy[i], row[1][own], film)
        return points

    def _space(self, part):
        """Attributes of a part's `Points`."""
        codec = self.manifest.codec
        if codec["kind"] == "pose":
            space = "wrist" if part.endswith("hand") else "root"
            return {"space": space, "root": codec["root"], "metric": True}
        return {"depth": bool(self.manifest.camera), "space": "camera", "metric": bool(self.manifest.camera)}

    def _in_space(self, xy, found, film):
        """(K, 3) metres: as found, or the pixels at their depth through the manifest's camera."""
        if found.shape[1] == 3:
            return found
        depth = found[:, :1] + self.manifest.camera["depth"]
        across = (xy - (film.width / 2, film.height / 2)) / self.manifest.camera["focal"] * depth
        return np.concatenate([across, depth], axis=1)


def posenet_trackers(folder, threads=None):
    """{part: Tracker} of our own networks under `folder` (results/posenet): body, and hands and face where trained."""
    folder = Path(folder)
    body = OnnxTracker(folder / "body" / "manifest.yaml", threads)
    trackers = [body]
    trackers += [
        OnnxTracker(m, threads) for part in ("hand", "face") if (m := folder / part / "manifest.yaml").is_file()
    ]
    for tracker in trackers:
        tracker.name = "posenet"
    return {part: tracker for tracker in trackers for part in tracker.parts}


def _sureness(found):
    return found[2].mean()


def _box(found):
    """(4,) the box of a look's points, but for those that it is much less sure of than of the others."""
    return box_of(found[0], found[2], min(0.5 * _sureness(found), np.sort(found[2])[-3]))


def _within(xy, width, height):
    """(K,) bool: the points in the picture. Networks learn from crops of what is seen; they imagine hidden legs too."""
    return ((xy >= -0.5) & (xy < (width - 0.5, height - 0.5))).all(axis=1)


def _first_boxes(part, seen, film):
    """(F, 4) where a part is looked for first, in pixels of the full picture."""
    if part.startswith("face") and "face_landmarks" in seen:
        return landmark_boxes(seen["face_landmarks"])
    if "body" not in seen:
        raise CospeechError(f"{film.path}: a tracker of {part} alone needs to know where the body is; add one for body")
    if part.startswith("face"):
        return face_boxes(seen["body"], *([] if part == "face" else [FACE_SIZE]))
    return hand_boxes(seen["body"], part.split("_")[0])


def _turned(xyz, crop, image):
    """A pose (K, 3) as the camera that looks along the ray to the crop's centre sees it -> the film's camera's axes."""
    height, width = image.shape[:2]
    camera = Camera.assumed(width, height)
    ray = np.array([(crop.centre[0] - camera.cx) / camera.fx, (crop.centre[1] - camera.cy) / camera.fy, 1.0])
    ray /= np.linalg.norm(ray)
    if crop.flipped:
        xyz = xyz * np.float32([-1, 1, 1])
    return Rotation.from_euler("YX", [np.arctan2(ray[0], ray[2]), -np.arcsin(ray[1])]).apply(xyz).astype(np.float32)


def _session(model, threads):
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads or 0
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own exception classes have no common parent but Exception
        raise CospeechError(f"{model}: not a readable ONNX network ({' '.join(str(error).split())[:200]})") from error
