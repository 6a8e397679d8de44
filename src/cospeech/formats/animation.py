"""An animation: a tree of joints with fixed offsets, local rotations and a moving root. What BVH and glTF hold."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass
class Animation:
    """T frames of J joints, parents before children.

    names (J,), parents (J,) int with -1 for the root, offsets (J, 3) metres in the parent's frame at rest,
    rotations (T, J, 4) local unit quaternions in scipy's order x y z w, translation (T, 3) metres of the root,
    fps; `local` (T, J, 3) replaces the offsets frame by frame for the rare files that animate them, else None.
    """

    names: tuple
    parents: np.ndarray
    offsets: np.ndarray
    rotations: np.ndarray
    translation: np.ndarray
    fps: float
    local: np.ndarray | None = None

    def __len__(self):
        return len(self.rotations)

    def forward_kinematics(self):
        """World positions (T, J, 3) metres and world rotations (T, J, 4) x y z w (thesis eq. 2.1, 2.2 and 2.3)."""
        frames, joints = self.rotations.shape[:2]
        positions, rotations = np.zeros((frames, joints, 3)), np.zeros((frames, joints, 4))
        for joint, parent in enumerate(self.parents):
            local = Rotation.from_quat(self.rotations[:, joint])
            if parent < 0:
                positions[:, joint], rotations[:, joint] = self.translation, local.as_quat()
                continue
            above = Rotation.from_quat(rotations[:, parent])
            offset = self.offsets[joint] if self.local is None else self.local[:, joint]
            positions[:, joint] = positions[:, parent] + above.apply(offset)
            rotations[:, joint] = (above * local).as_quat()
        return positions, rotations
