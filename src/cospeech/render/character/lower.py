"""The lower body that clips do not have: a base pose, standing or sitting, that hangs on the clip's own hips."""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.render.character.mesh import grid_triangles, rings, unit

POSTURES = ("standing", "sitting", "none")
SHOE, STOOL, FLOOR = (70, 66, 64), (170, 190, 206), (255, 252, 250)
THIGH, SHIN = 0.42, 0.42  # metres, of a character whose trunk is 0.5 m
# Where the ankle stands, seen from the usual place of its hip (x outwards), and where the knee points.
STANCES = {
    "standing": (np.array([0.035, -0.82, -0.01]), np.array([0.10, 0.0, 1.0])),
    "sitting": (np.array([0.060, -0.42, 0.34]), np.array([0.12, 0.8, 1.0])),
}
SOLE, AROUND = 0.086, 40  # metres from ankle to floor; corners of what is round


def check_posture(posture):
    """CospeechError for a posture that is none of POSTURES."""
    if posture not in POSTURES:
        raise CospeechError(f"lower body {posture!r}; expected {', '.join(POSTURES[:-1])} or {POSTURES[-1]}")


def ankles(joints, scale, posture):
    """{side: (3,)}: where the feet stay, below or before the usual places of the hips."""
    place, _ = STANCES[posture]
    return {
        side: np.median(joints[f"{side}_hip"].astype(float), 0) + place * np.array([sign, 1, 1]) * scale
        for side, sign in (("left", 1), ("right", -1))
    }


def legs(joints, scale, posture, feet):
    """{left_knee, left_ankle, left_toe, right_...: (T, 3)}: feet that stay, and knees that follow the hips.

    Two-bone inverse kinematics in closed form; a hip farther off than the leg is long stretches the shin. feet as from
    `ankles`.
    """
    _, pole = STANCES[posture]
    found = {}
    for side, sign in (("left", 1), ("right", -1)):
        outwards = np.array([sign, 1, 1])
        hip = joints[f"{side}_hip"].astype(float)
        ankle = np.broadcast_to(feet[side], hip.shape)
        thigh, shin = THIGH * scale, SHIN * scale
        reach = np.linalg.norm(ankle - hip, axis=-1, keepdims=True)
        length = np.clip(reach, 0.3 * scale, 0.999 * (thigh + shin))
        axis = unit(ankle - hip)
        along = (thigh**2 - shin**2 + length**2) / (2 * length)
        aim = pole * outwards - axis * (axis @ (pole * outwards))[:, None]
        knee = hip + axis * along + unit(aim) * np.sqrt(np.maximum(thigh**2 - along**2, 0))
        found |= {
            f"{side}_knee": knee,
            f"{side}_ankle": ankle,
            f"{side}_toe": ankle + np.array([0.04 * sign, -0.045, 0.15]) * scale,
        }
    return found


def props(feet, scale, posture):
    """[(points (V, 3) metres, triangles, colour)] of what stands still: a floor, and a stool to sit on."""
    floor = np.mean([place[1] for place in feet.values()]) / scale - SOLE
    ahead = 0.04 if posture == "standing" else 0.16
    found = [([[floor - 0.012, 0.02], [floor - 0.012, 0.46], [floor, 0.46], [floor, 0.0]], ahead, FLOOR)]
    if posture == "sitting":
        profile = [
            [floor, 0.14],
            [floor + 0.02, 0.13],
            [floor + 0.03, 0.03],
            [-0.19, 0.03],
            [-0.185, 0.18],
            [-0.15, 0.19],
            [-0.12, 0.18],
            [-0.118, 0.0],
        ]
        found.append((profile, 0.0, STOOL))
    return [(*_turned(np.array(profile), forward, scale), color) for profile, forward, color in found]


def _turned(profile, forward, scale):
    """Points and triangles of a body of revolution: rows of height and radius, in the character's units."""
    centers = np.zeros((1, len(profile), 3))
    centers[..., 1], centers[..., 2] = profile[:, 0] * scale, forward * scale
    ways = (np.broadcast_to(np.eye(3)[axis], centers.shape) for axis in (0, 2))
    points, _ = rings(centers, *ways, profile[:, 1] * scale, profile[:, 1] * scale, AROUND, power=2.0)
    return points[0], grid_triangles(len(profile), AROUND)
