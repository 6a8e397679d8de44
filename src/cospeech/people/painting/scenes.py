"""Where people are: backgrounds, light, furniture, and what a camera does to a picture; `studio` and `wild`."""

import cv2
import numpy as np

from cospeech.people.anthropometry import INDEX
from cospeech.people.painting import raster
from cospeech.people.painting.materials import colors
from cospeech.people.painting.solids import BYSTANDER, THING, Solids, unit

STUDIO = np.array([[0.18, 0.62, 0.25], [0.72, 0.73, 0.74], [0.45, 0.50, 0.58], [0.86, 0.86, 0.85], [0.30, 0.31, 0.33]])


def draw_lights(dice, domain):
    """(N, 6) for `raster.trace`: direction to the light, its strength, the ambient light's, darkening of outlines."""
    if domain == "studio":
        way = np.stack([dice.uniform(-0.4, 0.4), dice.uniform(-0.7, -0.4), dice.uniform(-0.9, -0.7)], axis=1)
        return np.column_stack(
            [unit(way), dice.uniform(0.34, 0.42), dice.uniform(0.64, 0.70), np.full(len(dice), 0.25)]
        )
    way = np.stack([dice.uniform(-1, 1), dice.uniform(-1, 0.1), dice.uniform(-1, 0.15)], axis=1)
    strength = dice.uniform(0.2, 0.6)
    return np.column_stack([unit(way), strength, dice.uniform(0.85, 1.1) - strength, dice.uniform(0.1, 0.4)])


def furniture(dice, joints, view, domain, part, framing, seated):
    """Solids (N, P, raster.COLUMNS) around people (N, 61, 3), their own axes: floor, desk, chair, things before them.

    All have a part from THING on; what a scene lacks is switched off.
    """
    solids, room = Solids(len(joints)), _Room(view)
    feet = joints[:, [INDEX["right_toe"], INDEX["left_toe"], INDEX["right_ankle"], INDEX["left_ankle"]], 1]
    low = feet.min(axis=1) - 0.05
    floor = dice.chance(0.7) & (room.eye[:, 1] > low + 0.2)  # a camera below it would see nothing else
    tiles = dice.chance(0.32) & (domain == "wild")
    tone = colors(dice, 0.4) if domain == "wild" else np.multiply.outer(dice.uniform(0.43, 0.68), np.ones(3))
    solids.box(
        room.at(0, low, 0),
        room.turned(dice.uniform(-0.6, 0.6)),
        _half(4.0, 0.02, 3.0, shown=floor),
        tone,
        THING,
        color2=tone * 0.75,
        pattern=np.where(tiles, raster.CHECKS, 0),
        period=dice.uniform(0.15, 0.6),
    )
    if domain == "wild" and part != "hand":
        desk = np.where(seated, dice.chance(0.6), (framing == 1) & dice.chance(0.25))
        _desk(solids, dice, room, joints, desk)
        high = dice.uniform(0.2, 0.5)
        back = _half(0.22, high, 0.03, shown=seated & dice.chance(0.7))
        solids.box(room.at(0, high - 0.2, -0.20), room.turned(0 * high), back, colors(dice) * 0.7, THING)
        _before(solids, dice, room, joints)
    return solids.rows()


class _Room:
    """Places and directions around people, metres in their own axes, as their cameras see them."""

    def __init__(self, view):
        self.view = view
        self.eye = -np.einsum("nji,nj->ni", view.rotation, view.translation)  # where the camera is

    def at(self, *xyz):
        """(N, 3); x, y and z are (N,) or numbers, one at least (N,)."""
        return self.view.see(np.stack(np.broadcast_arrays(*xyz), axis=1)[:, None])[:, 0]

    def turned(self, angle):
        """Frames (N, 3, 3), columns left, up, forward, turned by radians (N,) about the vertical."""
        cos, sin, zero = np.cos(angle), np.sin(angle), 0 * angle
        columns = [(cos, zero, -sin), (zero, 1 + zero, zero), (sin, zero, cos)]
        return self.view.rotation @ np.stack([np.stack(column, axis=1) for column in columns], axis=2)


def _half(*sides, shown):
    """Half sides (N, 3) of boxes; none where not shown (N,)."""
    return np.stack(np.broadcast_arrays(*sides, shown), axis=1)[:, :3] * shown[:, None]


def _desk(solids, dice, room, joints, desk):
    """A desk, perhaps closed in front, with a laptop or a microphone."""
    hands = joints[:, [INDEX["right_wrist"], INDEX["left_wrist"]]]
    top = np.clip(hands[:, :, 1].min(axis=1) - 0.07, 0.02, 0.16)
    desk = desk & (room.eye[:, 1] > top + 0.2) & (room.eye[:, 2] > 1.5)  # it neither hides the person nor the camera
    angle, color = dice.normal(0, 0.12), colors(dice, 0.6)
    wide, deep, frame = dice.uniform(0.5, 1.2), dice.uniform(0.2, 0.35), room.turned(angle)
    solids.box(room.at(0.2 * angle, top - 0.02, 0.2 + deep), frame, _half(wide, 0.02, deep, shown=desk), color, THING)
    panel = _half(wide, 0.35, 0.015, shown=desk & dice.chance(0.6))
    solids.box(room.at(0.2 * angle, top - 0.38, 0.1 + 2 * deep), frame, panel, color * 0.8, THING)
    aside, tall = dice.uniform(-0.35, 0.35), dice.uniform(0.05, 0.13)
    laptop = _half(0.16, tall, 0.008, shown=desk & dice.chance(0.5))
    solids.box(room.at(aside, top + tall, 0.28 + deep), frame, laptop, colors(dice, 0.3) * 0.6, THING)
    x, z = dice.uniform(-0.25, 0.25), dice.uniform(0.35, 0.5)
    foot, head = room.at(x, top, z), room.at(x * 0.6, top + 0.22, z - 0.1)
    stands = desk & dice.chance(0.35)
    solids.cone(foot, head, np.where(stands, 0.008, -1), 0.008, [0.12, 0.12, 0.13], THING)
    solids.cone(head, head + (head - foot) * 0.3, np.where(stands, 0.02, -1), 0.024, [0.2, 0.2, 0.2], THING)


def _before(solids, dice, room, joints):
    """Something between camera and person: a post or a box."""
    shown, post = dice.chance(0.10), dice.chance(0.5)
    aside = np.stack([dice.normal(0, 0.28), dice.normal(0, 0.4), 0 * post], axis=1)
    seen = room.at(*(joints[:, INDEX["pelvis"]] + aside).T) * dice.uniform(0.55, 0.8)[:, None]
    size, color = dice.uniform(0.02, 0.07), colors(dice)
    up = room.view.rotation[:, :, 1] * dice.uniform(0.1, 0.7)[:, None]
    solids.cone(seen - up, seen + up, np.where(shown & post, size, -1), size, color, THING)
    half = _half(size * 1.5, size * 1.2, size, shown=shown & ~post)
    solids.box(seen, room.turned(dice.uniform(-1, 1)), half, color, THING)


def bystanders(dice, rows, view):
    """Solids of other people, made from those of the person beside each in the block: (N, P, COLUMNS).

    They stand behind the person, aside, and belong to the part BYSTANDER.
    """
    shown = dice.chance(0.12)
    other = np.roll(rows, 1, axis=0).copy()
    aside = dice.pick([-1.0, 1.0]) * dice.uniform(0.4, 1.3)
    way = np.stack([aside, dice.normal(0.0, 0.1), -dice.uniform(0.8, 2.5)], axis=1)
    moved = np.einsum("nij,nj->ni", view.rotation, way)
    own = view.translation[:, None] - np.roll(view.translation, 1, axis=0)[:, None] + moved[:, None]
    other[:, :, raster.ORIGIN] += own
    flat = other[:, :, raster.KIND] == raster.TRIANGLE
    for column in (slice(3, 6), raster.END):
        other[:, :, column] += np.where(flat[..., None], own, 0)
    other[:, :, raster.PART] = BYSTANDER
    other[~shown] = 0  # spheres of no size
    return other


# ---- pictures -------------------------------------------------------------------------------------------------------


def background(rng, size, domain):
    """(size, size, 3) float32, 0 to 1."""
    if domain == "studio":
        color = STUDIO[rng.integers(len(STUDIO))] * rng.uniform(0.9, 1.08)
        ramp = np.linspace(*rng.uniform(0.82, 1.1, 2), size, dtype=np.float32)[:, None, None]
        return np.clip(ramp * np.broadcast_to(color.astype(np.float32), (size, size, 3)), 0, 1)
    image = _cloud(rng, size)
    for _ in range(rng.integers(2, 9)):
        _clutter(rng, image, size)
    blur = rng.uniform(0, 1.6) * size / 128
    return cv2.GaussianBlur(image, (0, 0), blur) if blur > 0.4 else image


def _cloud(rng, size):
    """A wall of two colours mixed by smooth noise, with grain."""
    grid = int(rng.integers(2, 9))
    mix = cv2.resize(rng.random((grid, grid), dtype=np.float32), (size, size), interpolation=cv2.INTER_CUBIC)[..., None]
    one, two = np.array([_tone(rng), _tone(rng)], np.float32)
    two = np.float32(0.4) * one + np.float32(0.6) * two
    grain = (rng.random((size // 2, size // 2), dtype=np.float32) - 0.5) * np.float32(rng.uniform(0, 0.25))
    mix = np.clip(mix, 0, 1) + cv2.resize(grain, (size, size))[..., None]
    return np.ascontiguousarray(two + (one - two) * mix)


def _tone(rng):
    """A colour as walls and things have it, mostly muted: three floats."""
    level, vivid, *hue = rng.random(5).tolist()
    return [min(max(0.1 + 0.85 * level + (h - 0.5) * vivid**1.5, 0.02), 1.0) for h in hue]


def _clutter(rng, image, size):
    """One thing on the wall: a frame, a shelf of books, a line, a lamp, a leaf."""
    color = _tone(rng)
    x, y = (int(v) for v in rng.integers(-size // 8, size, 2))
    w, h = (int(v) for v in rng.integers(size // 16, size // 2, 2))
    kind = rng.integers(5)
    if kind == 0:
        cv2.rectangle(image, (x, y), (x + w, y + h), color, -1)
        cv2.rectangle(image, (x, y), (x + w, y + h), [0.6 * c for c in color], max(1, size // 64))
    elif kind == 1:
        while x < size and w > 0:
            thick = int(rng.integers(2, 7)) * size // 128 + 1
            tall = int(h * rng.uniform(0.6, 0.95)) // 2
            cv2.rectangle(image, (x, y + h // 2 - tall), (x + thick - 1, y + h // 2), _tone(rng), -1)
            x, w = x + thick, w - thick
    elif kind == 2:
        cv2.line(image, (x, y), (x + w, y + int(rng.integers(-h, h))), color, int(rng.integers(1, 5)) * size // 128 + 1)
    elif kind == 3:
        cv2.ellipse(image, (x, y), (w // 3 + 1, h // 3 + 1), float(rng.uniform(0, 180)), 0, 360, color, -1)
    else:
        points = np.array([x, y]) + rng.integers(-w, w, (int(rng.integers(3, 7)), 2))
        cv2.fillPoly(image, [points.astype(np.int32)], color)


def contact_shadows(color, depth, limit):
    """Darken, in place, what lies close behind something nearer: color (H, W, 3) float32, depth (H, W) float32."""
    size = depth.shape[0]
    near = np.minimum(depth, limit)
    behind = near - cv2.blur(near, (size // 14 | 1, size // 14 | 1))
    shade = 1 - 0.30 * np.clip(behind * 4.0, 0, 1)
    color *= cv2.blur(shade, (3, 3))[..., None]


def photograph(rng, color, domain):
    """What a camera makes of light: (H, W, 3) float32 0 to 1 -> uint8; wild ones are worse and compressed."""
    size = color.shape[0]
    if domain == "studio":
        noise = rng.integers(-3, 4, color.shape[:2], dtype=np.int16)
        picture = cv2.GaussianBlur(np.clip(color, 0, 1), (3, 3), 0.55)
        return np.clip(picture * 255 + noise[..., None], 0, 255).astype(np.uint8)
    gain = rng.uniform(0.75, 1.25) * rng.uniform(0.88, 1.12, 3)
    picture = np.clip(color * gain.astype(np.float32), 0, 1) ** np.float32(rng.uniform(0.65, 1.3))
    blur = rng.choice([0.5, 0.6, 0.8, 1.0]) * size / 128
    picture = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), blur) * 255
    noise = np.empty(color.shape, np.float32)
    cv2.setRNGSeed(int(rng.integers(1 << 30)))
    cv2.randn(noise, 0, float(rng.uniform(0, 7)))
    picture = np.clip(picture + noise, 0, 255).astype(np.uint8)
    if rng.random() < 0.6:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 90))]
        picture = cv2.imdecode(cv2.imencode(".jpg", picture, quality)[1], cv2.IMREAD_COLOR)
    return picture
