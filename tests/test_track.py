"""The track file: what is written is read, by us and by plain h5py, and damage is named."""

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cospeech.errors import CospeechError
from cospeech.skeleton import UPPER55, Skeleton
from cospeech.track import PARTS, Camera, FaceCoefficients, Points, Track

SKELETONS = {
    "body": "blazepose33",
    "left_hand": "coco_wholebody_hand21",
    "right_hand": "coco_wholebody_hand21",
    "face_landmarks": "face68",
}


def make_track(frames=12, parts=PARTS, depth=True, face=True, seed=0):
    rng = np.random.default_rng(seed)

    def points(part):
        count = len(Skeleton.load(SKELETONS[part]))
        xyz = rng.normal(size=(frames, count, 3)).astype(np.float32) if depth else None
        xy, score = rng.uniform(0, 500, (frames, count, 2)), rng.uniform(0, 1, (frames, count))
        observed = rng.uniform(size=frames) < 0.7
        return Points(SKELETONS[part], xy.astype("f4"), score.astype("f4"), observed, xyz, "root", "left_hip", depth)

    expression = rng.normal(size=(frames, 7)).astype("f4")
    coefficients = FaceCoefficients(expression, expression[:, :3], np.full(frames, 0.5, "f4"), "toy")
    return Track(
        29.97,
        frames,
        640,
        480,
        **{part: points(part) for part in parts},
        face=coefficients if face else None,
        source="größe.mp4",
        source_sha256="ab" * 32,
        start=1.5,
        backend="toy",
        backend_version="2.0",
        model_sha256="cd" * 32,
        licence_note="test only",
        camera=Camera(600.0, 601.0, 320.0, 241.0, "given"),
        cuts=np.array([frames // 2]) if frames > 1 else np.zeros(0, int),
    )


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(frames=st.integers(1, 40), parts=st.sets(st.sampled_from(PARTS)), depth=st.booleans(), face=st.booleans())
def test_round_trip(tmp_path, frames, parts, depth, face):
    track = make_track(frames, parts, depth, face)
    track.write(tmp_path / "track.h5")
    back = Track.read(tmp_path / "track.h5")
    assert set(back.parts) == parts and (back.face is not None) == face
    for name, points in track.parts.items():
        for key, value in vars(points).items():
            np.testing.assert_array_equal(vars(back.parts[name])[key], value, err_msg=f"{name}/{key}")
    for key, value in vars(track).items():
        if key not in (*PARTS, "face", "cuts"):
            assert getattr(back, key) == value, key
    np.testing.assert_array_equal(back.cuts, track.cuts)
    if face:
        np.testing.assert_array_equal(back.face.expression, track.face.expression)
        assert back.face.model == "toy"


def test_same_track_same_bytes(tmp_path):
    make_track().write(tmp_path / "a.h5")
    make_track().write(tmp_path / "b.h5")
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_file_is_the_designed_schema_for_plain_h5py(tmp_path):
    make_track().write(tmp_path / "track.h5")
    with h5py.File(tmp_path / "track.h5") as file:
        head = dict(file.attrs)
        assert (head["schema"], head["schema_version"], head["frames"]) == ("cospeech.track", 1, 12)
        assert (head["width"], head["height"], head["fps"]) == (640, 480, 29.97)
        assert list(head["camera"]) == [600, 601, 320, 241] and head["camera_origin"] == "given"
        shapes = {"body/xy": (12, 33, 2), "body/xyz": (12, 33, 3), "body/score": (12, 33), "body/observed": (12,)}
        shapes |= {"left_hand/xy": (12, 21, 2), "face_landmarks/xy": (12, 68, 2)}
        shapes |= {"face/expression": (12, 7), "face/rotation": (12, 3), "face/score": (12,)}
        assert {name: file[name].shape for name in shapes} == shapes
        body = file["body"].attrs
        assert (body["skeleton"], body["space"], body["root"], body["metric"]) == (
            "blazepose33",
            "root",
            "left_hip",
            True,
        )
        assert file["body/xy"].compression == "gzip" and file["body/xy"].dtype == np.float32


def spoil(**changes):
    track = make_track()
    for key, value in changes.items():
        owner, _, name = key.rpartition("__")
        setattr(getattr(track, owner) if owner else track, name, value)
    return track


@pytest.mark.parametrize(
    ("track", "words"),
    [
        (spoil(body__xyz=np.full((12, 33, 3), np.nan)), ["body/xyz", "NaN", "frame 0"]),
        (spoil(body__xy=np.zeros((12, 32, 2))), ["body/xy", "(12, 32, 2)", "(12, 33, 2)"]),
        (spoil(left_hand__score=np.full((12, 21), 1.5)), ["left_hand/score", "0 to 1"]),
        (spoil(body__skeleton="../blazepose33"), ["body", "skeleton", "../blazepose33"]),
        (spoil(body__space="world"), ["body", "space", "world", "camera"]),
        (spoil(face__rotation=np.zeros((12, 4))), ["face/rotation", "(12, 3)"]),
        (spoil(fps=0.0), ["fps"]),
        (spoil(frames=0), ["0 frames"]),
        (spoil(cuts=np.array([12])), ["cuts"]),
        (spoil(camera=Camera(0, 1, 1, 1)), ["camera"]),
    ],
)
def test_bad_arrays_are_never_written(tmp_path, track, words):
    with pytest.raises(CospeechError) as error:
        track.write(tmp_path / "track.h5")
    assert all(word in str(error.value) for word in words), error.value
    assert not list(tmp_path.iterdir())


def test_damaged_files_are_named(tmp_path):
    path = tmp_path / "track.h5"
    for damage, words in (
        (lambda file: file.attrs.update(schema_version=2), "version"),
        (lambda file: file.attrs.update(schema="cospeech.clip"), "schema"),
        (lambda file: file["body"].pop("score"), "score"),
        (lambda file: file.attrs.pop("fps"), "fps"),
        (lambda file: file["right_hand/xy"].write_direct(np.full((12, 21, 2), np.inf, "f4")), "right_hand/xy"),
    ):
        make_track().write(path)
        with h5py.File(path, "r+") as file:
            damage(file)
        with pytest.raises(CospeechError, match=words) as error:
            Track.read(path)
        assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)


def test_assumed_camera_sees_fifty_degrees_over_the_longer_side():
    camera = Camera.assumed(1080, 1920)
    assert np.degrees(2 * np.arctan(1920 / 2 / camera.fx)) == pytest.approx(50)
    assert (camera.cx, camera.cy, camera.origin) == (540, 960, "assumed")


def test_skeleton_tables_name_the_points_as_their_authors_order_them():
    """Indices as OpenPose, MediaPipe, COCO-WholeBody and iBUG publish them, and upper13 as the start of upper55."""
    index = lambda name: Skeleton.load(name).index
    blaze, coco, openpose, hand = (index(n) for n in ("blazepose33", "coco23", "openpose25", "coco_wholebody_hand21"))
    assert [blaze[n] for n in ("nose", "left_shoulder", "right_wrist", "left_hip", "right_foot_index")] == [
        0,
        11,
        16,
        23,
        32,
    ]
    assert [coco[n] for n in ("nose", "left_ear", "left_shoulder", "right_wrist", "right_hip", "right_heel")] == [
        0,
        3,
        5,
        10,
        12,
        22,
    ]
    assert [openpose[n] for n in ("neck", "right_wrist", "pelvis", "left_ear", "left_big_toe", "right_heel")] == [
        1,
        4,
        8,
        18,
        19,
        24,
    ]
    assert [hand[n] for n in ("hand_root", "thumb_0", "index_0", "middle_3", "little_3")] == [0, 1, 5, 12, 20]
    landmarks = ("nose_tip", "right_eye_corner_outer", "left_eye_corner_inner", "left_lip_corner")
    assert [index("face68")[name] for name in landmarks] == [30, 36, 42, 54]
    assert len(index("facemesh478")) == 478 and len(index("openpose_face70")) == 70
    assert Skeleton.load("upper13").names == UPPER55.names[:13]
    assert Skeleton.load("upper13").parents == UPPER55.parents[:13]
