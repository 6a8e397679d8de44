"""Augmentation: image, 2D and 3D keep telling the same story, and the same seed tells it again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cospeech.posenet import EVALUATED, JOINTS21
from cospeech.posenet.camera import project
from cospeech.posenet.datasets.parts import PARTS
from cospeech.posenet.samples import Batch
from cospeech.posenet.training.augment import augment, center, transform
from tests.posenet import owners

HEATMAPS = JOINTS21.joints(*EVALUATED)
OFF = {"scale": 0.0, "rotate": 0.0, "translate": 0.0, "flip": 0.0, "colour": 0.0}


def crops(count=4, side=160, seed=0, mask=None):
    """(Batch, People): crops whose camera and absolute poses are known."""
    who = owners.people(count, JOINTS21, (side, side), seed=seed)
    relative = who.poses - who.poses[:, JOINTS21.root : JOINTS21.root + 1]
    points = who.points[:, HEATMAPS].astype(np.float32)
    visible = ((points > 0) & (points < side - 1)).all(axis=2)
    tags = {"subject": np.array([f"S{i}" for i in range(count)])}
    return Batch(who.images, points, visible, relative.astype(np.float32), np.ones(count, bool), mask, tags), who


def camera_after(camera, pose, points):
    """The camera K' (square pixels) that projects absolute points (J, 3) onto pixels (J, 2), and how far it is off."""
    x, y = (pose[:, :2] / pose[:, 2:]).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    design = np.concatenate([np.stack([x, one, zero], 1), np.stack([y, zero, one], 1)])
    found, *_ = np.linalg.lstsq(design, points.T.ravel(), rcond=None)
    return found, np.abs(design @ found - points.T.ravel()).max()


@settings(max_examples=40, deadline=None)
@given(
    st.floats(-3.0, 3.0), st.floats(0.5, 2.5), st.floats(-20, 20), st.floats(-20, 20), st.booleans(), st.integers(0, 99)
)
def test_2d_stays_the_projection_of_3d(angle, zoom, dx, dy, flipped, seed):
    """A crop turned, zoomed, shifted or mirrored is that of a camera with another K, and of the pose turned with it."""
    batch, who = crops(1, seed=seed)
    batch.visible[:] = True
    size = 600  # so that nothing leaves the image and all joints can be compared
    moved = transform(batch, size, np.array([zoom]), np.array([angle]), np.array([[dx, dy]]), np.array([flipped]))
    root = who.poses[0, JOINTS21.root] * [-1 if flipped else 1, 1, 1]
    turn = -angle if flipped else angle
    cos, sin = np.cos(turn), np.sin(turn)
    root = root @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])  # the camera turns with the image
    found, error = camera_after(who.camera, (moved.joints3d[0] + root)[HEATMAPS], moved.joints2d[0])
    assert error < 0.02
    assert found[0] == pytest.approx(who.camera[0, 0] / zoom, rel=1e-3)


def test_a_mirror_image_is_the_mirrored_person():
    batch, _ = crops(2)
    no = np.zeros(2)
    side = batch.images.shape[1]
    moved = transform(batch, side, no + 1, no, np.zeros((2, 2)), np.array([False, True]))
    np.testing.assert_allclose(moved.joints3d[0], batch.joints3d[0])
    left, right = JOINTS21.joints("left_wrist", "right_wrist")
    np.testing.assert_allclose(moved.joints3d[1, left], batch.joints3d[1, right] * [-1, 1, 1])
    shoulder, other = EVALUATED.index("left_shoulder"), EVALUATED.index("right_shoulder")
    x, y = batch.joints2d[1, other]
    np.testing.assert_allclose(moved.joints2d[1, shoulder], [side - 1 - x, y], atol=1e-4)
    np.testing.assert_array_equal(moved.images[1], batch.images[1, :, ::-1])


def test_the_pixels_of_a_joint_move_with_it():
    batch, _ = crops(12)
    moved = augment(batch, np.random.default_rng(1), 160, **(OFF | {"rotate": 60, "scale": 0.3, "translate": 0.1}))
    assert moved.visible.mean() > 0.5
    for image, points, visible in zip(moved.images, moved.joints2d, moved.visible, strict=True):
        assert owners.disc_error(image, points, visible) < 40


@pytest.mark.parametrize("size", [160, 64, 32])
def test_an_image_made_smaller_keeps_its_joints_in_place(size):
    batch, _ = crops(3, side=640)
    small = center(batch, size)
    np.testing.assert_allclose((small.joints2d + 0.5) / size, (batch.joints2d + 0.5) / 640, atol=1e-5)
    assert np.abs(small.images.astype(float).mean() - batch.images.mean()) < 1
    x = np.tile(np.arange(640), (640, 1))
    ramp = np.repeat((x * 255 / 639).round()[..., None], 3, axis=2).astype(np.uint8)[None]
    shrunk = center(Batch(ramp, batch.joints2d[:1], batch.visible[:1], batch.joints3d[:1], np.ones(1, bool)), size)
    wanted = ((np.arange(size) + 0.5) * 640 / size - 0.5) * 255 / 639
    np.testing.assert_allclose(shrunk.images[0, size // 2, 1:-1, 0], wanted[1:-1], atol=1.2)


def test_the_margin_is_cut_off():
    batch, _ = crops(2)
    inner = center(batch, 80, margin=2.0)
    np.testing.assert_array_equal(inner.images, batch.images[:, 40:120, 40:120])
    seen = inner.visible
    np.testing.assert_allclose(inner.joints2d[seen], batch.joints2d[seen] - 40, atol=1e-4)
    assert not seen.all() and (inner.joints2d[~seen] == 0).all()


def test_the_same_seed_gives_the_same_bytes_and_another_does_not():
    batch, _ = crops(4, mask=np.zeros((4, 160, 160), np.uint8))
    background = np.random.default_rng(9).integers(0, 255, (3, 90, 120, 3), np.uint8)
    one, two, three = (augment(batch, np.random.default_rng(s), 96, background=background) for s in (5, 5, 6))
    for name in ("images", "joints2d", "visible", "joints3d", "mask"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert (one.images != three.images).any()
    np.testing.assert_array_equal(one.tags["subject"], batch.tags["subject"])


def test_the_background_is_replaced_behind_the_person_only():
    mask = np.zeros((2, 160, 160), np.uint8)
    mask[0, 40:120, 40:120] = 255
    mask[1] = 255  # nothing is known to be background
    batch, _ = crops(2, mask=mask)
    blue = np.full((1, 50, 70, 3), (0, 0, 255), np.uint8)
    new = augment(batch, np.random.default_rng(0), 160, background=blue, replace=1.0, **OFF)
    np.testing.assert_array_equal(new.images[0, 40:120, 40:120], batch.images[0, 40:120, 40:120])
    assert (new.images[0][mask[0] == 0] == (0, 0, 255)).all()
    np.testing.assert_array_equal(new.images[1], batch.images[1])
    never = augment(batch, np.random.default_rng(0), 160, background=blue, replace=0.0, **OFF)
    np.testing.assert_array_equal(never.images, batch.images)


def test_colours_change_and_labels_do_not():
    batch, _ = crops(3)
    new = augment(batch, np.random.default_rng(0), 160, **(OFF | {"colour": 0.3}))
    np.testing.assert_allclose(new.joints2d, np.where(batch.visible[..., None], batch.joints2d, 0), atol=1e-4)
    np.testing.assert_allclose(new.joints3d, batch.joints3d)
    for before, after in zip(batch.images, new.images, strict=True):
        assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.8 and (before != after).any()


def test_hands_are_never_mirrored_and_faces_are():
    rng = np.random.default_rng(0)
    for part, mirrored in (("hand", False), ("face", True)):
        joints = len(PARTS[part].skeleton)
        points = rng.uniform(10, 80, (6, joints, 2)).astype(np.float32)
        empty = Batch(
            np.zeros((6, 96, 96, 3), np.uint8),
            points,
            np.ones((6, joints), bool),
            np.zeros((6, joints, 3), np.float32),
            np.zeros(6, bool),
        )
        new = augment(empty, rng, 96, part=part, **(OFF | {"flip": 1.0}))
        order = PARTS[part].skeleton.mirror if mirrored else np.arange(joints)
        x = points[:, order, 0]
        np.testing.assert_allclose(new.joints2d[..., 0], 95 - x if mirrored else x, atol=1e-4)


def test_projection_of_the_fixture_is_exact():
    batch, who = crops(2)
    np.testing.assert_allclose(project(who.poses, who.camera)[:, HEATMAPS], batch.joints2d, atol=1e-3)
