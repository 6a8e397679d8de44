"""Where the camera stands: people in its axes, the square crop around a part of them, and where the picture ends."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.posenet.camera import DEFAULT_MARGIN, from_homogeneous, virtual_rotation

FLIP = np.diag([1.0, -1.0, -1.0])  # a person's axes (left, up, forward) as a camera in front of them sees them
FRAMINGS = ("full", "upper")
OPEN = 1e6  # a border of the picture that is nowhere near


@dataclass
class View:
    """N virtual cameras, each looking at its crop (see `posenet.camera.Crop`).

    rotation (N, 3, 3), translation (N, 3): p_camera = rotation p_person + translation, metres. camera (N, 3, 3): K of
    the crop. borders (N, 4): left, top, right and bottom end of the picture in pixels of the crop.
    """

    rotation: np.ndarray
    translation: np.ndarray
    camera: np.ndarray
    borders: np.ndarray

    def see(self, points):
        """Points (N, ..., 3) of the person's axes -> the camera's axes."""
        shape = points.shape
        moved = points.reshape(len(points), -1, 3) @ self.rotation.transpose(0, 2, 1) + self.translation[:, None]
        return moved.reshape(shape)

    def project(self, points):
        """Points (N, J, 3) of the camera's axes -> pixels (N, J, 2)."""
        return from_homogeneous(points @ self.camera.transpose(0, 2, 1))

    def inside(self, pixels, size):
        """(N, J) bool: within the picture and the crop."""
        low = np.maximum(self.borders[:, None, :2], -0.5)
        high = np.minimum(self.borders[:, None, 2:], size - 0.5)
        return ((pixels >= low) & (pixels < high)).all(axis=2)


def draw_directions(dice, part, domain):
    """Where the camera is: turn of the person, height and roll of the camera, degrees (N, 3)."""
    spread = {"body": 16, "hand": 38, "face": 20}[part]
    # a right hand is better seen from the person's right
    most = 45 if part == "body" else 70
    yaw = np.clip(dice.normal(22 if part == "hand" else 0, spread), -most, most)
    pitch = dice.normal(4, 4) if part == "body" else dice.normal(0, 11)
    roll = 1.5 if domain == "studio" else 2.5 if part == "body" else 4
    return np.stack([yaw, pitch, dice.normal(0, roll)], axis=1)


def look_at(directions, distance, target):
    """Rotation (N, 3, 3) and translation (N, 3) of cameras at `distance` (N,) metres from `target` (N, 3)."""
    yaw, pitch, roll = directions.T
    person = Rotation.from_euler("Y", yaw[:, None], degrees=True).as_matrix()
    tilt = Rotation.from_euler("XZ", np.stack([pitch, roll], axis=1), degrees=True).as_matrix()
    rotation = FLIP @ tilt @ person
    in_front = np.stack([0 * distance, 0 * distance, distance], axis=1)
    return rotation, in_front - np.einsum("nij,nj->ni", rotation, target)


def crop_view(rotation, translation, points, size, margin, anchors, labelled):
    """The `View` of the square crop around points (N, J, 3), person's axes, as `person_crop(correction="full")` cuts.

    anchors (N, 4, 2): for each border of the picture the index of a joint of `points` and by how many times the box's
    larger side it lies beyond that joint's pixel (negative: it cuts into the person); OPEN for no border.
    labelled : indices of the joints that the crop is made around, those with 2D labels.
    """
    seen = points @ rotation.transpose(0, 2, 1) + translation[:, None]
    low, high, _ = _box(from_homogeneous(seen), anchors, labelled)
    turn = virtual_rotation((low + high) / 2, np.eye(3))
    seen = seen @ turn
    low, high, borders = _box(from_homogeneous(seen), anchors, labelled)
    whole = np.ptp(from_homogeneous(seen), axis=1).max(axis=1)
    side = DEFAULT_MARGIN * margin * np.maximum((high - low).max(axis=1), 0.2 * whole)
    scale = side / size
    corner = (low + high - side[:, None]) / 2
    camera = np.tile(np.eye(3), (len(points), 1, 1))
    camera[:, 0, 0] = camera[:, 1, 1] = 1 / scale
    camera[:, :2, 2] = -corner / scale[:, None] - 0.5
    edges = (borders - np.tile(corner, 2)) / scale[:, None] - 0.5
    back = turn.transpose(0, 2, 1)
    return View(back @ rotation, np.einsum("nij,nj->ni", back, translation), camera, edges)


def _box(pixels, anchors, labelled):
    """Low and high corner (N, 2) of the labelled joints within the borders, and the borders (N, 4), on one plane."""
    extent = np.ptp(pixels, axis=1).max(axis=1)
    rows = np.arange(len(pixels))
    borders = np.empty((len(pixels), 4))
    for edge, (axis, sign) in enumerate(((0, -1), (1, -1), (0, 1), (1, 1))):
        at = pixels[rows, anchors[:, edge, 0].astype(int), axis]
        borders[:, edge] = at + sign * anchors[:, edge, 1] * extent
    pixels = pixels[:, labelled]
    inside = ((pixels > borders[:, None, :2]) & (pixels < borders[:, None, 2:])).all(axis=2)[..., None]
    low = np.where(inside, pixels, np.inf).min(axis=1)
    return low, np.where(inside, pixels, -np.inf).max(axis=1), borders


def draw_anchors(dice, part, domain, framing, names):
    """Borders of the picture for `crop_view`. framing (N,) index into FRAMINGS; names: of the points, in order."""
    anchors = np.zeros((len(dice), 4, 2))
    anchors[:, :, 1] = OPEN
    if part != "body":
        return anchors
    anchors[:, 3, 0] = names.index("spine")
    cut = dice.uniform(0.05, 0.26)  # where presenters end: from the navel to the thighs
    anchors[:, 3, 1] = np.where(framing == 1, cut, anchors[:, 3, 1])
    side, cuts = dice.choice([1, 1]), dice.chance(0.06 if domain == "wild" else 0.0)
    for edge, which in ((0, 0), (2, 1)):
        anchors[:, edge, 0] = names.index("neck")
        beyond = dice.uniform(0.06, 0.16)
        anchors[:, edge, 1] = np.where(cuts & (side == which), beyond, anchors[:, edge, 1])
    return anchors
