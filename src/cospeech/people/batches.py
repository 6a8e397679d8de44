"""Synthetic people as batches: who, in which pose, seen from where, drawn; every label is exact."""

from dataclasses import dataclass

import cv2
import numpy as np

from cospeech.errors import CospeechError
from cospeech.people import faces, views
from cospeech.people.anthropometry import INDEX, draw_build
from cospeech.people.bodies import Bodies, body_solids
from cospeech.people.dice import Dice
from cospeech.people.heads import skull_center
from cospeech.people.painting import raster, scenes
from cospeech.people.painting.materials import draw_materials
from cospeech.people.painting.solids import CODE, THING
from cospeech.people.poses import ARMS, POSTURES, draw_pose, pose_people
from cospeech.posenet.datasets.parts import PARTS as JOINT_SETS
from cospeech.posenet.samples import Batch

DOMAINS = ("studio", "wild")
BLOCK = 64  # people drawn at a time; blocks start at multiples of it, so that chunks never change a number
SEEN = 0.25  # share of the joints that must be visible
SUBJECTS, OUTFITS = 8, 2  # in the studio, as in MPI-INF-3DHP
# Joints that other names stand for: the network's hands are the knuckles of the middle finger.
ALIASES = {"right_hand": "right_middle_0", "left_hand": "left_middle_0"}


@dataclass
class People:
    """A block of N people, all but drawn. points (N, J, 3) metres: the part's joints in the camera's axes."""

    bodies: Bodies
    view: views.View
    points: np.ndarray
    pixels: np.ndarray
    rows: np.ndarray
    lights: np.ndarray
    tags: dict
    dice: Dice

    @property
    def camera(self):
        """(N, 3, 3) K of each crop: `points` projected by it are `pixels`."""
        return self.view.camera


def make_people(count, *, domain="studio", part="body", size=128, margin=1.0, seed=0, start=0):
    """Yield `count` synthetic people, numbers start to start + count - 1, as `Batch`es of at most 64.

    Parameters
    ----------
    domain : "studio" (3D labels) or "wild" (2D labels; the 3D is there for testing, `labelled3d` is False).
    part : "body", "hand" (right hands) or "face". size : side of the pictures in pixels.
    margin : how many times wider than the network's crop the pictures are, as in `store.write_store`.

    Person i is the same, to the byte, whatever else is asked for. Raises CospeechError for an unknown domain or part.
    """
    if domain not in DOMAINS or part not in JOINT_SETS:
        known = f"domains {', '.join(DOMAINS)}; parts {', '.join(JOINT_SETS)}"
        raise CospeechError(f"synthetic people: {domain!r}, {part!r} is unknown; known: {known}")
    cv2.setNumThreads(1)
    first = start
    while first < start + count:
        block = first // BLOCK
        chosen = np.arange(first, min(start + count, (block + 1) * BLOCK)) - block * BLOCK
        yield _block(block, chosen, domain, part, size, margin, seed)
        first += len(chosen)


def _block(block, chosen, domain, part, size, margin, seed):
    """The chosen people (indices) of a block as a `Batch`; who cannot be seen is drawn anew, twice at most."""
    batch = photograph_people(draw_people(block, domain, part, size, margin, seed), chosen, domain, part, size)
    for attempt in (1, 2):
        poor = batch.visible.mean(axis=1) < SEEN
        if poor.any():
            people = draw_people(block, domain, part, size, margin, seed, attempt)
            _put(batch, poor, photograph_people(people, chosen[poor], domain, part, size))
    return batch


def _put(batch, where, other):
    """Overwrite the samples of a batch at `where` (N,) bool, in place."""
    for name in ("images", "joints2d", "visible", "joints3d", "mask"):
        getattr(batch, name)[where] = getattr(other, name)
    for name, values in other.tags.items():
        kind = np.result_type(values, batch.tags[name])  # as long as the longest
        batch.tags[name] = batch.tags[name].astype(kind)
        batch.tags[name][where] = values


def draw_people(block, domain, part, size, margin, seed, attempt=0):
    """The `People` of a block of BLOCK numbers; other ones for every attempt."""
    numbers = np.arange(block * BLOCK, (block + 1) * BLOCK)
    dice = Dice(seed, (domain, part, *["again"] * attempt), numbers)
    build, materials, subject = _who(dice, domain, seed)
    framing = dice.choice([0.5, 0.5]) if part == "body" else np.ones(BLOCK, int)
    pose = draw_pose(dice, presenting=framing == 1, lively_hands=0.7 if part == "hand" else 0.15)
    joints, head = pose_people(build, pose)
    skin, gaze = _faces(dice, build, joints, head)
    points = part_points(part, joints, skin[:, :68])
    target = (points.min(axis=1) + points.max(axis=1)) / 2
    reach = {"body": [[2.2, 1.0], [6.0, 3.2]], "hand": [[0.5], [2.0]], "face": [[0.5], [2.5]]}[part]
    low, high = (np.resize(r, 2)[framing] for r in reach)
    directions = views.draw_directions(dice, part, domain)
    rotation, translation = views.look_at(directions, dice.uniform(low, high), target)
    anchors = views.draw_anchors(dice, part, domain, framing, JOINT_SETS[part].skeleton.names)
    labelled = JOINT_SETS[part].skeleton.joints(*JOINT_SETS[part].heatmaps)
    view = views.crop_view(rotation, translation, points, size, margin, anchors, labelled)
    bodies = Bodies(
        view.see(joints), view.rotation @ head, build.lengths["head"], view.see(skin), gaze, build.girth, build.female
    )
    seated = pose.posture == list(POSTURES).index("sit")
    rows = body_solids(bodies, materials)
    around = [rows, scenes.furniture(dice, joints, view, domain, part, framing, seated)]
    lights = scenes.draw_lights(dice, domain)
    if domain == "wild" and part != "hand":
        around.append(scenes.bystanders(dice, rows, view))
    points = view.see(points)
    tags = {
        "domain": np.full(BLOCK, domain),
        "framing": np.array(views.FRAMINGS)[framing],
        "subject": subject,
        "posture": np.array(list(POSTURES))[pose.posture],
        "activity": np.array(list(ARMS))[pose.arm],
    }
    if part != "body":
        tags["framing"] = np.full(BLOCK, "close")
    return People(bodies, view, points, view.project(points), np.concatenate(around, axis=1), lights, tags, dice)


def _who(dice, domain, seed):
    """Builds, materials and names: in the studio few people in few clothes, in the wild everyone is new."""
    if domain == "wild":
        build = draw_build(dice, children=0.05)
        return build, draw_materials(dice, domain, build.female, build.age), np.full(len(dice), "")
    subject, outfit = dice.choice(np.ones(SUBJECTS)), dice.choice(np.ones(OUTFITS))
    build = draw_build(Dice(seed, ("studio subjects",), range(SUBJECTS)))
    outfits = Dice(seed, ("studio outfits",), range(SUBJECTS * OUTFITS))
    owner = np.repeat(np.arange(SUBJECTS), OUTFITS)
    materials = draw_materials(outfits, domain, build.female[owner], build.age[owner])
    return build[subject], materials[subject * OUTFITS + outfit], np.char.add("studio-", (subject + 1).astype(str))


def _faces(dice, build, joints, head):
    """Points of the skin (N, 97, 3) in the person's axes and gaze (N, 2, 2)."""
    expression = faces.draw_expression(dice)
    local = faces.skin(build.face, expression) * (build.lengths["head"] / faces.HEIGHT)[:, None, None]
    center = skull_center(joints[:, INDEX["head_top"]], head, build.lengths["head"])
    return center[:, None] + local @ head.transpose(0, 2, 1), faces.gaze(expression)


def part_points(part, joints, landmarks):
    """A part's joints (N, J, 3), in the order of its joint set, out of joints (N, 61, 3) and landmarks (N, 68, 3)."""
    if part == "face":
        return landmarks
    names = JOINT_SETS[part].skeleton.names
    names = [f"right_{name}" for name in names] if part == "hand" else [ALIASES.get(name, name) for name in names]
    return joints[:, [INDEX[name] for name in names]]


def photograph_people(people, chosen, domain, part, size):
    """Draw the chosen (indices) of a block: `Batch`."""
    names, heatmaps = JOINT_SETS[part].skeleton, JOINT_SETS[part].heatmaps
    labelled = names.joints(*heatmaps)
    images = np.empty((len(chosen), size, size, 3), np.uint8)
    masks = np.empty((len(chosen), size, size), np.uint8)
    visible = people.view.inside(people.pixels, size)[chosen][:, labelled]
    hidden = np.zeros_like(visible)
    for k, i in enumerate(chosen):
        images[k], depth, parts = _photograph(people, i, domain, size)
        masks[k] = np.where((parts > 0) & (parts < THING), 255, 0)
        hidden[k] = _hidden(people, i, labelled, visible[k], depth, parts, part)
        _outside(people.view.borders[i], images[k], masks[k])
    pixels = people.pixels[chosen][:, labelled]
    inside = visible
    visible = visible & ~hidden
    points = people.points[chosen] - people.points[chosen][:, [names.root]]
    tags = {name: values[chosen] for name, values in people.tags.items()}
    tags["occluded"] = np.where(hidden.any(axis=1), "yes", "no")
    tags["truncated"] = np.where(inside.all(axis=1), "no", "yes")
    return Batch(
        images,
        np.where(visible[..., None], pixels, 0).astype(np.float32),
        visible,
        (points * 1000).astype(np.float32),
        np.full(len(chosen), domain == "studio"),
        masks,
        tags,
    )


def _photograph(people, i, domain, size):
    """Picture uint8, depth and parts of one person."""
    rng = people.dice.generator(i)
    rng = np.random.default_rng(rng.bit_generator.seed_seq.spawn(1)[0])
    camera = people.camera[i]
    color = scenes.background(rng, size, domain)
    depth = np.full((size, size), raster.FAR, np.float32)
    parts = np.zeros((size, size), np.uint8)
    raster.trace(people.rows[i], camera[[0, 1, 0, 1], [0, 1, 2, 2]], people.lights[i], color, depth, parts)
    scenes.contact_shadows(color, depth, people.points[i, :, 2].max() + 0.15)
    return scenes.photograph(rng, color, domain), depth, parts


def _hidden(people, i, labelled, visible, depth, parts, part):
    """(K,) bool: joints of one person behind something else; in close-ups of a hand also behind their own body."""
    u, v = np.clip(np.rint(people.pixels[i, labelled]), 0, len(depth) - 1).astype(int).T
    before = depth[v, u] < people.points[i, labelled, 2] - 0.03
    foreign = parts[v, u] >= THING
    if part == "hand":
        foreign |= ~np.isin(parts[v, u], [CODE["right_hand"], CODE["right_forearm"], 0])
    return visible & before & foreign


def _outside(borders, image, mask):
    """Black, in place, where the picture has ended."""
    size = len(image)
    left, top, right, bottom = np.clip(np.ceil(borders), 0, size).astype(int)
    for array in (image, mask):
        array[:top], array[bottom:], array[:, :left], array[:, right:] = 0, 0, 0, 0
