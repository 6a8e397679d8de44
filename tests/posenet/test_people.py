"""Synthetic people as data: labels against the camera, the picture and the tables; bytes against other requests."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.people import make_people
from cospeech.people.batches import BLOCK, SEEN, _photograph, draw_people, photograph_people
from cospeech.people.painting.solids import BYSTANDER, CODE, THING
from cospeech.posenet import JOINTS21
from cospeech.posenet.camera import camera_matrix, person_crop, project
from cospeech.posenet.datasets.parts import PARTS

CASES = [(domain, part) for domain in ("studio", "wild") for part in ("body", "hand", "face")]
SIZE = 96


@pytest.fixture(scope="module")
def crowd():
    """{(domain, part): (the block's People, one Batch of all 64)}."""
    people = {case: draw_people(0, *case, SIZE, 1.0, 0) for case in CASES}
    return {case: (block, photograph_people(block, np.arange(BLOCK), *case, SIZE)) for case, block in people.items()}


@pytest.mark.parametrize("case", CASES)
def test_labels_are_the_projection_of_the_3d_joints(crowd, case):
    people, batch = crowd[case]
    part = PARTS[case[1]]
    root = people.points[:, [part.skeleton.root]]
    assert np.abs(batch.joints3d - 1000 * (people.points - root)).max() < 0.01  # mm, relative to the root
    x, y, z = np.moveaxis(batch.joints3d.astype(float) / 1000 + root, 2, 0)
    k = people.camera
    u, v = k[:, :1, 0] * x / z + k[:, :1, 2], k[:, 1:2, 1] * y / z + k[:, 1:2, 2]
    pixels = np.stack([u, v], axis=2)[:, part.skeleton.joints(*part.heatmaps)]
    seen = batch.visible
    assert seen.mean() > 0.5
    assert np.abs(pixels - batch.joints2d)[seen].max() < 1e-3
    assert (batch.joints2d[~seen] == 0).all()
    assert k[:, 0, 0] == pytest.approx(k[:, 1, 1])  # square pixels


@pytest.mark.parametrize("case", CASES)
def test_a_batch_is_what_the_interface_says(crowd, case):
    batch, part = crowd[case][1], PARTS[case[1]]
    joints, labelled = len(part.skeleton), len(part.heatmaps)
    assert batch.images.shape == (BLOCK, SIZE, SIZE, 3) and batch.images.dtype == np.uint8
    assert batch.joints2d.shape == (BLOCK, labelled, 2) and batch.joints3d.shape == (BLOCK, joints, 3)
    assert (batch.labelled3d == (case[0] == "studio")).all()
    assert set(batch.tags["domain"]) == {case[0]}
    assert np.abs(batch.joints3d[:, part.skeleton.root]).max() == 0
    share = (batch.mask > 0).mean(axis=(1, 2))
    assert np.median(share) > 0.1  # a person fills a good part of their crop


def test_joints_lie_inside_the_limb_that_is_drawn_there(crowd):
    """At the pixel of a joint the picture shows the person, no deeper than the joint; if close to it, its own limb."""
    people, batch = crowd["studio", "body"]
    own = {
        "elbow": ("upper_arm", "forearm"),
        "wrist": ("forearm", "hand"),
        "knee": ("thigh", "shank"),
        "ankle": ("shank", "foot"),
    }
    labelled, checked, right = JOINTS21.joints(*PARTS["body"].heatmaps), 0, 0
    for i in range(24):
        _, depth, parts = _photograph(people, i, "studio", SIZE)
        u, v = np.rint(batch.joints2d[i]).astype(int).T
        for k, joint in enumerate(labelled):
            if not batch.visible[i, k]:
                continue
            z = people.points[i, joint, 2]
            if JOINTS21.names[joint] == "head_top":  # on the skull's outline
                assert (parts[max(v[k] - 1, 0) : v[k] + 3, max(u[k] - 1, 0) : u[k] + 2] > 0).any()
                continue
            assert 0 < parts[v[k], u[k]] < THING, (i, JOINTS21.names[joint])
            assert depth[v[k], u[k]] < z + 0.03
            side, _, name = JOINTS21.names[joint].partition("_")
            if name in own and z - depth[v[k], u[k]] < 0.07:
                checked += 1
                right += parts[v[k], u[k]] in {CODE[f"{side}_{limb}"] for limb in own[name]}
    assert checked > 80 and right / checked > 0.93  # hands may rest on a wrist or a thigh


def test_left_is_left(crowd):
    """Who faces the camera (their nose is nearer than their ears) has the left shoulder on the picture's right."""
    for domain in ("studio", "wild"):
        people, _ = crowd[domain, "body"]
        skin, j = people.bodies.skin, people.bodies.joint
        nearer = (skin[:, 0, 2] + skin[:, 16, 2]) / 2 - skin[:, 30, 2]
        across = j("left_shoulder")[:, 0] - j("right_shoulder")[:, 0]
        facing, back = nearer > 0.07, nearer < -0.07
        assert facing.sum() > 30 and (across[facing] > 0).mean() > 0.97
        assert (across[back] < 0.1).all()
        ears = skin[:, 16, 0] - skin[:, 0, 0]  # the left one, then the right one
        assert (ears[facing] > 0).all() and (ears[back] < 0).all()


def test_other_people_stand_behind_some_in_the_wild(crowd):
    people, _ = crowd["wild", "body"]
    seen = [BYSTANDER in _photograph(people, i, "wild", SIZE)[2] for i in range(BLOCK)]
    assert 0.05 < np.mean(seen) < 0.35


def test_what_is_out_of_the_picture_or_hidden_is_not_labelled(crowd):
    people, batch = crowd["wild", "body"]
    heatmaps = list(PARTS["body"].heatmaps)
    pixels = people.pixels[:, JOINTS21.joints(*heatmaps)]
    inside = people.view.inside(pixels, SIZE)
    assert not (batch.visible & ~inside).any()
    assert (inside & ~batch.visible).sum() > 10  # hidden by desks, posts, boxes
    assert ((inside & ~batch.visible).any(axis=1) == (batch.tags["occluded"] == "yes")).all()
    upper = batch.tags["framing"] == "upper"
    assert not batch.visible[upper][:, heatmaps.index("left_ankle")].any()
    assert batch.visible[~upper][:, heatmaps.index("left_ankle")].mean() > 0.6
    assert batch.visible[:, heatmaps.index("head_top")].mean() > 0.85
    below = people.view.borders[:, 3]
    for i in np.flatnonzero(below < SIZE - 2):
        assert (batch.images[i, int(np.ceil(below[i])) :] == 0).all()


def test_the_two_domains_look_different(crowd):
    """Behind the people there is much more to see in the wild, and light varies more."""
    clutter, light = {}, {}
    for domain in ("studio", "wild"):
        batch = crowd[domain, "body"][1]
        gray = batch.images.astype(float).mean(axis=3)
        apart = np.abs(gray[:, 8:, 8:] - gray[:, :-8, :-8])  # pixels 11 apart: things, not grain
        behind = batch.mask[:, 8:, 8:] == 0
        clutter[domain] = np.median([a[b].mean() for a, b in zip(apart, behind, strict=True)])
        person = np.array([image[mask > 0].mean(axis=0) for image, mask in zip(batch.images, batch.mask, strict=True)])
        light[domain] = np.log(person.mean(axis=1)).std()
    assert clutter["wild"] > 1.6 * clutter["studio"]
    assert light["wild"] > 1.3 * light["studio"]


def test_the_studio_has_few_people_and_the_wild_has_many(crowd):
    assert 4 < len(set(crowd["studio", "body"][1].tags["subject"])) <= 8
    lengths = {}
    for domain in ("studio", "wild"):
        pose = crowd[domain, "body"][1].joints3d
        knee, ankle = JOINTS21.joints("left_knee", "left_ankle")
        lengths[domain] = np.linalg.norm(pose[:, knee] - pose[:, ankle], axis=1).round(1)
    assert len(set(lengths["studio"])) <= 8 < 50 < len(set(lengths["wild"]))


@pytest.mark.parametrize("domain", ["studio", "wild"])
def test_a_person_is_the_same_to_the_byte_whatever_else_is_asked_for(domain):
    def ask(count, start, **more):
        batches = list(make_people(count, domain=domain, size=48, start=start, **more))
        assert max(map(len, batches)) <= BLOCK
        names = ("images", "joints2d", "visible", "joints3d", "mask")
        return {name: np.concatenate([getattr(b, name) for b in batches]) for name in names}

    whole = ask(12, 58)  # crosses the blocks' border at 64
    parts = [ask(5, 58), ask(3, 63), ask(4, 66)]
    for name, array in whole.items():
        assert array.tobytes() == np.concatenate([p[name] for p in parts]).tobytes(), name
    assert (ask(12, 58, seed=1)["images"] != whole["images"]).mean() > 0.5


@pytest.mark.parametrize("part", ["body", "hand", "face"])
def test_the_crop_is_the_one_that_data_sets_are_cut_with(crowd, part):
    """`person_crop` around the labelled joints, in a camera turned away by some degrees, finds the same crop."""
    people, _ = crowd["studio", part]
    labelled = PARTS[part].skeleton.joints(*PARTS[part].heatmaps)
    away = Rotation.from_euler("YX", [9, -6], degrees=True).as_matrix()
    k = camera_matrix(1100, 1280, 960)
    for i in np.flatnonzero((np.abs(people.view.borders) > 1e4).all(axis=1))[:10]:  # nowhere near the picture's end
        points = people.points[i] @ away.T
        crop = person_crop(project(points[labelled], k), k, size=SIZE)
        span = np.ptp(people.pixels[i, labelled], axis=0).max()
        assert span * 1.25 == pytest.approx(SIZE, rel=1e-6)
        seen = ((crop.points(project(points, k)) + 1) * SIZE - 1) / 2
        assert np.abs(seen - people.pixels[i]).max() < 0.2  # pixels; the box's centre is off the axis a little


@pytest.mark.parametrize("part", ["body", "hand", "face"])
def test_nobody_is_hidden(crowd, part):
    """Who cannot be seen is drawn anew, and only they."""
    _, first = crowd["wild", part]
    batches = list(make_people(3 * BLOCK, domain="wild", part=part, size=SIZE))
    assert all((b.visible.mean(axis=1) >= SEEN).all() and (b.mask > 0).any(axis=(1, 2)).all() for b in batches)
    kept = first.visible.mean(axis=1) >= SEEN
    assert batches[0].images[kept].tobytes() == first.images[kept].tobytes()
    assert (batches[0].joints3d[~kept] != first.joints3d[~kept]).any(axis=(1, 2)).all()


def test_margin_leaves_room_around_the_same_person():
    tight, loose = (next(make_people(8, size=96, margin=m)) for m in (1.0, 1.5))
    both = tight.visible & loose.visible
    span = [
        np.linalg.norm((b.joints2d[:, 1] - b.joints2d[:, 8])[both[:, 1] & both[:, 8]], axis=1) for b in (tight, loose)
    ]
    assert span[0] / span[1] == pytest.approx(1.5, rel=1e-4)
    assert np.abs(tight.joints3d - loose.joints3d).max() < 1e-3


def test_unknown_names_are_refused_in_one_line():
    with pytest.raises(CospeechError, match="known: domains studio, wild; parts body, hand, face"):
        next(make_people(1, domain="outdoor"))
