"""The character: 55 joints, a head rotation and a face become a shaded body, as a mesh posed for many frames."""

from dataclasses import dataclass

import numba
import numpy as np

from cospeech.face.model import embedded
from cospeech.render.character.head import HEIGHT, Head
from cospeech.render.character.lower import SHOE, ankles, check_posture, legs, props
from cospeech.render.character.mesh import capsule_template, capsules, grid_triangles, rings, unit, vertex_normals
from cospeech.render.character.triangles import Camera
from cospeech.skeleton import ACROSS, UPPER55

# Colours in OpenCV's order blue, green, red. The character's right is warm, its left is cool, the trunk neutral.
SKIN, NECK, SHIRT, TROUSERS = (168, 190, 226), (152, 173, 208), (112, 98, 88), (92, 80, 72)
RIGHT_SLEEVE, RIGHT_HAND = (70, 128, 222), (138, 184, 240)
LEFT_SLEEVE, LEFT_HAND = (190, 130, 58), (224, 190, 140)
BACKGROUND = (244, 242, 240)
# Shares of the picture's height: kept free above the head, faded out at the bottom, kept free below the floor.
TITLE, FADE, SUBTITLE = 0.10, 0.13, 0.09

LIGHT = unit(np.float32([0.45, 0.75, 0.65]))
SIDES = 20  # of a trunk ring and of the neck
# The trunk from below: height as a fraction of pelvis (0) to shoulder line (1), half width and half depth in metres of
# a character whose trunk is 0.5 m. Trousers end where the shirt begins; the collar's last ring turns inwards.
TROUSER_RINGS = np.array(
    [
        [-0.26, 0.030, 0.020],
        [-0.25, 0.080, 0.055],
        [-0.21, 0.140, 0.090],
        [-0.12, 0.164, 0.110],
        [0.02, 0.160, 0.112],
        [0.07, 0.150, 0.104],
    ]
)
SHIRT_RINGS = np.array(
    [
        [0.03, 0.120, 0.090],
        [0.03, 0.163, 0.115],
        [0.06, 0.163, 0.115],
        [0.20, 0.148, 0.106],
        [0.36, 0.138, 0.099],
        [0.52, 0.147, 0.106],
        [0.68, 0.165, 0.116],
        [0.82, 0.180, 0.114],
        [0.92, 0.182, 0.102],
        [0.99, 0.166, 0.088],
        [1.04, 0.122, 0.078],
        [1.07, 0.082, 0.071],
        [1.10, 0.068, 0.066],
        [1.12, 0.064, 0.064],
        [1.10, 0.050, 0.050],
    ]
)


@dataclass(frozen=True)
class Limb:
    """One capsule: from joint to joint, radius in metres at each end, colour, sides."""

    start: str
    end: str
    radii: tuple
    color: tuple
    sides: int = 12


def _limbs(posture):
    """Every capsule of the figure; points that are no joints are derived in `Character.skeleton`."""
    yield Limb("collar", "head_base", (0.052, 0.050), NECK, SIDES)
    for side, sleeve, hand in (("right", RIGHT_SLEEVE, RIGHT_HAND), ("left", LEFT_SLEEVE, LEFT_HAND)):
        yield Limb("nape", f"{side}_shoulder", (0.052, 0.050), SHIRT)
        yield Limb(f"{side}_shoulder", f"{side}_elbow", (0.058, 0.043), sleeve)
        yield Limb(f"{side}_elbow", f"{side}_wrist", (0.043, 0.030), sleeve)
        if posture != "none":
            yield Limb(f"{side}_hip", f"{side}_knee", (0.077, 0.060), TROUSERS)
            yield Limb(f"{side}_knee", f"{side}_ankle", (0.058, 0.042), TROUSERS)
            yield Limb(f"{side}_ankle", f"{side}_toe", (0.044, 0.034), SHOE)
        for finger in ACROSS:
            palm, *thick = (
                (0.016, 0.0135, 0.012, 0.0105, 0.009) if finger == "thumb" else (0.017, 0.0122, 0.0105, 0.0092, 0.0078)
            )
            yield Limb(f"{side}_hand_root", f"{side}_{finger}_0", (palm, thick[0]), hand, 8)
            for bone in range(3):
                joints = f"{side}_{finger}_{bone}", f"{side}_{finger}_{bone + 1}"
                yield Limb(*joints, tuple(thick[bone : bone + 2]), hand, 8)


class Character:
    """The mesh of one character, sized from its own bones.

    Parameters: positions (T, 55, 3) of the clip to be drawn, from which sizes are taken (medians over time); face, a
    FaceModel (the embedded one by default); posture of the legs, of which clips have none: standing, sitting or none.

    Attributes: triangles (F, 3) int32; colors (F, 3) float32 unlit blue, green, red 0..255, of each triangle; scale, 1
    for a trunk of 0.5 m from pelvis to shoulders; props (P, 3) metres, what stands around and never moves. Vertices
    stand in the order limbs (by their sides), trunk, head, props.
    """

    def __init__(self, positions, face=None, posture="standing"):
        check_posture(posture)
        joints = _joints(positions)
        trunk = np.median(np.linalg.norm(joints["collar"] - joints["pelvis"], axis=-1))
        self.scale = float(np.clip(trunk / 0.5, 0.4, 2.5))
        self.posture, self.feet = posture, {} if posture == "none" else ankles(joints, self.scale, posture)
        self.chest = self._breadth(joints, "shoulder", 0.05, 0.23)
        self.hips = self._breadth(joints, "hip", 0.07, 0.16)
        self.head = Head(face or embedded(), SKIN)
        self.limbs = {n: [limb for limb in _limbs(posture) if limb.sides == n] for n in (SIDES, 12, 8)}
        self.templates = {sides: capsule_template(sides) for sides in self.limbs}
        around = props(self.feet, self.scale, posture) if self.feet else []
        self.props = np.concatenate([np.zeros((0, 3)), *(points for points, *_ in around)]).astype(np.float32)
        pieces = [
            (len(self.templates[sides][0]), self.templates[sides][2], limb.color)
            for sides, limbs in self.limbs.items()
            for limb in limbs
        ]
        pieces += [
            (len(table) * SIDES, grid_triangles(len(table), SIDES), color)
            for table, color in ((TROUSER_RINGS, TROUSERS), (SHIRT_RINGS, SHIRT))
        ]
        pieces.append((len(self.head.mean), self.head.triangles, self.head.colors))
        pieces += [(len(points), triangles, color) for points, triangles, color in around]
        starts = np.cumsum([0, *(count for count, *_ in pieces)])
        self.triangles = np.concatenate([piece[1] + start for piece, start in zip(pieces, starts, strict=False)])
        self.colors = np.concatenate([np.broadcast_to(color, triangles.shape) for _, triangles, color in pieces])
        self.triangles, self.colors = self.triangles.astype(np.int32), self.colors.astype(np.float32)
        self._still = self.props, vertex_normals(self.props[None], self._triangles_of_props(around))[0]

    @staticmethod
    def _triangles_of_props(around):
        starts = np.cumsum([0, *(len(points) for points, *_ in around)])
        found = [triangles + start for (_, triangles, _), start in zip(around, starts, strict=False)]
        return np.concatenate([np.zeros((0, 3), np.int32), *found]).astype(np.int32)

    def _breadth(self, joints, pair, beyond, usual):
        """Half the distance of a pair of joints, `beyond` metres added, as a multiple of the `usual` one."""
        across = np.median(np.linalg.norm(joints[f"left_{pair}"] - joints[f"right_{pair}"], axis=-1))
        return float(np.clip((across / 2 / self.scale + beyond) / usual, 0.75, 1.4))

    def skeleton(self, positions, rotation=None):
        """{name: (T, 3)} of joints and derived points, `head_center` among them, and the head's axes (T, 3, 3).

        positions (T, 55, 3); rotation (T, 3) axis-angle of the head or None (taken from head and shoulders).
        """
        joints = _joints(np.asarray(positions, np.float32))
        joints["nape"] = joints["collar"] + unit(joints["collar"] - joints["pelvis"]) * (0.022 * self.scale)
        joints["head_center"], axes = self.head.place(joints, rotation, self.scale)
        joints["head_base"] = joints["head_center"] + axes @ (self.scale * np.float32([0, -0.045, -0.022]))
        return joints | (legs(joints, self.scale, self.posture, self.feet) if self.feet else {}), axes

    def pose(self, positions, rotation=None, expression=None):
        """Points (T, V, 3) metres and their brightness (T, V) of T frames, 1 where colours are as they are.

        positions and rotation as in `skeleton`; expression (T, E) or None (neutral).
        """
        joints, axes = self.skeleton(positions, rotation)
        parts = []
        for sides, limbs in self.limbs.items():
            starts, ends = (np.stack([joints[getattr(limb, end)] for limb in limbs], 1) for end in ("start", "end"))
            radii = np.array([limb.radii for limb in limbs], np.float32) * self.scale
            parts.append(capsules(starts, ends, radii[:, 0], radii[:, 1], self.templates[sides]))
        parts += self.trunk(joints)
        parts.append(self.head.pose(joints["head_center"], axes, self.scale, expression))
        parts.append([np.broadcast_to(still, (len(axes), *still.shape)) for still in self._still])
        points, normals = (np.concatenate([part[i] for part in parts], 1, dtype=np.float32) for i in (0, 1))
        return points, _shade(normals, LIGHT)

    def trunk(self, joints):
        """[(points, normals)], each (T, n, 3), of trousers and shirt."""
        return [self._rings(joints, table) for table in (TROUSER_RINGS, SHIRT_RINGS)]

    def _rings(self, joints, table):
        """Points and normals of rings from the hips over the spine to the collar; `table` as SHIRT_RINGS."""
        low, middle, high = joints["pelvis"], joints["spine"], joints["collar"]
        height, width, depth = table.T
        bend = np.linalg.norm(middle - low, axis=-1) / np.linalg.norm(high - low, axis=-1)
        bend = float(np.clip(np.median(bend), 0.2, 0.8))
        share = np.clip(height, 0, 1)
        # A parabola through pelvis, spine and the shoulder line, straight beyond its ends.
        weights = [
            (share - bend) * (share - 1) / bend,
            share * (share - 1) / (bend * (bend - 1)),
            share * (share - bend) / (1 - bend),
        ]
        centers = np.einsum("kr,ktx->trx", weights, np.stack([low, middle, high]))
        up = unit(high - low)[:, None]
        centers = centers + up * ((height - share) * 0.5 * self.scale)[:, None]
        hips, shoulders = joints["left_hip"] - joints["right_hip"], joints["left_shoulder"] - joints["right_shoulder"]
        left = unit(hips)[:, None] * (1 - share)[:, None] + unit(shoulders)[:, None] * share[:, None]
        forward = unit(np.cross(left, up))
        width = width * np.interp(height, [0.1, 0.4, 0.8, 1.0, 1.1], [self.hips, 1, self.chest, self.chest, 1])
        return rings(centers, np.cross(up, forward), forward, width * self.scale, depth * self.scale, SIDES)


def _joints(positions):
    """{name: (T, 3)} of the joints, and `collar`, the middle between the shoulders."""
    joints = {name: positions[:, i] for i, name in enumerate(UPPER55.names)}
    joints["collar"] = (joints["right_shoulder"] + joints["left_shoulder"]) / 2
    return joints


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _shade(normals, light):
    """Brightness (T, V) of surfaces: a soft key light from above the viewer's right, darker towards the outline."""
    bright = np.empty(normals.shape[:2], np.float32)
    for t in range(normals.shape[0]):
        for v in range(normals.shape[1]):
            n = normals[t, v]
            key, facing = n[0] * light[0] + n[1] * light[1] + n[2] * light[2], max(n[2], np.float32(0))
            gleam = max(key, np.float32(0)) ** 2
            gleam = gleam * gleam * gleam * gleam
            bright[t, v] = np.float32(0.58) + np.float32(0.26) * key + np.float32(0.22) * facing + gleam / 10
    return bright


def framing(figures, motions, width, height, whole=False):
    """One camera for all panels of width x height pixels, so that they compare: it sees every joint of every frame.

    figures and motions, the (T, 55, 3) positions they show, in the same order. The pelvis stands in the middle; there
    is room for the title above the head and for the fade below the lowest hand; or, of the `whole` character, for all
    down to the floor. Joints farther off than arms reach, as failed tracking has them, do not count.
    """
    points = []
    for figure, positions in zip(figures, motions, strict=True):
        reach = np.array([[-1.1, -0.7, -0.6], [1.1, 1.6, 1.0]]) * figure.scale
        points.append(np.clip(positions.reshape(-1, 3), *reach))
        crown = positions[:, UPPER55.index["neck"]] + np.array([0, 1.15 * HEIGHT * figure.scale, 0])
        points += [np.clip(crown, *reach), np.array([[0.3, -0.12, 0.0]]) * figure.scale]
        points += [figure.props] if whole and len(figure.props) else []
    return Camera.containing(np.concatenate(points), width, height, TITLE, SUBTITLE if whole else FADE)
