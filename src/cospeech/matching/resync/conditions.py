"""The control signals of a motion inside a network: differentiable, and part of its ONNX file.

The same numbers as `cospeech.matching.control.signals` gives, for what can be a condition of the resynchroniser.
"""

import torch
from torch import nn

from cospeech.errors import CospeechError
from cospeech.matching.control.signals import LEFT, RIGHT
from cospeech.skeleton import UPPER55

CONDITIONS = {
    "left_wrist_height": lambda left, right, fps: left[:, 1],
    "right_wrist_height": lambda left, right, fps: right[:, 1],
    "left_wrist_speed": lambda left, right, fps: _speed(left, fps),
    "right_wrist_speed": lambda left, right, fps: _speed(right, fps),
    "symmetry": lambda left, right, fps: (left[:, 1] - right[:, 1]).abs(),
    "hand_distance": lambda left, right, fps: _length(left - right),
    "reach": lambda left, right, fps: torch.maximum(_length(left[:, ::2]), _length(right[:, ::2])),
}


def check_conditions(names):
    """CospeechError that lists the known ones, unless every name is a signal that a network can be conditioned on."""
    for name in names:
        if name not in CONDITIONS:
            raise CospeechError(f"budget: resync.condition: {name!r} is not known; known: {', '.join(CONDITIONS)}")


class Conditions(nn.Module):
    """Parent-relative motion (B, 165, T) in metres -> the named signals (B, S, T), in their units."""

    def __init__(self, names, fps):
        super().__init__()
        check_conditions(names)
        self.names, self.fps = tuple(names), fps
        self.register_buffer("wrists", _sums())

    def forward(self, motion):
        points = torch.matmul(self.wrists, motion)
        left, right = points[:, :3], points[:, 3:]
        return torch.stack([CONDITIONS[name](left, right, self.fps) for name in self.names], dim=1)


def _sums():
    """(6, 165): what adds the offsets along the arms up to the pelvis, to both wrists' positions."""
    matrix = torch.zeros(6, 3 * len(UPPER55))
    for row, joint in ((0, LEFT), (3, RIGHT)):
        while joint >= 0:
            matrix[range(row, row + 3), range(3 * joint, 3 * joint + 3)] = 1.0
            joint = int(UPPER55.tree[joint])
    return matrix


def _length(vectors):
    return torch.linalg.vector_norm(vectors, dim=1)


def _speed(points, fps):
    moved = _length(points[..., 1:] - points[..., :-1]) * fps
    return torch.cat([moved[:, :1], moved], dim=1)
