"""What every data set of people gives: `Sample`s as their owners label them, `Batch`es as the network reads them.

Pixels: x right, y down, the centre of the first pixel is (0, 0). 3D: millimetres in the camera's axes (x right, y down,
z away), relative to the root joint. Joints stand in the order of the part's joint set (body: JOINTS21).
"""

from dataclasses import dataclass, field, fields

import numpy as np


@dataclass(frozen=True)
class Sample:
    """One person in one image.

    image : path, or (H, W, 3) uint8 RGB. joints2d (K, 2) float32 pixels, zeros where not labelled.
    visible (K,) bool: labelled in 2D, not marked as hidden (unless those were asked for) and inside the image.
    joints3d (J, 3) float32 millimetres, NaN for joints that the data set does not have; or None.
    camera (3, 3) float64 intrinsic matrix in pixels, or None. mask (H, W) uint8, 255 on the person, path, or None.
    tags {name: str}: activity, scene, subject, domain..., whatever the owners give.
    """

    image: object
    joints2d: np.ndarray
    visible: np.ndarray
    joints3d: np.ndarray | None = None
    camera: np.ndarray | None = None
    mask: object = None
    tags: dict = field(default_factory=dict)


@dataclass
class Batch:
    """N square crops of S pixels, each with one person.

    images (N, S, S, 3) uint8 RGB, None where labels alone are asked for.
    joints2d (N, K, 2) float32 pixels of the crop. visible (N, K) bool.
    joints3d (N, J, 3) float32 millimetres in the axes of the crop's own (virtual) camera; zeros where there are none.
    labelled3d (N,) bool: whether `joints3d` may be trained on, that is, has all J.
    mask (N, S, S) uint8, 255 on the person, or None.
    tags {name: (N,) array of str}.
    """

    images: np.ndarray
    joints2d: np.ndarray
    visible: np.ndarray
    joints3d: np.ndarray
    labelled3d: np.ndarray
    mask: np.ndarray | None = None
    tags: dict = field(default_factory=dict)

    def __len__(self):
        return len(self.visible)

    def __getitem__(self, chosen):
        """The samples at an index array or slice, as a Batch."""
        pick = lambda x: {k: v[chosen] for k, v in x.items()} if isinstance(x, dict) else x if x is None else x[chosen]
        return Batch(*(pick(getattr(self, f.name)) for f in fields(self)))
