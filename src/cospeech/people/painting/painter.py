"""The painter for others: draw anyone whose joints are known, as films of the virtual speaker do.

    canvas = Canvas(background)                                   # (H, W, 3) uint8, or float32 0 to 1
    solids = person_solids(joints, appearance, expression=...)    # of all frames at once, (T, P, COLUMNS)
    canvas.paint(solids[t], camera)                               # as many people and things as there are
    picture = canvas.picture()

Joints are in the camera's axes: x right, y down, z away; metres.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from cospeech.errors import CospeechError
from cospeech.face.expressions import COSPEECH64
from cospeech.people import faces
from cospeech.people.anthropometry import INDEX, JOINTS61, TABLE, draw_build
from cospeech.people.bodies import Bodies, body_solids
from cospeech.people.dice import Dice
from cospeech.people.heads import skull_center
from cospeech.people.painting import raster, scenes
from cospeech.people.painting.materials import Materials, draw_materials
from cospeech.people.painting.solids import unit
from cospeech.skeleton import UPPER55

LIGHT = np.array([-0.30, -0.60, -0.74, 0.38, 0.67, 0.25])  # a soft key light from the upper left
CROWN = np.array(TABLE["offsets"]["head_top"])
HEAD_SHARE = TABLE["lengths"]["head"] / np.linalg.norm(CROWN)  # of the way from neck to crown


@dataclass(frozen=True)
class Appearance:
    """One person's `Materials` (of one), girth, female and face (8,), as drawn by `draw_appearance`."""

    materials: Materials
    girth: float
    female: bool
    face: np.ndarray


def draw_appearance(name, domain="studio", seed=0, female=None):
    """The `Appearance` that belongs to a name; the same for the same arguments. domain: "studio" or "wild"."""
    dice = Dice(seed, ("appearance", name, domain), [0])
    build = draw_build(dice)
    if female is not None:
        build.female[:] = female
    materials = draw_materials(dice, domain, build.female, build.age)
    return Appearance(materials, float(build.girth[0]), bool(build.female[0]), build.face[0])


def head_axes(joints):
    """Axes (T, 3, 3), columns left, up, forward, of heads known by their joints (T, 55 or 61, 3) alone.

    As people here and the virtual speaker are built: the joint `head` lies before the line from neck to crown, which
    itself leans forward by 4.5 degrees.
    """
    neck = joints[:, INDEX["neck"]]
    line = unit(joints[:, INDEX["head_top"]] - neck)
    front = joints[:, INDEX["head"]] - neck
    front = unit(front - line * np.sum(front * line, axis=1, keepdims=True))
    lean = np.arctan2(CROWN[2], CROWN[1])
    up, forward = np.cos(lean) * line - np.sin(lean) * front, np.cos(lean) * front + np.sin(lean) * line
    return np.stack([np.cross(up, forward), up, forward], axis=2)


def with_legs(joints, seated=False):
    """Joints (T, 55, 3) of the clip file's skeleton -> (T, 61, 3): legs that stand, or sit on a chair."""
    size = np.linalg.norm(joints[:, INDEX["head_top"]] - joints[:, INDEX["neck"]], axis=1) / np.linalg.norm(CROWN)
    lengths = {name: (TABLE["lengths"][name] * size)[:, None] for name in ("thigh", "shank", "foot", "foot_height")}
    down = unit(joints[:, INDEX["pelvis"]] - joints[:, INDEX["neck"]])
    forward = unit(np.cross(joints[:, INDEX["right_hip"]] - joints[:, INDEX["left_hip"]], down))
    legs = []
    for side in ("right", "left"):
        knee = joints[:, INDEX[f"{side}_hip"]] + (forward if seated else down) * lengths["thigh"]
        ankle = knee + down * lengths["shank"]
        legs += [knee, ankle, ankle + forward * lengths["foot"] + down * lengths["foot_height"]]
    return np.concatenate([joints, np.stack(legs, axis=1)], axis=1)


def person_solids(joints, appearance, *, head=None, expression=None, seated=False):
    """Solids (T, P, raster.COLUMNS) of one person in T frames.

    joints : (T, 55, 3) in the order of `UPPER55`, legs are added; or (T, 61, 3) as `anthropometry.JOINTS61`.
    head : (T, 3, 3) axes of the head in the camera's axes, columns left, up, forward; None: from the joints.
    expression : (T, 64) coefficients of cospeech64; None: at rest. Raises CospeechError for other shapes.
    """
    joints = np.asarray(joints, np.float64)
    if joints.ndim != 3 or joints.shape[1:] not in ((len(UPPER55), 3), (len(JOINTS61), 3)):
        raise CospeechError(f"person_solids: joints of shape {joints.shape}; expected (frames, 55 or 61, 3)")
    joints = with_legs(joints, seated) if joints.shape[1] == len(UPPER55) else joints
    count = len(joints)
    expression = np.zeros((count, len(COSPEECH64))) if expression is None else np.asarray(expression, np.float64)
    if expression.shape != (count, len(COSPEECH64)):
        raise CospeechError(f"person_solids: expression of shape {expression.shape}; expected {(count, 64)}")
    head = head_axes(joints) if head is None else np.asarray(head, np.float64)
    crown = joints[:, INDEX["head_top"]]
    height = HEAD_SHARE * np.linalg.norm(crown - joints[:, INDEX["neck"]], axis=1)
    skin = faces.skin(np.repeat(appearance.face[None], count, 0), expression) * (height / faces.HEIGHT)[:, None, None]
    skin = skull_center(crown, head, height)[:, None] + skin @ np.swapaxes(head, 1, 2)
    alike = np.zeros(count, int)
    person = Bodies(
        joints,
        head,
        height,
        skin,
        faces.gaze(expression),
        np.full(count, appearance.girth),
        np.full(count, appearance.female),
    )
    return body_solids(person, appearance.materials[alike])


class Canvas:
    """A picture under work. color (H, W, 3) float32; depth (H, W) float32 metres; part (H, W) uint8, `solids.CODE`."""

    def __init__(self, background):
        scale = 255 if np.asarray(background).dtype == np.uint8 else 1
        self.color = np.ascontiguousarray(background, np.float32) / np.float32(scale)
        self.depth = np.full(self.color.shape[:2], raster.FAR, np.float32)
        self.part = np.zeros(self.color.shape[:2], np.uint8)

    def paint(self, solids, camera, light=LIGHT):
        """Add solids (P, raster.COLUMNS) seen by K (3, 3); what is nearer covers what is farther, in any order."""
        seen = np.asarray(camera, np.float64)[[0, 1, 0, 1], [0, 1, 2, 2]]
        raster.trace(solids, seen, np.asarray(light, np.float64), self.color, self.depth, self.part)

    def picture(self, reach=0.15):
        """(H, W, 3) uint8, with contact shadows up to `reach` metres behind what was painted, edges softened."""
        painted = self.depth[self.depth < raster.FAR]
        color = self.color.copy()
        if painted.size:
            scenes.contact_shadows(color, self.depth, painted.max() + reach)
        color = cv2.GaussianBlur(np.clip(color, 0, 1), (3, 3), 0.55)
        return (color * 255).round().astype(np.uint8)


def draw_person(image, joints, appearance, camera, *, head=None, expression=None, seated=False):
    """A person drawn over an image: (H, W, 3) uint8 RGB and parts (H, W) uint8 (0 where the image shows).

    joints (55 or 61, 3), head (3, 3), expression (64,) of one frame, as in `person_solids`; camera K (3, 3).
    """
    one = lambda x: None if x is None else np.asarray(x)[None]
    solids = person_solids(
        np.asarray(joints)[None], appearance, head=one(head), expression=one(expression), seated=seated
    )
    canvas = Canvas(image)
    canvas.paint(solids[0], camera)
    return canvas.picture(), canvas.part
