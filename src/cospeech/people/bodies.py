"""A person as solids: trunk, limbs and clothes around given joints. Works on any joints, also on those of a film."""

from dataclasses import dataclass

import numpy as np

from cospeech.people.anthropometry import INDEX
from cospeech.people.heads import add_head, skull_center
from cospeech.people.painting.solids import Solids, unit
from cospeech.skeleton import LONG_FINGERS

TRUNK = 0.50  # metres from pelvis over spine to neck of the person that the sizes below describe


@dataclass
class Bodies:
    """N people in the camera's axes, metres.

    joints (N, 61, 3); head (N, 3, 3), columns left, up, forward; height (N,) of the head from chin to crown; skin
    (N, 97, 3) of the face (`faces.skin`) and its gaze (N, 2, 2); girth, female (N,).
    """

    joints: np.ndarray
    head: np.ndarray
    height: np.ndarray
    skin: np.ndarray
    gaze: np.ndarray
    girth: np.ndarray
    female: np.ndarray

    def joint(self, name):
        """(N, 3)."""
        return self.joints[:, INDEX[name]]


def body_solids(bodies, materials):
    """(N, P, raster.COLUMNS) the solids of `Bodies` in their `Materials`."""
    solids, j = Solids(len(bodies.joints)), bodies.joint
    scale = np.linalg.norm(j("spine") - j("pelvis"), axis=1) + np.linalg.norm(j("neck") - j("spine"), axis=1)
    scale = scale / TRUNK
    _trunk(solids, bodies, materials, scale)
    for side in ("right", "left"):
        _arm(solids, j, materials, scale * np.sqrt(bodies.girth), side)
        _hand(solids, j, materials, side)
        _leg(solids, j, materials, scale * bodies.girth, side)
    add_head(solids, bodies, materials)
    return solids.rows()


def _trunk(solids, bodies, materials, scale):
    j, girth = bodies.joint, bodies.girth * scale
    up = unit(j("neck") - j("pelvis"))
    hips, shoulders = j("left_hip") - j("right_hip"), j("left_shoulder") - j("right_shoulder")
    forward = unit(np.cross(unit(hips) + unit(shoulders), up))
    left = np.cross(up, forward)
    wide = np.linalg.norm(shoulders, axis=1) / 0.35
    flat = np.stack([left, up, 1.42 * forward], axis=1)
    cloth = {"color2": materials.top2, "pattern": materials.pattern, "period": materials.period}
    at = lambda start, rise: start + up * (rise * scale)[:, None]
    hip = np.where(bodies.female, 1.08, 1.0) * girth
    waist = np.where(bodies.female, 0.122, 0.138) * girth
    chest = 0.150 * wide * np.sqrt(bodies.girth)
    solids.cone(
        at(j("pelvis"), 0.0), at(j("pelvis"), 0.05), 0.140 * hip, 0.138 * hip, materials.bottom, "trunk", axes=flat
    )
    solids.cone(
        at(j("pelvis"), 0.085), at(j("spine"), 0.02), 0.142 * hip, waist, materials.top, "trunk", axes=flat, **cloth
    )
    solids.cone(at(j("spine"), 0.02), at(j("neck"), -0.185), waist, chest, materials.top, "trunk", axes=flat, **cloth)
    ribs = [at(j("neck"), -0.135) + left * (sign * 0.088 * chest / 0.15)[:, None] for sign in (-1, 1)]
    solids.cone(*ribs, 0.098 * chest / 0.15, 0.098 * chest / 0.15, materials.top, "trunk", axes=flat, **cloth)
    for side, sign in (("right", -1), ("left", 1)):
        inward = unit(shoulders) * (-sign * 0.020 * scale)[:, None]
        cap = j(f"{side}_shoulder") + inward + up * (0.002 * scale)[:, None]
        nape = at(j("neck"), -0.012) - forward * (0.012 * scale)[:, None]
        solids.cone(nape, cap, 0.048 * scale, 0.054 * scale, materials.top, "trunk")
        pit = cap + 2.2 * inward - up * (0.07 * scale)[:, None]
        solids.cone(pit, cap, 0.066 * scale, 0.054 * scale, materials.top, "trunk", **cloth)
        bust = at(j("neck"), -0.18) + forward * (0.038 * scale)[:, None] + left * (sign * 0.054 * scale)[:, None]
        soft = 0.072 * np.sqrt(girth * scale)
        solids.cone(bust, bust, np.where(bodies.female, soft, -1), 0, materials.top, "trunk", **cloth)
    knees = (j("right_knee") + j("left_knee")) / 2
    hangs = np.sum(unit(knees - j("pelvis")) * -up, axis=1) > 0.8
    skirt = np.where(materials.skirt & hangs, 0.155 * hip, -1)
    solids.cone(at(j("pelvis"), -0.04), knees, skirt, 0.2 * scale, materials.bottom, "trunk", axes=flat)
    skull = skull_center(j("head_top"), bodies.head, bodies.height)
    base = skull + np.einsum("nij,j->ni", bodies.head, [0.0, -0.26, -0.13]) * bodies.height[:, None]
    thick = np.where(bodies.female, 0.047, 0.055) * scale
    solids.cone(at(j("neck"), -0.03), base, thick, thick, materials.skin, "neck")


def _sleeve(solids, start, end, radii, reach, materials, color, part, **cloth):
    """Cloth over a limb, from its start as far as `reach` (N,), 0 to 1; less than 0.05 is no cloth."""
    reach = np.clip(reach, 0, 1)
    stop = start + (end - start) * reach[:, None]
    first = radii[0] * materials.loose
    second = (radii[0] + (radii[1] - radii[0]) * reach) * materials.loose
    solids.cone(start, stop, np.where(reach > 0.05, first, -1), second, color, part, **cloth)


def _arm(solids, j, materials, scale, side):
    shoulder, elbow, wrist = (j(f"{side}_{name}") for name in ("shoulder", "elbow", "wrist"))
    upper, fore = (0.049 * scale, 0.037 * scale), (0.037 * scale, 0.025 * scale)
    cloth = {"color2": materials.top2, "pattern": np.where(materials.pattern == 1, 1, 0), "period": materials.period}
    solids.cone(shoulder, elbow, *upper, materials.skin, f"{side}_upper_arm")
    solids.cone(elbow, wrist, *fore, materials.skin, f"{side}_forearm")
    bulge = elbow + (wrist - elbow) * 0.25
    solids.cone(bulge, bulge + (wrist - elbow) * 0.2, 0.041 * scale, 0.036 * scale, materials.skin, f"{side}_forearm")
    _sleeve(solids, shoulder, elbow, upper, materials.sleeves, materials, materials.top, f"{side}_upper_arm", **cloth)
    fore = (0.042 * scale, 0.029 * scale)
    _sleeve(solids, elbow, wrist, fore, materials.sleeves - 1, materials, materials.top, f"{side}_forearm", **cloth)


def _leg(solids, j, materials, scale, side):
    hip, knee, ankle, toe = (j(f"{side}_{name}") for name in ("hip", "knee", "ankle", "toe"))
    thigh, shank = (0.082 * scale, 0.053 * scale), (0.050 * scale, 0.034 * scale)
    solids.cone(hip, knee, *thigh, materials.skin, f"{side}_thigh")
    solids.cone(knee, ankle, *shank, materials.skin, f"{side}_shank")
    calf = knee + (ankle - knee) * 0.28
    solids.cone(knee, calf, 0.047 * scale, 0.050 * scale, materials.skin, f"{side}_shank")
    _sleeve(solids, hip, knee, thigh, materials.legs, materials, materials.bottom, f"{side}_thigh")
    shank = (0.056 * scale, 0.043 * scale)
    _sleeve(solids, knee, ankle, shank, materials.legs - 1, materials, materials.bottom, f"{side}_shank")
    down = unit(ankle - knee)
    sole = ankle + down * (0.025 * scale)[:, None]
    heel = sole - unit(toe - ankle) * (0.03 * scale)[:, None]
    tip = toe + unit(toe - sole) * (0.05 * scale)[:, None]
    solids.cone(sole, toe, 0.043 * scale, 0.037 * scale, materials.shoes, f"{side}_foot")
    solids.cone(heel, heel, 0.036 * scale, 0, materials.shoes, f"{side}_foot")
    solids.cone(toe, tip, 0.037 * scale, 0.026 * scale, materials.shoes, f"{side}_foot")


def _hand(solids, j, materials, side):
    """Palm, five fingers of three bones and their nails; the palm's side is paler than the back."""
    part, sign = f"{side}_hand", -1 if side == "right" else 1
    joint = lambda name: j(f"{side}_{name}")
    root, first = joint("hand_root"), {finger: joint(f"{finger}_0") for finger in (*LONG_FINGERS, "thumb")}
    scale = np.linalg.norm(first["middle"] - root, axis=1) / 0.088
    palm = sign * unit(np.cross(first["middle"] - root, first["index"] - first["little"]))
    inside = np.clip(materials.skin * [0.98, 0.82, 0.76] + [0.10, 0.10, 0.08], 0, 1)
    material = {"color2": inside, "plane": (palm, 0.0)}

    def bone(start, end, thick, thin):
        solids.cone(start, end, thick * scale, thin * scale, materials.skin, part, **material)

    for finger in LONG_FINGERS:
        bone(root, first[finger], 0.0155, 0.0118)
    for one, two in (("index", "middle"), ("middle", "ring"), ("ring", "little")):
        bone(first[one], first[two], 0.0112, 0.0112)
    for share in (0.4, 0.6, 0.8):
        bone(root + (first["index"] - root) * share, root + (first["little"] - root) * share, 0.0135, 0.0125)
    bone(root, first["thumb"], 0.0165, 0.0160)
    bone(first["thumb"], (root + 2 * first["index"]) / 3, 0.0140, 0.0110)
    for finger in (*LONG_FINGERS, "thumb"):
        size = {"thumb": 1.22, "little": 0.86}.get(finger, 1.0)
        joints = [joint(f"{finger}_{i}") for i in range(4)]
        radii = np.array([0.0105, 0.0092, 0.0081, 0.0068]) * size
        for i in range(3):
            bone(joints[i], joints[i + 1], radii[i], radii[i + 1])
        way, before = unit(joints[3] - joints[2]), unit(joints[2] - joints[1])
        back = before - 0.35 * palm
        back = unit(back - way * np.sum(back * way, axis=1, keepdims=True))
        nail = joints[3] - way * (0.002 * scale)[:, None] + back * (0.0042 * size * scale)[:, None]
        frame = np.stack([way, np.cross(back, way), back], axis=2)
        half = np.array([0.0070, 0.0054, 0.0038]) * size * scale[:, None]
        solids.ellipsoid(nail, frame, half, np.clip(materials.skin * 0.8 + [0.26, 0.20, 0.19], 0, 1), part)
