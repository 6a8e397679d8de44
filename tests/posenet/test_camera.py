"""The virtual camera of a crop: a perfect network behind it must come out perfect."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.posenet import JOINTS17, camera
from cospeech.posenet.evaluation import pose_metrics as metrics
from cospeech.skeleton import from_parent_relative

K = camera.camera_matrix(1499.2, 2048, 2048)  # of test sequences 1 to 4
seeds = st.integers(0, 10**6)
few = settings(max_examples=30, deadline=None)


def person(degrees, seed=0, height=0.0, distance=4000.0):
    """A person (17, 3) mm in the camera frame, `degrees` to the right of the optical axis and `height` mm below it."""
    rng = np.random.default_rng(seed)
    pose = from_parent_relative(rng.normal(0, 140, (len(JOINTS17), 3)), JOINTS17)
    angle = np.radians(degrees)
    return pose - pose[JOINTS17.root] + [distance * np.sin(angle), height, distance * np.cos(angle)]


def relative(pose):
    return pose - pose[JOINTS17.root]


# ---- perspective correction -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("correction", ["yaw", "full"])
def test_a_perfect_prediction_25_degrees_off_axis_comes_back_to_zero(correction):
    pose = person(25.0)
    pixels = camera.project(pose, K)
    crop = camera.person_crop(pixels, K, correction=correction, toward=pixels[JOINTS17.root])
    predicted = crop.targets(relative(pose))  # what a perfect network says, in the virtual camera's frame
    truth = relative(pose)[None]
    assert metrics.mpjpe(crop.poses(predicted)[None], truth) < 1e-6
    assert metrics.mpjpe(predicted[None], truth) > 50  # left uncorrected it is far off
    assert metrics.official(crop.poses(predicted)[None], truth)["PCK"] == 100


def test_targets_are_the_pose_as_a_camera_that_faces_the_person_sees_it():
    straight_ahead, aside = person(0.0, seed=2), person(25.0, seed=2)
    turn = Rotation.from_euler("y", 25.0, degrees=True).as_matrix()
    turned = relative(straight_ahead) @ turn.T + aside[JOINTS17.root]  # the same person, turned to face the camera
    pixels = camera.project(turned, K)
    for correction in ("yaw", "full"):
        crop = camera.person_crop(pixels, K, correction=correction, toward=pixels[JOINTS17.root])
        np.testing.assert_allclose(crop.targets(relative(turned)), relative(straight_ahead), atol=1e-6)


def test_yaw_is_the_official_angle():
    pixel = np.array([1600.0, 300.0])
    theta = np.arctan((1600 - 1024) / 1499.2)
    expected = Rotation.from_euler("y", theta).as_matrix()
    np.testing.assert_allclose(camera.virtual_rotation(pixel, K, "yaw"), expected, atol=1e-12)


@few
@given(u=st.floats(-500, 2500), v=st.floats(-500, 2500))
def test_full_rotation_meets_the_ray_and_keeps_x_level(u, v):
    rotation = camera.virtual_rotation(np.array([u, v]), K)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(camera.from_homogeneous(K @ rotation[:, 2]), [u, v], atol=1e-6)
    assert rotation[1, 0] == 0 and rotation[1, 1] > 0


def test_rotations_and_poses_may_be_batches():
    centers = np.array([[100.0, 200.0], [1024.0, 1024.0], [1900.0, 50.0]])
    rotations = camera.virtual_rotation(centers, K)
    poses = np.random.default_rng(0).normal(size=(3, 17, 3))
    virtual = camera.to_virtual(poses, rotations)
    for i in range(3):
        np.testing.assert_allclose(virtual[i], poses[i] @ camera.virtual_rotation(centers[i], K))
    np.testing.assert_allclose(camera.from_virtual(virtual, rotations), poses)
    np.testing.assert_allclose(virtual[1], poses[1])  # at the principal point nothing turns


# ---- crops ----------------------------------------------------------------------------------------------------------


@few
@given(seed=seeds, degrees=st.floats(-28, 28), height=st.floats(-1500, 1500))
def test_a_full_crop_shows_what_its_virtual_camera_would_see(seed, degrees, height):
    pose = person(degrees, seed, height)
    pixels = camera.project(pose, K)
    crop = camera.person_crop(pixels, K, size=128)
    seen = crop.points(pixels)
    virtual = camera.from_homogeneous(camera.to_virtual(pose, crop.rotation))  # normalized image plane
    fit = [np.polyfit(virtual[:, axis], seen[:, axis], 1) for axis in (0, 1)]
    for axis in (0, 1):
        np.testing.assert_allclose(np.polyval(fit[axis], virtual[:, axis]), seen[:, axis], atol=1e-8)
    assert fit[0][0] == pytest.approx(fit[1][0])  # square pixels
    assert np.abs(seen).max() == pytest.approx(1 / camera.DEFAULT_MARGIN)  # tight, and centred on the larger side


@pytest.mark.parametrize("correction", camera.CORRECTIONS)
def test_points_and_pixels_are_inverse_and_mean_the_image(correction):
    pixels = camera.project(person(20.0, 3, 900.0), K)
    crop = camera.person_crop(pixels, K, correction=correction)
    np.testing.assert_allclose(crop.pixels(crop.points(pixels)), pixels, atol=1e-8)
    assert np.abs(crop.points(pixels)).max() <= 1 / camera.DEFAULT_MARGIN + 1e-9


@pytest.mark.parametrize("correction", camera.CORRECTIONS)
@pytest.mark.parametrize("size", [64, 256])
def test_a_mark_in_the_image_is_found_where_points_says(correction, size):
    """The image itself is cut as the coordinates are, whether it grows or shrinks."""
    pixels = camera.project(person(20.0, 3, 900.0), K)
    crop = camera.person_crop(pixels, K, size=size, correction=correction)
    joint = pixels[JOINTS17.joints("left_ankle")[0]]
    y, x = np.mgrid[0:2048, 0:2048]
    spread = 1.5 * crop.scale
    image = (255 * np.exp(-((x - joint[0]) ** 2 + (y - joint[1]) ** 2) / (2 * spread**2))).astype(np.float32)
    cut = crop.image(np.stack([image] * 3, axis=-1))
    assert cut.shape == (size, size, 3)
    row, column = np.mgrid[0:size, 0:size]
    found = np.array([(cut[..., 0] * column).sum(), (cut[..., 0] * row).sum()]) / cut[..., 0].sum()
    expected = (crop.points(joint) * size + size - 1) / 2
    np.testing.assert_allclose(found, expected, atol=0.15)


def test_a_shrunken_crop_averages_instead_of_sampling():
    checks = (np.indices((512, 512)).sum(axis=0) % 2 * 255).astype(np.uint8)[..., None].repeat(3, axis=-1)
    crop = camera.person_crop([[20, 20], [490, 490]], camera.camera_matrix(500, 512, 512), 64, correction="none")
    inside = crop.image(checks)[16:48, 16:48]
    assert np.abs(inside.astype(float) - 127.5).max() < 30


@pytest.mark.parametrize("joints", [np.zeros((0, 2)), np.full((5, 2), 7.0)])
def test_a_person_without_extent_is_refused(joints):
    with pytest.raises(CospeechError, match="leave this person out"):
        camera.person_crop(joints, K)


def test_unknown_correction_is_refused_by_name():
    with pytest.raises(CospeechError, match="'pitch'"):
        camera.virtual_rotation(np.zeros(2), K, "pitch")


# ---- weak perspective -----------------------------------------------------------------------------------------------


def test_weak_perspective_is_equation_3_2():
    points = np.array([[[1.0, 2.0, 9.0], [-1.0, 0.5, 7.0]]])
    image = camera.weak_perspective(points, np.array([[2.0, 3.0, 0.1, -0.2]]))
    np.testing.assert_allclose(image, [[[2.1, 5.8], [-1.9, 1.3]]])


@few
@given(seed=seeds)
def test_fitted_weak_perspective_recovers_the_camera_from_the_visible_joints(seed):
    rng = np.random.default_rng(seed)
    points, truth = rng.normal(size=(17, 3)), rng.normal(size=4)
    visible = np.arange(17) < 9
    image = np.where(visible[:, None], camera.weak_perspective(points, truth), 1e6)
    np.testing.assert_allclose(camera.fit_weak_perspective(points, image, visible), truth, atol=1e-9)


def test_a_camera_cannot_be_fitted_to_one_joint():
    with pytest.raises(CospeechError, match="span no area"):
        camera.fit_weak_perspective(np.ones((3, 3)), np.ones((3, 2)), [True, False, False])
