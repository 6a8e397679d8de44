"""The drawn figure: geometry against OpenCV's camera and closed forms, and what a viewer must be able to see."""

import cv2
import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.face.expressions import COSPEECH64
from cospeech.face.model import FaceModel, embedded
from cospeech.render.character.figure import BACKGROUND, Character, framing
from cospeech.render.character.head import Head, face_of
from cospeech.render.character.mesh import capsule_template, capsules
from cospeech.render.character.triangles import SAMPLES, Camera, Painter
from cospeech.skeleton import UPPER55

WIDTH, HEIGHT = 480, 270
IRIS = (75, 55, 30), (130, 100, 70)  # from, to: blue, green, red in any light


def drawn(clip, frame=0, camera=None, **changes):
    """The picture (H, W, 3) of one frame, and its mesh; `changes` replace rotation or expression."""
    face, known = face_of(clip)
    figure = Character(clip.positions, face)
    camera = camera or framing([figure], [clip.positions], WIDTH, HEIGHT)
    part = slice(frame, frame + 1)
    rotation = changes.get("rotation", None if clip.rotation is None else clip.rotation[part])
    expression = changes.get("expression", None if known is None else known[part])
    points, bright = figure.pose(clip.positions[part], rotation, expression)
    picture = np.full((camera.height, camera.width, 3), BACKGROUND, np.uint8)
    Painter(camera).draw(picture, points[0], bright[0], figure.triangles, figure.colors)
    return picture, points[0]


def close_up(clip):
    """A camera on the head."""
    place = clip.positions[0, UPPER55.index["head"]]
    return Camera(tuple(place), 4.0, 3600.0, 0.0, 300, 300)


def face(**coefficients):
    expression = np.zeros((1, len(COSPEECH64)), np.float32)
    for name, value in coefficients.items():
        expression[0, COSPEECH64.index(name)] = value
    return expression


def count(picture, low, high):
    """Pixels whose blue, green and red all lie between low and high."""
    return int(((picture >= low) & (picture <= high)).all(-1).sum())


def test_camera_agrees_with_opencv():
    camera = Camera((0.1, 0.2, 0.0), 2.5, 700.0, 0.2, WIDTH, HEIGHT)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    flip = np.diag([1.0, -1.0, -1.0])  # OpenCV's y runs down and its z away from the viewer
    rotation = flip @ camera.axes
    translation = -rotation @ np.array(camera.target) + [0, 0, camera.distance]
    matrix = np.array([[camera.focal, 0, WIDTH / 2], [0, camera.focal, HEIGHT / 2], [0, 0, 1]])
    expected, _ = cv2.projectPoints(points, cv2.Rodrigues(rotation)[0], translation, matrix, None)
    np.testing.assert_allclose(camera.project(points)[:, :2], expected[:, 0], atol=0.01)


def ball(place, radius, sides=48):
    template = capsule_template(sides)
    ends = np.float32(place)[None, None], np.float32(place)[None, None] + np.float32([0, 0, 1e-4])
    points, _ = capsules(*ends, [radius], [radius], template)
    return points[0].astype(np.float32), template[2]


def lit(points):
    return np.ones(len(points), np.float32)


def plain(triangles, value):
    return np.full(triangles.shape, value, np.float32)


def test_a_ball_covers_its_solid_angle():
    camera = Camera((0, 0, 0), 12.0, 2400.0, 0.0, 400, 400)
    points, triangles = ball((0, 0, 0), 0.5)
    painter = Painter(camera)
    painter.draw(np.zeros((400, 400, 3), np.uint8), points, lit(points), triangles, plain(triangles, 200))
    radius = 2400 * np.tan(np.arcsin(0.5 / 12.0)) * SAMPLES
    polygon = 48 / 2 * np.sin(2 * np.pi / 48) / np.pi  # of 48 corners, against the full circle
    assert (painter.samples > 0).sum() == pytest.approx(np.pi * radius**2 * polygon, rel=0.01)


def test_nearer_hides_farther_whatever_the_order():
    camera = Camera((0, 0, 0), 4.0, 400.0, 0.0, 200, 200)
    near, faces = ball((0, 0, 0.5), 0.2)
    far, _ = ball((0, 0, -0.5), 0.4)
    colors = np.repeat(np.float32([[10, 10, 250], [250, 10, 10]]), len(faces), 0)
    pictures = []
    for order in (1, -1):
        picture = np.zeros((200, 200, 3), np.uint8)
        points, both = np.concatenate([near, far][::order]), np.concatenate([faces, faces + len(near)])
        Painter(camera).draw(picture, points, lit(points), both, np.ascontiguousarray(colors[::order]))
        pictures.append(picture)
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1)
    assert pictures[0][100, 100].argmax() == 2 and pictures[0][100, 127].argmax() == 0


def test_what_leaves_the_picture_is_cut_off():
    camera = Camera((0, 0, 0), 2.0, 400.0, 0.0, 64, 64)
    points, triangles = ball((0, 0, 0), 0.9)
    picture = np.zeros((64, 64, 3), np.uint8)
    Painter(camera).draw(picture, points, lit(points), triangles, plain(triangles, 99))
    assert (picture == 99).all()
    outside = np.zeros((64, 64, 3), np.uint8)
    Painter(camera).draw(outside, points + np.float32([9, 0, 0]), lit(points), triangles, plain(triangles, 99))
    assert not outside.any()


def test_every_joint_of_every_frame_is_in_the_picture(make_clip):
    clip = make_clip()
    clip.positions[7, UPPER55.joints("left_middle_3")] = [0.8, 0.9, 0.3]
    figure = Character(clip.positions)
    pixels = framing([figure], [clip.positions], WIDTH, HEIGHT).project(clip.positions)
    assert (pixels[..., :2] > 0).all() and (pixels[..., 0] < WIDTH).all() and (pixels[..., 1] < HEIGHT).all()


def test_left_and_right_tell_apart(make_clip):
    """The character's left is on the picture's right, and cool; its right is warm."""
    picture, _ = drawn(make_clip(face=False))
    warm = picture[..., 2].astype(int) - picture[..., 0] > 60
    cool = picture[..., 0].astype(int) - picture[..., 2] > 60
    assert np.argwhere(warm)[:, 1].mean() < WIDTH / 2 - 20 and np.argwhere(cool)[:, 1].mean() > WIDTH / 2 + 20


def test_mirrored_motion_gives_the_mirrored_outline(make_clip):
    clip = make_clip(face=False)
    twin = make_clip(face=False)
    twin.positions = (clip.positions * np.float32([-1, 1, 1]))[:, UPPER55.mirror]
    masks = []
    for each in (clip, twin):
        figure = Character(each.positions)
        painter = Painter(framing([figure], [clip.positions], WIDTH, HEIGHT))
        picture = np.full((HEIGHT, WIDTH, 3), BACKGROUND, np.uint8)
        points, _ = figure.pose(each.positions[3:4])
        painter.draw(picture, points[0], 0 * lit(points[0]), figure.triangles, figure.colors)
        masks.append((picture == 0).all(-1))
    assert (masks[0] != masks[1][:, ::-1]).sum() < 0.02 * masks[0].sum()


def test_jaw_opens_the_mouth_and_blinking_closes_the_eyes(make_clip):
    clip = make_clip()
    camera = close_up(clip)
    rest, _ = drawn(clip, camera=camera, expression=face())
    wide, _ = drawn(clip, camera=camera, expression=face(jaw_open=1.0))
    shut, _ = drawn(clip, camera=camera, expression=face(eye_blink_left=1.0, eye_blink_right=1.0))
    inside = (20, 14, 34), (48, 38, 80)  # the dark of the mouth
    assert count(wide[150:], *inside) > 3 * count(rest[150:], *inside) + 150
    assert count(rest[:150], *IRIS) > 40 and count(shut[:150], *IRIS) < 0.1 * count(rest[:150], *IRIS)


SEEN = (
    "mouth_pucker",
    "mouth_stretch_left",
    "mouth_smile_left",
    "mouth_frown_left",
    "brow_inner_up",
    "brow_down_right",
    "eye_wide_left",
    "eye_look_up_left",
)


@pytest.mark.parametrize("name", SEEN)
def test_each_of_these_coefficients_is_seen(make_clip, name):
    clip = make_clip()
    camera = close_up(clip)
    rest, _ = drawn(clip, camera=camera, expression=face())
    moved, _ = drawn(clip, camera=camera, expression=face(**{name: 1.0}))
    assert (np.abs(rest.astype(int) - moved).max(-1) > 25).sum() > 15


def test_head_turns_with_its_rotation_and_else_with_the_body(make_clip):
    clip = make_clip()
    camera = close_up(clip)

    def eyes(**changes):
        picture, _ = drawn(clip, camera=camera, expression=face(), **changes)
        iris = ((picture >= IRIS[0]) & (picture <= IRIS[1])).all(-1)
        return np.argwhere(iris[:190])[:, ::-1].mean(0)

    front = eyes()
    assert eyes(rotation=np.array([[0, 0.5, 0]]))[0] > front[0] + 8  # towards its own left: right in the picture
    assert eyes(rotation=np.array([[0.3, 0, 0]]))[1] > front[1] + 5  # nodding lowers them
    np.testing.assert_allclose(eyes(rotation=None), front, atol=2)


def test_unknown_face_model_gives_a_neutral_face(make_clip):
    clip = make_clip()
    neutral, _ = drawn(clip, expression=face())
    clip.face_model, clip.expression = "someone_elses", np.random.default_rng(0).normal(size=(30, 7))
    other, _ = drawn(clip)
    np.testing.assert_array_equal(other, neutral)
    faceless, _ = drawn(make_clip(face=False), rotation=clip.rotation[:1])
    np.testing.assert_array_equal(faceless, neutral)


def test_the_head_moves_as_the_face_model_says():
    """Every vertex of the fitted face model, and lips, lids and brows that are drawn along its landmarks."""
    model, head = embedded(), Head(embedded(), (200, 200, 200))
    rng = np.random.default_rng(4)
    expression = rng.uniform(0, 1, (5, 64))
    moved = head.shape(5, expression) - head.mean
    np.testing.assert_allclose(moved[:, : len(model.mean)], model.vertices(expression) - model.mean, atol=2e-6)
    drawn_lines = np.flatnonzero(np.abs(head.basis).sum(0).reshape(-1, 3).sum(1)) >= len(model.mean)
    assert drawn_lines.sum() > 200
    lips = model.mean[model.landmarks[48:60]]
    nearest = np.linalg.norm(head.mean[None, len(model.mean) :] - lips[:, None], axis=-1).min(1)
    assert nearest.max() < 0.003  # the drawn lips pass by all landmarks of the mouth


def test_a_head_is_closed_all_around(make_clip):
    """From any side and height nothing behind the head is seen through it."""
    clip = make_clip()
    figure = Character(clip.positions)
    points, _ = figure.pose(clip.positions[:1], clip.rotation[:1])
    first = len(points[0]) - len(figure.props) - len(figure.head.mean)
    head = slice(first, first + len(figure.head.mean))
    middle = points[0, head].mean(0)
    camera = Camera((0, 0, 0), 4.0, 3600.0, 0.0, 300, 300)
    for yaw in np.arange(0, 2 * np.pi, np.pi / 6):
        turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]], np.float32)
        painter = Painter(camera)
        seen = (points[0] - middle) @ turn.T
        painter.draw(np.zeros((300, 300, 3), np.uint8), seen, lit(seen), figure.triangles, figure.colors)
        mask = (painter.samples > 0).astype(np.uint8)
        holes = cv2.connectedComponentsWithStats(1 - np.pad(mask, 1), connectivity=4)[2]
        assert holes[2:, cv2.CC_STAT_AREA].sum() < 80, f"{np.degrees(yaw):.0f} degrees"


def other_model(path, count=12):
    """A face model of someone else: the embedded face, whose first coefficient alone opens the mouth."""
    model = embedded()
    basis = np.zeros((*model.mean.shape, count))
    basis[..., 0] = model.expression[..., COSPEECH64.index("jaw_open")]
    moved = model.mean + np.array([0, 0.3, 0])
    FaceModel("someone_elses", moved, model.identity, basis, model.triangles, model.landmarks, model.lips).write(path)


def test_a_face_model_of_the_users_own_moves_the_face(make_clip, tmp_path):
    other_model(tmp_path / "face.h5")
    clip, expected = make_clip(), make_clip()
    clip.face_model, clip.expression = "someone_elses", np.zeros((30, 12), np.float32)
    clip.expression[:, 0] = 0.7
    theirs, expression = face_of(clip, tmp_path / "face.h5")
    head, own = Head(theirs, (200, 200, 200)), Head(embedded(), (200, 200, 200))
    opened = head.shape(1, expression[:1])[0, theirs.landmarks] - own.shape(1, face(jaw_open=0.7))[0, theirs.landmarks]
    np.testing.assert_allclose(opened[48:], 0, atol=2e-3)  # its eyes are where ours are, so all of it is
    with pytest.raises(CospeechError, match=r"has 64 expression coefficients.*'cospeech64'.*someone_elses has 12"):
        face_of(expected, tmp_path / "face.h5")


@pytest.mark.parametrize("posture", ["standing", "sitting"])
def test_legs_stand_on_the_floor_and_are_seen_whole(make_clip, posture):
    clip = make_clip()
    figure = Character(clip.positions, posture=posture)
    points, _ = figure.pose(clip.positions[:2])
    floor = figure.props[:, 1].min()
    assert points[..., 1].min() == pytest.approx(floor, abs=1e-6)
    joints, _ = figure.skeleton(clip.positions[:2])
    for side in ("left", "right"):
        ankle = joints[f"{side}_ankle"]
        assert floor + 0.05 < ankle[0, 1] < floor + 0.15 and (ankle[0] == ankle[1]).all()
    pixels = framing([figure], [clip.positions], WIDTH, HEIGHT, whole=True).project(points)
    assert (pixels[..., :2] > 0).all() and (pixels[..., 0] < WIDTH).all() and (pixels[..., 1] < HEIGHT).all()


def test_a_posture_that_is_none_is_named(make_clip):
    with pytest.raises(CospeechError, match="'kneeling'; expected standing, sitting or none"):
        Character(make_clip().positions, posture="kneeling")
    assert len(Character(make_clip().positions, posture="none").props) == 0


def test_mesh_follows_the_scale_of_the_skeleton(make_clip):
    clip, giant = make_clip(), make_clip()
    giant.positions = giant.positions * 1.7
    _, points = drawn(clip)
    _, large = drawn(giant)
    np.testing.assert_allclose(large, points * 1.7, atol=2e-3)
