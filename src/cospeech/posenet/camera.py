"""Cameras: pinhole, weak perspective, and the virtual camera that a crop stands for (Mehta et al. 2017).

Camera frames are x right, y down, z forward. A camera matrix K is (3, 3) in pixels; pixel (0, 0) is the centre of the
top left pixel. A network that sees a crop predicts as if the camera looked along the ray to the crop's centre; `Crop`
turns training targets into that virtual frame and predictions back.
"""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError

CORRECTIONS = ("none", "yaw", "full")
DEFAULT_MARGIN = 1.25  # side of the crop over the larger side of the joints' box (not published)


def camera_matrix(focal, width, height):
    """K (3, 3) of square pixels with its principal point at (width / 2, height / 2), as the official 3DHP scripts."""
    return np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])


def project(points, camera):
    """Pinhole projection: points (..., 3) in the camera frame, K (3, 3) -> (..., 2) pixels."""
    return from_homogeneous(np.asarray(points) @ np.asarray(camera).T)


def weak_perspective(points, camera):
    """Equation 3.2: points (..., J, 3), camera (..., 4) = alpha_x, alpha_y, c_x, c_y -> (..., J, 2).

    Takes numpy arrays and torch tensors alike; the network's projection layer is this function.
    """
    return points[..., :2] * camera[..., None, :2] + camera[..., None, 2:]


def fit_weak_perspective(points, image, visible=None):
    """The least-squares weak-perspective camera: points (J, 3), image (J, 2), visible (J,) -> (4,) as above.

    Raises CospeechError when fewer than two joints are visible or they share an x or y.
    """
    seen = np.ones(len(points), bool) if visible is None else np.asarray(visible, bool)
    p, q = np.asarray(points, np.float64)[seen, :2], np.asarray(image, np.float64)[seen]
    if len(p) < 2 or (np.ptp(p, axis=0) == 0).any():
        raise CospeechError(
            "fit_weak_perspective: the visible joints span no area; at least two that differ are needed"
        )
    p_mean, q_mean = p.mean(axis=0), q.mean(axis=0)
    alpha = ((p - p_mean) * (q - q_mean)).sum(axis=0) / ((p - p_mean) ** 2).sum(axis=0)
    return np.concatenate([alpha, q_mean - alpha * p_mean])


def virtual_rotation(center, camera, correction="full"):
    """Rotation R (..., 3, 3) of the virtual camera that looks at pixel `center` (..., 2): P_camera = R P_virtual.

    correction : "yaw" turns about the vertical axis alone, theta = atan((u - c_x) / f_x), as the official scripts;
        "full" turns about the vertical, then about the new horizontal axis, so that +z meets the ray exactly and x
        stays level; "none" is the identity.
    """
    if correction not in CORRECTIONS:
        raise CospeechError(f"perspective correction {correction!r} is unknown; known: {', '.join(CORRECTIONS)}")
    ray = rays(center, camera)
    yaw = np.arctan2(ray[..., 0], ray[..., 2]) if correction != "none" else np.zeros(ray.shape[:-1])
    pitch = np.arcsin(ray[..., 1]) if correction == "full" else np.zeros(ray.shape[:-1])
    (sin, cos), (down, level) = (np.sin(yaw), np.cos(yaw)), (np.sin(pitch), np.cos(pitch))
    zero = np.zeros_like(yaw)
    columns = [(cos, zero, -sin), (-sin * down, level, -cos * down), (sin * level, down, cos * level)]
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def rays(pixels, camera):
    """Unit vectors (..., 3) in the camera frame towards pixels (..., 2) of a camera K (3, 3)."""
    direction = to_homogeneous(pixels) @ np.linalg.inv(camera).T
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def to_homogeneous(pixels):
    """(..., 2) -> (..., 3) with a last coordinate of 1."""
    pixels = np.asarray(pixels, np.float64)
    return np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)


def from_homogeneous(points):
    """(..., 3) -> (..., 2), divided by the last coordinate."""
    return points[..., :2] / points[..., 2:]


def to_virtual(poses, rotation):
    """Camera frame -> virtual frame, for training targets: poses (..., J, 3), rotation (..., 3, 3) -> (..., J, 3)."""
    return np.asarray(poses) @ rotation


def from_virtual(poses, rotation):
    """Virtual frame -> camera frame, for predictions before they are scored; inverse of `to_virtual`."""
    return np.asarray(poses) @ np.swapaxes(rotation, -1, -2)


@dataclass(frozen=True)
class Crop:
    """A square cut-out of an image, and the virtual camera it stands for.

    size : side in pixels. to_image (3, 3) : homography from crop pixels to image pixels.
    rotation (3, 3) : from the virtual to the real camera's frame.
    """

    size: int
    to_image: np.ndarray
    rotation: np.ndarray

    def image(self, image):
        """Cut the crop out of an image (H, W, C) -> (size, size, C); what lies outside is black.

        An image that the crop shrinks is first averaged down by the whole factor, so that nothing aliases.
        """
        import cv2

        factor = max(1, int(self.scale))
        matrix = self.to_image
        if factor > 1:
            height, width = (max(1, round(side / factor)) for side in image.shape[:2])
            sx, sy = width / image.shape[1], height / image.shape[0]
            image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
            matrix = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]]) @ matrix
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpPerspective(image, matrix, (self.size, self.size), flags=flags)

    @property
    def scale(self):
        """How many image pixels one crop pixel covers, along one side, at the crop's centre: float."""
        middle = (self.size - 1) / 2
        corners = self.points_in_image(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) + middle)
        return np.sqrt(abs(np.linalg.det(corners[1:] - corners[0])))

    def points(self, pixels):
        """Image pixels (..., 2) -> the crop's coordinates (..., 2), -1 to 1 between the outer edges of its pixels."""
        crop = from_homogeneous(to_homogeneous(pixels) @ np.linalg.inv(self.to_image).T)
        return (2 * crop + 1) / self.size - 1

    def pixels(self, points):
        """The crop's coordinates (..., 2) -> image pixels (..., 2); inverse of `points`."""
        return self.points_in_image(((np.asarray(points) + 1) * self.size - 1) / 2)

    def points_in_image(self, crop_pixels):
        """Crop pixels (..., 2) -> image pixels (..., 2)."""
        return from_homogeneous(to_homogeneous(crop_pixels) @ self.to_image.T)

    def targets(self, poses):
        """Root-relative poses (..., J, 3) of the camera frame -> what the network should predict."""
        return to_virtual(poses, self.rotation)

    def poses(self, predicted):
        """What the network predicted (..., J, 3) -> root-relative poses of the camera frame."""
        return from_virtual(predicted, self.rotation)


def person_crop(joints, camera, size=256, margin=DEFAULT_MARGIN, correction="full", toward=None):
    """The crop around a person's visible 2D joints (thesis 3.4.1: a tight box from 2D).

    Parameters
    ----------
    joints : (K, 2) image pixels, the visible ones only.
    camera : K (3, 3) of the image; for images without calibration an assumed one (`camera_matrix`).
    correction : "none" and "yaw" cut an upright square out of the image; "yaw" is the official correction, which turns
        poses only. "full" makes the crop that the virtual camera would see (homography K R K_virtual^-1).
    toward : (2,) pixel the virtual camera looks at; the box's centre by default, the pelvis in the official scripts.

    Raises CospeechError when there is no joint or all of them coincide.
    """
    joints = np.asarray(joints, np.float64).reshape(-1, 2)
    if not len(joints) or not np.ptp(joints, axis=0).any():
        raise CospeechError("person_crop: the visible joints span no box; leave this person out")
    toward = (joints.min(axis=0) + joints.max(axis=0)) / 2 if toward is None else np.asarray(toward, np.float64)
    rotation = virtual_rotation(toward, camera, correction)
    to_image = np.eye(3)  # from the plane in which the square is upright: the image, or the virtual camera's plane
    if correction == "full":
        to_image = camera @ rotation
        joints = from_homogeneous(to_homogeneous(joints) @ np.linalg.inv(to_image).T)
    low, high = joints.min(axis=0), joints.max(axis=0)
    side = margin * (high - low).max()
    corner, scale = (low + high - side) / 2, side / size
    square = np.array([[scale, 0, corner[0] + scale / 2], [0, scale, corner[1] + scale / 2], [0, 0, 1]])
    return Crop(size, to_image @ square, rotation)
