"""3D pose from images through onnxruntime, without torch: `PosePredictor`.

predictor = PosePredictor("results/posenet/body/model.onnx")
people = predictor.predict_images([image], boxes)      # where they were in the frame before
boxes = box_of(people.joints2d)                        # for the next frame
"""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError
from cospeech.learning.weights import OnnxNetwork
from cospeech.posenet.camera import DEFAULT_MARGIN, camera_matrix, person_crop

AT_ONCE = 64  # crops in one run of the network, which bounds its memory


@dataclass
class Poses:
    """What N images show, in the order of `PosePredictor.joints`.

    joints2d (N, J, 2) : pixels of the image. joints3d (N, J, 3) : mm from the root joint, x right, y down, z away.
    score (N, J) : confidence, the maxima of the heatmaps (thesis 4.3), about 0 to 1; a joint without a map takes that
        of the joints next to it. float32 all.
    """

    joints2d: np.ndarray
    joints3d: np.ndarray
    score: np.ndarray


class PosePredictor:
    """A network of `export_posenet`, ready to use.

    joints : J names. parents : J indices, -1 for the root. size : side of a crop. part, description, licence_note : of
    the file. threads : CPU threads, all by default.
    """

    def __init__(self, onnx, threads=None):
        self.network = OnnxNetwork(onnx, threads)
        self.description = self.network.description
        if self.description.get("model") != "posenet":
            raise CospeechError(f"{onnx}: not a pose network of cospeech; see `cospeech posenet predict --help`")
        design = self.description["design"]
        self.part, self.licence_note = self.description["part"], self.description["licence_note"]
        self.joints, self.parents, self.size = tuple(design["joints"]), tuple(design["parents"]), design["input"]
        self.root = self.joints.index(design["root"])
        self._spread = _nearest(self.parents, [self.joints.index(name) for name in design["heatmaps"]])

    def predict(self, crops):
        """Crops (N, S, S, 3) uint8 RGB -> Poses in the crops' own pixels and virtual cameras."""
        if len(crops) == 0:
            return Poses(*(np.zeros((0, len(self.joints), *rest), np.float32) for rest in ((2,), (3,), ())))
        pieces = []
        for start in range(0, len(crops), AT_ONCE):
            images = np.moveaxis(crops[start : start + AT_ONCE], 3, 1).astype(np.float32) / 255
            pieces.append(self.network(images=images))
        pose, points, heatmaps = (np.concatenate(piece) for piece in zip(*pieces, strict=True))
        return Poses(((points + 1) * self.size - 1) / 2, pose, heatmaps.max(axis=(2, 3)) @ self._spread.T)

    def predict_images(self, images, boxes=None, cameras=None, *, margin=DEFAULT_MARGIN, mirrored=None):
        """One person in each of N images.

        Parameters
        ----------
        images : N arrays (H, W, 3) uint8 RGB, of any sizes.
        boxes : (N, 4) left, top, right, bottom of the joints, in pixels. Without, the whole image is looked at first,
            and then the box of what was found in it.
        cameras : N matrices K (3, 3); an assumed one each (`assumed_camera`) without. Poses come back in its axes,
            turned from those of the virtual camera that looks at the box (perspective correction).
        margin : side of the crop over the larger side of the box.
        mirrored : (N,) bool, images to look at in a mirror: left hands, as the hand network knows right ones only.
        """
        if boxes is None:
            whole = np.array([[0, 0, image.shape[1] - 1, image.shape[0] - 1] for image in images], np.float64)
            first = self.predict_images(images, whole.reshape(-1, 4), cameras, margin=1.0, mirrored=mirrored)
            boxes = box_of(first.joints2d)
        if cameras is None:
            cameras = [assumed_camera(image.shape[1], image.shape[0]) for image in images]
        flips = np.zeros(len(images), bool) if mirrored is None else np.asarray(mirrored, bool)
        corners = np.asarray(boxes, np.float64).reshape(-1, 4)[:, [[0, 1], [2, 1], [0, 3], [2, 3]]]
        cuts = [person_crop(c, camera, self.size, margin) for c, camera in zip(corners, cameras, strict=True)]
        crops = np.empty((len(cuts), self.size, self.size, 3), np.uint8)
        for crop, cut, image, flip in zip(crops, cuts, images, flips, strict=True):
            crop[:] = cut.image(image)[:, ::-1] if flip else cut.image(image)
        return self._in_images(self.predict(crops), cuts, flips)

    def _in_images(self, found, cuts, flips):
        """Poses of crops -> of the images that they were cut out of."""
        for i, cut in enumerate(cuts):
            pixels, pose = found.joints2d[i], found.joints3d[i]
            if flips[i]:
                pixels[:, 0] = self.size - 1 - pixels[:, 0]
                pose[:, 0] *= -1
            found.joints2d[i] = cut.points_in_image(pixels)
            found.joints3d[i] = cut.poses(pose)
        return found


def box_of(joints2d):
    """Left, top, right, bottom of joints: (..., J, 2) -> (..., 4); the box for the next frame."""
    return np.concatenate([joints2d.min(axis=-2), joints2d.max(axis=-2)], axis=-1)


def assumed_camera(width, height):
    """K (3, 3) for an image of which nothing is known: a focal length of its larger side, 53 degrees across."""
    return camera_matrix(max(width, height), width, height)


def _nearest(parents, mapped):
    """(J, K): each joint's share of each heatmap, equal among those with the fewest bones in between."""
    count = len(parents)
    bones = np.full((count, count), count)
    np.fill_diagonal(bones, 0)
    for child, parent in enumerate(parents):
        if parent >= 0:
            bones[child, parent] = bones[parent, child] = 1
    for via in range(count):  # Floyd and Warshall
        bones = np.minimum(bones, bones[:, via, None] + bones[None, via])
    near = bones[:, mapped] == bones[:, mapped].min(axis=1, keepdims=True)
    return (near / near.sum(axis=1, keepdims=True)).astype(np.float32)
