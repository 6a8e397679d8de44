"""The painter against closed forms and brute force, and drawing given joints over a picture."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError
from cospeech.people import Canvas, draw_appearance, draw_person, person_solids
from cospeech.people.anthropometry import INDEX, draw_build
from cospeech.people.dice import Dice
from cospeech.people.painting import raster
from cospeech.people.painting.painter import head_axes
from cospeech.people.painting.solids import CODE, Solids
from cospeech.people.poses import draw_pose, pose_people

K = np.array([[120.0, 0, 40], [0, 120.0, 32], [0, 0, 1]])
LIGHT = np.array([0, 0, -1.0, 0.5, 0.5, 0.0])


def painted(add, light=LIGHT):
    """The canvas after adding solids of one figure."""
    solids = Solids(1)
    add(solids)
    canvas = Canvas(np.zeros((64, 80, 3), np.float32))
    canvas.paint(solids.rows()[0], K, light)
    return canvas


def point(*xyz):
    return np.array([xyz], float)


def rays():
    v, u = np.mgrid[:64, :80]
    return np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=2)


def nearest_of_spheres(start, end, radius, radius2, frame=None):
    """Depth at which rays first meet any of 4000 spheres between two ends: the hull by brute force."""
    d = rays() if frame is None else rays() @ frame.T
    start, end = (start, end) if frame is None else (start @ frame.T, end @ frame.T)
    best = np.full(d.shape[:2], np.inf)
    for share in np.linspace(0, 1, 4000):
        c, r = start + (end - start) * share, radius + (radius2 - radius) * share
        dd, dc = (d * d).sum(2), d @ c
        h = dc**2 - dd * (c @ c - r * r)
        best = np.where(h >= 0, np.minimum(best, (dc - np.sqrt(np.maximum(h, 0))) / dd), best)
    return best


@pytest.mark.parametrize(
    ("start", "end", "radius", "radius2"),
    [
        ((-0.2, 0.1, 2.0), (0.25, -0.1, 2.3), 0.10, 0.05),
        ((0.05, 0.02, 1.2), (0.1, 0.05, 2.4), 0.04, 0.15),  # pointing at the camera, the thin end first
        ((0.0, 0.0, 2.4), (0.1, 0.1, 1.3), 0.12, 0.12),
        ((0.1, 0.1, 1.5), (0.12, 0.1, 1.5), 0.10, 0.02),  # one end within the other
    ],
)
def test_a_round_cone_is_the_hull_of_its_spheres(start, end, radius, radius2):
    canvas = painted(lambda s: s.cone(point(*start), point(*end), radius, radius2, [1, 1, 1], "trunk"))
    truth = nearest_of_spheres(np.array(start), np.array(end), radius, radius2)
    hit, expected = canvas.part > 0, np.isfinite(truth)
    assert expected.sum() > 100
    assert (hit != expected).mean() < 0.002  # single pixels of the outline, between two of the 4000 spheres
    assert np.abs(canvas.depth - truth)[hit & expected].max() < 2e-3


def test_a_stretched_cone_is_the_hull_in_its_own_axes():
    frame = np.diag([1.0, 1.0, 1.8]) @ Rotation.from_euler("YX", [40, 20], degrees=True).as_matrix()
    start, end = np.array([-0.1, 0.05, 1.6]), np.array([0.15, -0.1, 1.8])
    canvas = painted(lambda s: s.cone(start[None], end[None], 0.15, 0.1, [1, 1, 1], "trunk", axes=frame[None]))
    truth = nearest_of_spheres(start, end, 0.15, 0.1, frame)
    both = (canvas.part > 0) & np.isfinite(truth)
    assert ((canvas.part > 0) != np.isfinite(truth)).mean() < 0.002 and both.sum() > 200
    assert np.abs(canvas.depth - truth)[both].max() < 2e-3


def test_a_box_and_a_triangle_are_where_geometry_says():
    half = np.array([[0.3, 0.1, 0.2]])
    box = painted(lambda s: s.box(point(0.0, 0.0, 2.0), np.eye(3)[None], half, [1, 0, 0], "trunk"))
    assert box.depth[32, 40] == pytest.approx(1.8)
    columns = np.flatnonzero(box.part[32] > 0)
    assert columns[[0, -1]] == pytest.approx([40 - 120 * 0.3 / 1.8, 40 + 120 * 0.3 / 1.8], abs=1)
    corners = np.array([[[0.0, 0.0, 1.0], [0.3, 0.0, 1.0], [0.0, 0.25, 1.5]]])
    flat = painted(
        lambda s: s.mesh(corners, np.tile([0.0, 0.0, -1.0], (1, 3, 1)), np.array([[0, 1, 2]]), [0, 1, 0], "trunk")
    )
    rows, columns = np.nonzero(flat.part)
    assert len(rows) > 200
    d = rays()[rows, columns] * flat.depth[rows, columns][:, None]
    assert np.abs(d[:, 2] - (1.0 + 2.0 * d[:, 1])).max() < 1e-5  # its plane: z = 1 + 2 y
    assert (d[:, :2] > -1e-6).all() and (d[:, 0] / 0.3 + d[:, 1] / 0.25).max() < 1 + 1e-5


def test_what_faces_the_light_is_bright_and_order_does_not_matter():
    def two(s, order=1):
        solids = [(point(0, 0, 2.0), 0.2, [1, 0, 0]), (point(0.1, 0, 1.5), 0.1, [0, 1, 0])][::order]
        for center, radius, color in solids:
            s.cone(center, center, radius, 0, color, "trunk")

    one, other = painted(two), painted(lambda s: two(s, -1))
    assert one.color.tobytes() == other.color.tobytes()
    assert one.color[32, 40 + 8].argmax() == 1  # the near green one hides the red one
    sphere = painted(lambda s: s.cone(point(0, 0, 2.0), point(0, 0, 2.0), 0.4, 0, [1, 1, 1], "trunk"))
    assert sphere.color[32, 40, 0] == pytest.approx(1.0, abs=1e-3)  # ambient + strength, facing the light
    edge = np.flatnonzero(sphere.part[32])[0]
    assert sphere.color[32, edge, 0] < 0.7


def test_holes_and_what_is_behind_the_camera_are_not_painted():
    eye = np.eye(3)[None]
    cap = painted(
        lambda s: s.ellipsoid(point(0, 0, 2.0), eye, [0.3] * 3, [1, 1, 1], "hair", plane=((0, 1, 0), 0.0), hole=True)
    )
    assert cap.part[25, 40] > 0  # above (y down)
    whole = painted(lambda s: s.ellipsoid(point(0, 0, 2.0), eye, [0.3] * 3, [1, 1, 1], "hair"))
    assert whole.part[45, 40] > 0 and cap.part[45, 40] == 0
    assert not painted(lambda s: s.cone(point(0, 0, -2.0), point(0, 0, -1.0), 0.5, 0.5, [1, 1, 1], "trunk")).part.any()
    assert not painted(lambda s: s.cone(point(0, 0, 2.0), point(0, 1, 2.0), -1, 0.5, [1, 1, 1], "trunk")).part.any()


@pytest.fixture(scope="module")
def standing():
    """Joints (4, 61, 3) in the axes of a camera 2.5 m in front of people, and their heads' axes."""
    dice = Dice(8, ("standing",), range(4))
    joints, head = pose_people(draw_build(dice), draw_pose(dice, presenting=True))
    flip = np.diag([1.0, -1.0, -1.0])
    return joints @ flip + [0, 0.4, 2.5], flip @ head


def test_the_heads_axes_follow_from_the_joints(standing):
    joints, head = standing
    turned = [angle_between(a, b) for a, b in zip(head_axes(joints), head, strict=True)]
    assert max(turned) < 2.0  # degrees; people's necks differ a little from the average


def angle_between(a, b):
    return np.degrees(Rotation.from_matrix(a @ b.T).magnitude())


def test_a_film_can_draw_a_person_from_the_clip_files_joints(standing):
    joints, _ = standing
    camera = np.array([[150.0, 0, 80], [0, 150.0, 60], [0, 0, 1]])
    image = np.full((120, 160, 3), 90, np.uint8)
    someone = draw_appearance("speaker", female=False)
    picture, parts = draw_person(image, joints[0, :55], someone, camera)
    assert picture.shape == image.shape and picture.dtype == np.uint8
    assert (picture[parts == 0][:40] == 90).all()  # far from the person the image is as it was
    u, v = (camera @ joints[0].T)[:2] / joints[0, :, 2]
    for name, limb in (
        ("left_wrist", {"left_hand", "left_forearm"}),
        ("right_elbow", {"right_upper_arm", "right_forearm"}),
    ):
        at = INDEX[name]
        assert parts[round(v[at]), round(u[at])] in {CODE[x] for x in limb}
    again, _ = draw_person(image, joints[0, :55], someone, camera)
    assert again.tobytes() == picture.tobytes()
    other, _ = draw_person(image, joints[0, :55], draw_appearance("other", "wild"), camera)
    assert (other != picture).mean() > 0.05


def test_the_face_on_film_moves_with_the_coefficients(standing):
    joints, head = standing
    weights = np.zeros((1, 64))
    weights[0, 0] = 1.0  # jaw_open
    someone = draw_appearance("speaker")
    camera = np.array([[900.0, 0, 60], [0, 900.0, 60], [0, 0, 1]])
    camera[:2, 2] -= (camera @ joints[0, INDEX["head"]])[:2] / joints[0, INDEX["head"], 2] - 60
    pictures = []
    for expression in (None, weights):
        canvas = Canvas(np.zeros((120, 120, 3), np.uint8))
        canvas.paint(person_solids(joints[:1], someone, head=head[:1], expression=expression)[0], camera)
        pictures.append(canvas.picture().astype(int))
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 30).sum() > 50


def test_wrong_shapes_are_refused_in_one_line(standing):
    with pytest.raises(CospeechError, match="expected"):
        person_solids(np.zeros((2, 21, 3)), draw_appearance("a"))
    with pytest.raises(CospeechError, match="expression"):
        person_solids(standing[0], draw_appearance("a"), expression=np.zeros((4, 3)))


def test_the_columns_of_a_solid_do_not_overlap():
    used = np.zeros(raster.COLUMNS, int)
    for name in (
        "ORIGIN",
        "AXES",
        "END",
        "RADIUS",
        "KIND",
        "PART",
        "COLOR",
        "COLOR2",
        "PLANE",
        "HOLE",
        "PATTERN",
        "PERIOD",
    ):
        used[getattr(raster, name)] += 1
    assert (used == 1).all()
