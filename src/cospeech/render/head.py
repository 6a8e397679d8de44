"""The character's head: skull, hair, nose, ears, and eyes, brows and lips moved by expression coefficients."""

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.face import expression_names
from cospeech.render.mesh import fan_triangles, grid_triangles, strip_triangles, unit

# Sizes are in head heights: the skull is 1 high (chin at y = -0.5), x towards the character's left, z forward.
HEIGHT = 0.248  # metres, of a character whose trunk is 0.5 m
HALF = np.array([0.355, 0.50, 0.43])
HAIR, LIPS, MOUTH, TEETH = (58, 62, 74), (112, 116, 190), (48, 36, 84), (238, 242, 244)
WHITE, IRIS, PUPIL, LASH, BROW = (246, 248, 248), (120, 92, 60), (34, 28, 26), (52, 52, 66), (62, 70, 92)
ARC = np.linspace(-1, 1, 11)  # the points of a lip, a lid or a brow, from the character's right to its left
ROUND = np.linspace(0, 2 * np.pi, 14, endpoint=False)
EYE, MOUTH_AT = (0.150, 0.02), -0.265


def _taper(y):
    """How much narrower the face is at height y than an ellipsoid: the jaw."""
    return 1 - 0.20 * np.clip(-y / HALF[1], 0, 1) ** 1.5


def surface(x, y):
    """z of the front of the face at (x, y), head heights."""
    inside = 1 - (x / (HALF[0] * _taper(y))) ** 2 - (y / HALF[1]) ** 2
    return HALF[2] * np.sqrt(np.clip(inside, 0.0, None))


def _skull(rows, columns):
    """Points (n, 3) and normals of the skull, from the chin upwards."""
    latitude = np.linspace(-0.5, 0.5, rows)[:, None] * np.pi
    angle = (-np.pi / 2 - np.arange(columns) * 2 * np.pi / columns)[None]
    direction = np.stack(np.broadcast_arrays(
        np.cos(latitude) * np.cos(angle), np.sin(latitude), np.cos(latitude) * np.sin(angle)), -1)  # fmt: skip
    points = direction * HALF
    points[..., 0] *= _taper(points[..., 1])
    return points.reshape(-1, 3), unit(direction / HALF).reshape(-1, 3)


class Head:
    """The head's mesh and its expression. `triangles` (F, 3) and unlit `colors` (V, 3) as in `Figure`."""

    def __init__(self, face_model, skin):
        names = expression_names(face_model) or ()
        self.coefficient = {name: i for i, name in enumerate(names)}
        self.skin = skin
        _, _, triangles, colors = self._build(np.zeros((1, len(names)), np.float32))
        self.triangles, self.colors = np.concatenate(triangles), np.concatenate(colors).astype(np.float32)

    def place(self, joints, rotation, scale):
        """Centre (T, 3) of the skull and its axes (T, 3, 3), columns left, up, forward."""
        neck, top = joints["neck"], joints["head_top"]
        if rotation is not None:
            axes = Rotation.from_rotvec(rotation).as_matrix().astype(np.float32)
        else:
            up = unit(top - neck)
            forward = unit(np.cross(joints["left_shoulder"] - joints["right_shoulder"], up))
            axes = np.stack([np.cross(up, forward), up, forward], -1)
        size = HEIGHT * scale
        length = np.maximum(np.median(np.linalg.norm(top - neck, axis=-1)), 1.1 * size)
        return neck + unit(top - neck) * (length - size / 2) + axes[..., 2] * (0.10 * size), axes

    def pose(self, center, axes, scale, expression=None):
        """Points and normals, each (T, V, 3), of the head at `center` (T, 3) with `axes` (T, 3, 3)."""
        if expression is None or not self.coefficient:
            expression = np.zeros((len(center), len(self.coefficient)), np.float32)
        points, normals, _, _ = self._build(np.clip(expression, -0.2, 1.2).astype(np.float32))
        points, normals = np.concatenate(points, 1), np.concatenate(normals, 1)
        turn = np.swapaxes(axes, 1, 2)
        return points @ turn * (HEIGHT * scale) + center[:, None], normals @ turn

    def _build(self, expression):
        """Lists of points (T, n, 3), normals, triangles and colours of all pieces."""
        face = _Face(expression, self.coefficient)
        self._solids(face)
        for side in ("left", "right"):
            _eye(face, side)
            _brow(face, side)
        _mouth(face)
        return face.points, face.normals, face.triangles, face.colors

    def _solids(self, face):
        """Skull with a jaw that drops, hair, nose and ears."""
        points, normals = _skull(19, 24)
        weight = np.clip((-points[:, 1] - 0.16) / 0.2, 0, 1) * np.clip(points[:, 2] / 0.2 + 0.6, 0, 1)
        drop = face("jaw_open")[:, None] * weight
        moved = np.repeat(points[None], len(drop), 0)
        moved[..., 1] -= 0.085 * drop
        moved[..., 2] -= 0.03 * drop
        face.add(moved, normals, grid_triangles(19, 24), self.skin)
        face.add(*_hair(), HAIR)
        face.add(*_ellipsoid((0, -0.045, surface(0.0, -0.045) + 0.002), (0.046, 0.105, 0.052), slant=0.42), self.skin)
        for side in (-1, 1):
            face.add(*_ellipsoid((side * HALF[0] * 0.97, -0.02, -0.03), (0.035, 0.095, 0.060)), self.skin)


def _ellipsoid(center, half, slant=0.0):
    """Points, normals and triangles of an ellipsoid; `slant` makes it slimmer and flatter towards its top."""
    latitude = np.linspace(-0.5, 0.5, 9)[:, None] * np.pi
    angle = (-np.arange(12) * np.pi / 6)[None]
    direction = np.stack(np.broadcast_arrays(
        np.cos(latitude) * np.cos(angle), np.sin(latitude), np.cos(latitude) * np.sin(angle)), -1)  # fmt: skip
    direction = direction.reshape(-1, 3)
    slim = 1 - slant * (direction[:, 1:2] + 1)
    points = direction * np.where([True, False, True], half * slim, half) + center
    return points[None], unit(direction / half), grid_triangles(9, 12)


def _hair():
    """Points, normals and triangles of a cap of hair from a hairline, high in front and low at the back, to the top."""
    rows, columns = 8, 48
    angle = -np.pi / 2 - np.arange(columns) * 2 * np.pi / columns
    line = np.interp(np.sin(angle), [-1, -0.15, 0.1, 0.45, 1], [-0.20, -0.06, 0.14, 0.235, 0.245])
    low = np.arcsin(line / HALF[1])
    latitude = low + (np.pi / 2 - low) * np.linspace(0, 1, rows)[:, None]
    direction = np.stack(np.broadcast_arrays(
        np.cos(latitude) * np.cos(angle), np.sin(latitude), np.cos(latitude) * np.sin(angle)), -1)  # fmt: skip
    thick = np.interp(np.arange(rows), [0, 1, rows - 1], [0.003, 0.022, 0.030])[:, None, None]
    points = direction * (HALF + thick)
    points[..., 0] *= _taper(points[..., 1])
    return points.reshape(1, -1, 3), unit(direction / HALF).reshape(-1, 3), grid_triangles(rows, columns)


class _Face:
    """Collects pieces; calling it gives a named coefficient (T,), zeros where the face model has none of that name."""

    def __init__(self, expression, coefficient):
        self.expression, self.coefficient = expression, coefficient
        self.points, self.normals, self.triangles, self.colors, self.count = [], [], [], [], 0

    def __call__(self, *names):
        """Mean (T,) of the named coefficients."""
        columns = [self.coefficient[name] for name in names if name in self.coefficient]
        return self.expression[:, columns].mean(1) if columns else np.zeros(len(self.expression), np.float32)

    def add(self, points, normals, triangles, color):
        """Append one piece: points (T or 1, n, 3), normals (n, 3) or the same shape."""
        shape = (len(self.expression), points.shape[-2], 3)
        self.points.append(np.broadcast_to(points, shape))
        self.normals.append(np.broadcast_to(normals, shape))
        self.triangles.append((triangles + self.count).astype(np.int32))
        self.colors.append(np.tile(color, (shape[1], 1)))
        self.count += shape[1]

    def _patch(self, x, y, triangles, color, lift, at=None):
        """A piece drawn in the face plane: x, y (T, n) head heights, lifted off the skin by `lift`.

        `at` replaces y where the skin is looked up: what has been pulled down keeps the depth it had at rest.
        """
        x, y = np.broadcast_arrays(x, y)
        z = surface(x, y if at is None else at)
        normals = unit(np.stack([x, np.broadcast_to(y if at is None else at, y.shape), z], -1) / HALF**2)
        self.add(np.stack([x, y, z + lift], -1), normals, triangles, color)

    def band(self, x, upper, lower, color, lift, at=None):
        """The area between two curves over the same x, all (T, n)."""
        x, upper, lower = np.broadcast_arrays(x, upper, lower)
        x, y = np.concatenate([x, x], 1), np.concatenate([upper, lower], 1)
        self._patch(x, y, strip_triangles(upper.shape[1]), color, lift, at)

    def disc(self, x, y, radius, color, lift, upper, lower):
        """A disc about x, y (T,) of the given radius, cut off above `upper` and below `lower`, functions of x."""
        across = x[:, None] + radius * np.concatenate([[0], np.cos(ROUND)])
        down = y[:, None] + radius * np.concatenate([[0], np.sin(ROUND)])
        down = np.clip(down, lower(across), np.maximum(upper(across), lower(across)))
        self._patch(across, down, fan_triangles(len(ROUND))[:, ::-1], color, lift)


def _eye(face, side):
    """White, iris, pupil and upper lid of one eye."""
    sign = 1 if side == "left" else -1
    center, height = sign * EYE[0], EYE[1]
    blink, squint = face(f"eye_blink_{side}"), face(f"eye_squint_{side}", f"lid_lower_up_{side}")
    upper = 0.048 + 0.018 * face(f"eye_wide_{side}") - 0.076 * np.clip(blink, 0, 1) - 0.010 * squint
    lower = -0.030 + 0.016 * np.clip(squint, 0, 1)
    upper = np.maximum(upper, lower + 0.002)

    def lid(edge):
        return lambda x: height + edge[:, None] * np.clip(1 - ((x - center) / 0.082) ** 2, 0, 1)

    x = np.broadcast_to(center + 0.080 * ARC, (len(blink), len(ARC)))
    face.band(x, lid(upper)(x), lid(lower)(x), WHITE, 0.008)
    turn = face("eye_look_out_" + side) - face("eye_look_in_" + side)
    lift = face("eye_look_up_" + side) - face("eye_look_down_" + side)
    at = center + sign * 0.035 * turn, height + 0.006 + 0.025 * lift
    face.disc(*at, 0.037, IRIS, 0.013, lid(upper), lid(lower))
    face.disc(*at, 0.017, PUPIL, 0.017, lid(upper), lid(lower))
    face.band(x, lid(upper)(x) + 0.013, lid(upper)(x) - 0.004, LASH, 0.021)


def _brow(face, side):
    """One brow: its inner and outer end rise and fall on their own."""
    sign, along = (1, (ARC + 1) / 2) if side == "left" else (-1, (1 - ARC) / 2)  # 0 at the inner end
    down, furrow = face(f"brow_down_{side}"), face("brow_furrow")
    inner = 0.045 * face("brow_inner_up") - 0.040 * down - 0.015 * furrow
    outer = 0.050 * face(f"brow_outer_up_{side}") - 0.022 * down
    x = sign * (0.055 - 0.015 * furrow[:, None] + (0.20 + 0.015 * furrow[:, None]) * along)
    y = 0.118 + 0.028 * np.sin(np.pi * (0.15 + 0.75 * along)) + inner[:, None] * (1 - along) + outer[:, None] * along
    thick = 0.017 * (1 - 0.55 * along)
    face.band(x, y + thick, y - thick, BROW, 0.014)


def _mouth(face):
    """Lips, teeth and the dark between them."""
    jaw, close = np.clip(face("jaw_open"), 0, 1), np.clip(face("mouth_close"), 0, 1)
    pucker, funnel = face("mouth_pucker"), face("mouth_funnel")
    smile, stretch = face("mouth_smile_left", "mouth_smile_right"), face("mouth_stretch_left", "mouth_stretch_right")
    frown = face("mouth_frown_left", "mouth_frown_right")
    press = face("mouth_press_left", "mouth_press_right")
    roll_up, roll_low = face("mouth_roll_upper"), np.maximum(face("mouth_roll_lower"), face("mouth_bite_lower"))
    half = 0.118 * (1 + 0.22 * stretch + 0.20 * smile - 0.42 * pucker - 0.28 * funnel - 0.10 * jaw)
    raised = 0.003 + 0.030 * face("mouth_upper_up_left", "mouth_upper_up_right") + 0.018 * funnel
    lowered = 0.003 + 0.15 * jaw * (1 - 0.9 * close) + 0.035 * face("mouth_lower_down_left", "mouth_lower_down_right")
    lowered = lowered + 0.020 * funnel - 0.05 * face("mouth_bite_lower") * jaw
    drop = 0.085 * jaw * close - 0.02 * face("mouth_shrug_lower")  # closed lips follow the jaw
    corner = 0.008 + 0.040 * smile - 0.035 * frown - 0.02 * jaw
    side = 0.05 * (face("mouth_left") - face("mouth_right")) + 0.03 * (face("jaw_left") - face("jaw_right"))
    x = side[:, None] + half[:, None] * ARC
    line = MOUTH_AT - drop[:, None] + corner[:, None] * np.abs(ARC) ** 1.6
    arch = np.sqrt(np.clip(1 - ARC**2, 0, 1)) * (0.55 + 0.45 * (1 - ARC**2))
    above = line + np.maximum(raised, 0)[:, None] * arch
    below = line - np.maximum(lowered, 0)[:, None] * arch
    full = 1 + 0.55 * pucker + 0.35 * funnel - 0.35 * press
    bow = 1 - 0.22 * np.exp(-((ARC / 0.16) ** 2))  # the dip in the middle of the upper lip
    taper = np.sqrt(np.clip(1 - 0.97 * ARC**2, 0, 1))
    upper = above + (0.030 * np.clip(full - 0.75 * roll_up, 0.15, None))[:, None] * taper * bow
    lower = below - (0.038 * np.clip(full - 0.75 * roll_low, 0.15, None))[:, None] * taper
    forward = 0.05 * (np.clip(pucker, 0, None) + 0.7 * np.clip(funnel, 0, None))[:, None]
    face.band(x, above, below, MOUTH, 0.012 + forward, MOUTH_AT)
    face.band(
        x * 0.86, np.maximum(above - 0.006, below), np.maximum(above - 0.034, below), TEETH, 0.016 + forward, MOUTH_AT
    )
    face.band(x, upper, above, LIPS, 0.020 + forward, MOUTH_AT)
    face.band(x, below, lower, LIPS, 0.020 + forward, MOUTH_AT)
