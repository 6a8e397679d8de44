"""Files of other programs: points land under the right names, in the right axes; nothing is unpickled."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cospeech.capture.film.decoding import open_film
from cospeech.capture.trackers.precomputed import PrecomputedTracker, read_parts, read_release
from cospeech.capture.trackers.registry import run_trackers
from cospeech.capture.trackers.smplx import smplx_parts
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.formats.smplx_motion import smplx_table
from cospeech.skeleton import UPPER55
from tests.capture.films import textured, write_film
from tests.test_track import make_track


def at(points, name):
    """xy of a named point in every frame."""
    return points.xy[:, points.table.index[name]]


def space(points, name):
    return points.xyz[:, points.table.index[name]]


@pytest.fixture
def film(tmp_path):
    return open_film(write_film(tmp_path / "film.mp4", textured(1, 20)))


def write_openpose(folder, frames):
    """Key points whose x is their number plus the frame, y = 100 + number; a second, smaller person comes first."""
    folder.mkdir()
    counts = {"pose_keypoints_2d": 25, "hand_left_keypoints_2d": 21, "hand_right_keypoints_2d": 21}
    counts["face_keypoints_2d"] = 70
    for frame in range(frames):
        person = {
            key: np.column_stack([np.arange(n) + frame, 100 + np.arange(n), np.full(n, 0.8)]).ravel().tolist()
            for key, n in counts.items()
        }
        other = {"pose_keypoints_2d": [5.0, 5.0, 0.9] * 25}
        content = {"version": 1.3, "people": [other, person] if frame != 3 else []}
        (folder / f"film_{frame:012d}_keypoints.json").write_text(json.dumps(content))
    return folder


def test_openpose(tmp_path, film):
    track = run_trackers(film, PrecomputedTracker(write_openpose(tmp_path / "json", 20)))
    frames = np.arange(20)
    np.testing.assert_array_equal(track.body.observed, frames != 3)
    seen = track.body.observed
    np.testing.assert_allclose(at(track.body, "right_wrist")[seen, 0], (4 + frames)[seen])
    np.testing.assert_allclose(
        at(track.left_hand, "index_3")[seen], np.column_stack([8 + frames, 0 * frames + 108])[seen]
    )
    np.testing.assert_allclose(at(track.face_landmarks, "left_pupil")[seen, 0], (69 + frames)[seen])
    np.testing.assert_allclose(track.body.score[seen], 0.8, atol=1e-6)
    assert track.body.xyz is None


def renamed(folder, name):
    """Its files under other names: name(frame), or None for a frame that is lost."""
    for file in sorted(folder.iterdir()):
        frame = int(file.name.split("_")[1])
        file.rename(folder / name(frame)) if name(frame) else file.unlink()
    return folder


NAMES = {
    "film's": lambda k: f"talk_{k:012d}_keypoints.json",
    "not padded": lambda k: f"talk_{k}_keypoints.json",
    "pictures from 1": lambda k: f"img{k + 1:04d}_keypoints.json",
    "number before a word": lambda k: f"{k:05d}_rendered_keypoints.json",
}


@pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")
@pytest.mark.parametrize("style", NAMES)
def test_openpose_files_are_of_the_frame_whose_number_they_have(tmp_path, film, style):
    lost = range(7, 12)
    folder = renamed(write_openpose(tmp_path / "json", 20), lambda k: None if k in lost else NAMES[style](k))
    track = run_trackers(film, PrecomputedTracker(folder))
    seen = np.array([k != 3 and k not in lost for k in range(20)])
    np.testing.assert_array_equal(track.body.observed, seen)
    np.testing.assert_allclose(at(track.body, "nose")[seen, 0], np.arange(20)[seen])


def test_openpose_files_whose_numbers_are_no_frames(tmp_path, film):
    folder = renamed(write_openpose(tmp_path / "dates", 20), lambda k: f"20240517{k:02d}_keypoints.json")
    with pytest.warns(CospeechNotice, match="files are counted"):
        track = run_trackers(film, PrecomputedTracker(folder))
    np.testing.assert_allclose(at(track.body, "nose")[4:, 0], np.arange(4, 20))
    folder = renamed(write_openpose(tmp_path / "twice", 2), lambda k: f"cam{k}_0007_keypoints.json")
    with pytest.raises(
        CospeechError, match=r"cam0_0007_keypoints\.json and cam1_0007_keypoints\.json are both of frame 7"
    ):
        read_parts(folder)


NOBODY = [
    '{"people": null}',
    '{"people": [null]}',
    '{"people": []}',
    '{"version": 1.3}',
    '{"people": [{}]}',
    '{"people": [{"pose_keypoints_2d": null}]}',
    '{"people": [{"pose_keypoints_2d": []}]}',
]


@pytest.mark.parametrize("content", NOBODY)
def test_null_and_absent_people_are_not_seen(tmp_path, film, content):
    folder = write_openpose(tmp_path / "json", 20)
    (folder / f"film_{8:012d}_keypoints.json").write_text(content)
    track = run_trackers(film, PrecomputedTracker(folder))
    np.testing.assert_array_equal(np.flatnonzero(~track.body.observed), [3, 8])


def test_null_numbers_are_points_not_seen(tmp_path):
    folder = write_openpose(tmp_path / "json", 2)
    file = folder / f"film_{1:012d}_keypoints.json"
    content = json.loads(file.read_text())
    content["people"][1]["pose_keypoints_2d"][:3] = [None, None, None]
    file.write_text(json.dumps(content))
    parts, _ = read_parts(folder)
    assert parts["body"].score[1, 0] == 0 and parts["body"].score[1, 1] > 0 and parts["body"].observed.all()


@pytest.mark.parametrize(
    "content",
    [
        "[]",
        "7",
        '{"people": 7}',
        '{"people": ["a"]}',
        "{",
        '{"people": [{"pose_keypoints_2d": [1, 2]}]}',
        '{"people": [{"pose_keypoints_2d": {"a": 1}}]}',
        '{"people": [{"pose_keypoints_2d": ["a"]}]}',
    ],
)
def test_what_is_no_file_of_openpose_is_one_line(tmp_path, content):
    folder = write_openpose(tmp_path / "json", 3)
    (folder / f"film_{1:012d}_keypoints.json").write_text(content)
    with pytest.raises(CospeechError, match="film_000000000001_keypoints") as error:
        read_parts(folder)
    assert "\n" not in str(error.value)


def test_a_film_of_varying_rate_shows_each_file_at_its_own_time(tmp_path):
    """File k is of picture k: 30 a second at first, then 15."""
    times = np.concatenate([np.arange(60) / 30, 2 + np.arange(60) / 15])
    film = open_film(write_film(tmp_path / "film.mp4", textured(1, 120), times=times))
    folder = renamed(write_openpose(tmp_path / "json", 120), NAMES["film's"])
    track = run_trackers(film, PrecomputedTracker(folder))
    seen = track.body.observed
    shown = times[np.round(at(track.body, "nose")[:, 0]).astype(int)]
    clock = np.arange(track.frames) / track.fps
    apart = np.abs(shown - clock)[seen & (clock < times[-1])]
    nearest = np.abs(times[:, None] - clock).min(axis=0)[seen & (clock < times[-1])]
    np.testing.assert_allclose(apart, nearest, atol=1e-4)
    late = run_trackers(open_film(film.path, 3.0, 4.0), PrecomputedTracker(folder))
    assert abs(times[round(float(at(late.body, "nose")[0, 0]))] - 3.0) <= 1 / 30


def test_a_take_of_a_longer_film_takes_its_frames(tmp_path):
    path = write_film(tmp_path / "film.mp4", textured(1, 50), fps=50)
    folder = write_openpose(tmp_path / "json", 50)
    track = run_trackers(open_film(path, 0.2, 0.6), PrecomputedTracker(folder))
    assert track.fps == 25  # every second frame of the film, from its tenth
    np.testing.assert_allclose(at(track.body, "nose")[:, 0], np.arange(10, 30, 2))


def test_the_published_49_and_52_points(tmp_path, film):
    """neck, right arm, left arm, then 21 of the left hand and 21 of the right; 52 points have three more at 7 to 9."""
    x = np.arange(49.0)
    folder = tmp_path / "keypoints"
    folder.mkdir()
    for frame in range(12):
        values = np.stack([x + frame, x])
        if frame % 2:
            values = np.insert(values, 7, np.full((3, 2), -1.0), axis=1)
        np.savetxt(folder / f"{frame:05d}.txt", values)
    parts, rate = read_parts(folder)
    assert rate == 15.0
    for part, name, number in (
        ("body", "neck", 0),
        ("body", "right_shoulder", 1),
        ("body", "right_wrist", 3),
        ("body", "left_wrist", 6),
        ("left_hand", "hand_root", 7),
        ("left_hand", "thumb_0", 8),
        ("left_hand", "little_3", 27),
        ("right_hand", "hand_root", 28),
        ("right_hand", "little_3", 48),
    ):
        np.testing.assert_allclose(at(parts[part], name)[:, 0], number + np.arange(12), err_msg=name)
    assert parts["body"].score[:, parts["body"].table.index["nose"]].max() == 0  # not among the 49
    for lost in (4, 5):
        (folder / f"{lost:05d}.txt").unlink()
    gaps, _ = read_parts(folder)
    np.testing.assert_array_equal(np.flatnonzero(~gaps["body"].observed), [4, 5])
    np.testing.assert_allclose(at(gaps["body"], "neck")[6:, 0], np.arange(6, 12))
    np.savez(tmp_path / "clip.npz", pose=np.stack([np.stack([x, x])] * 12), audio=np.zeros(9))
    same, _ = read_parts(tmp_path / "clip.npz")
    np.testing.assert_allclose(at(same["right_hand"], "little_3"), 48)


def test_the_137_points_of_speech_drives_templates(tmp_path):
    pose = np.tile(np.stack([np.arange(137.0), np.zeros(137), np.full(137, 0.5)]), (10, 1, 1))
    np.savez(tmp_path / "clip.npz", pose=pose)
    parts, _ = read_parts(tmp_path / "clip.npz")
    starts = {"body": ("nose", 0), "face_landmarks": ("right_jaw_0", 25)}
    starts |= {"left_hand": ("hand_root", 95), "right_hand": ("hand_root", 116)}
    for part, (name, number) in starts.items():
        np.testing.assert_allclose(at(parts[part], name)[:, 0], number)


@pytest.mark.parametrize("relative", [False, True])
def test_the_published_3d_annotation(tmp_path, relative):
    """165 numbers are three rows of 55; hands relative to their wrists or absolute give the same track."""
    rng = np.random.default_rng(0)
    joints = rng.normal(size=(2, 64, 55, 3))
    for side in ("right", "left"):
        joints[:, :, UPPER55.index[f"{side}_hand_root"]] = joints[:, :, UPPER55.index[f"{side}_wrist"]]
    stored = joints.copy()
    if relative:
        for first, side in ((13, "right"), (34, "left")):
            stored[:, :, first : first + 21] -= joints[:, :, [UPPER55.index[f"{side}_wrist"]]]
    face = np.arange(257) + np.zeros((2, 64, 1))
    np.savez(tmp_path / "train_oliver_data.npz", body=stored.swapaxes(2, 3).reshape(2, 64, 165), face=face)
    with pytest.warns(CospeechNotice, match="relative" if relative else "absolute"):
        tracks = read_release(tmp_path / "train_oliver_data.npz")
    assert len(tracks) == 2 and tracks[1].frames == 64 and tracks[1].fps == 15
    track, truth = tracks[1], joints[1]
    np.testing.assert_allclose(space(track.body, "left_elbow"), truth[:, UPPER55.index["left_elbow"]], atol=1e-6)
    hand = truth[:, UPPER55.index["left_ring_3"]] - truth[:, UPPER55.index["left_wrist"]]
    np.testing.assert_allclose(space(track.left_hand, "ring_3"), hand, atol=1e-5)
    np.testing.assert_array_equal(track.face.expression[0], np.arange(166, 230))
    np.testing.assert_array_equal(track.face.rotation[0], [163, 164, 165])
    track.write(tmp_path / "track.h5")


def test_smplx_turns_joints_about_their_parents(tmp_path):
    """The left elbow bent forward by 90 degrees: wrist and hand point ahead of it; nothing else moves."""
    poses = np.zeros((4, 55, 3))
    poses[2:, 18] = [0, -np.pi / 2, 0]  # joint 18 is the left elbow; about y, from x to z
    arrays = {"poses": poses.reshape(4, 165), "mocap_frame_rate": np.array(60.0)}
    with pytest.warns(CospeechNotice, match="default rest skeleton"):
        parts, rate = smplx_parts(arrays, "motion.npz")
    body = parts["body"]
    assert rate == 60.0
    forearm = space(body, "left_wrist") - space(body, "left_elbow")
    # camera axes: x right (the speaker's left), y down, z away; ahead of the speaker is towards the camera
    np.testing.assert_allclose(forearm[0], [0.25, 0, 0], atol=1e-6)
    np.testing.assert_allclose(forearm[3], [0, 0, -0.25], atol=1e-6)
    np.testing.assert_allclose(space(parts["left_hand"], "middle_0")[3], [0, 0, -0.095], atol=0.01)
    np.testing.assert_allclose(space(body, "right_wrist")[3], space(body, "right_wrist")[0], atol=1e-6)
    assert space(body, "head_top")[0, 1] < space(body, "neck")[0, 1] < 0


def test_smplx_by_the_users_body_model_and_z_up(tmp_path):
    """A model whose joints are its vertices: rest joints come out, moved by betas; z-up files are put upright."""
    table = smplx_table()
    rest = np.array([table["rest"][name] for name in list(table["parents"])[:55]])
    model = tmp_path / "SMPLX_NEUTRAL.npz"
    shapes = np.zeros((55, 3, 10))
    shapes[:, :, 0] = rest  # the first beta makes everything larger
    np.savez(model, J_regressor=np.eye(55), v_template=rest, shapedirs=shapes)
    stand = Rotation.from_euler("x", 90, degrees=True).as_rotvec()  # AMASS: z up
    arrays = {
        "global_orient": np.tile(stand, (3, 1)),
        "body_pose": np.zeros((3, 63)),
        "betas": np.array([0.1] + [0] * 9),
    }
    parts, rate = smplx_parts(arrays, "motion.npz", model)
    assert rate == 30.0
    index = list(table["parents"]).index("left_wrist")
    wanted = (rest[index] - rest[0]) * 1.1 * [1, -1, -1]
    np.testing.assert_allclose(space(parts["body"], "left_wrist")[0], wanted, atol=1e-6)
    with pytest.raises(CospeechError, match="hands without"):
        smplx_parts(arrays | {"left_hand_pose": np.zeros((3, 12))}, "motion.npz", model)


def test_a_track_of_ours_is_taken_at_the_films_times(tmp_path, film):
    track = make_track(30)
    track.fps, track.start = 50.0, 0.1
    track.write(tmp_path / "own.h5")
    taken = run_trackers(film, PrecomputedTracker(tmp_path / "own.h5"))
    frames = np.round((np.arange(20) / 25 - 0.1) * 50).astype(int)
    inside = (frames >= 0) & (frames < 30)
    np.testing.assert_array_equal(taken.body.observed, inside & track.body.observed[np.clip(frames, 0, 29)])
    seen = taken.body.observed
    np.testing.assert_array_equal(taken.body.xy[seen], track.body.xy[frames[seen]])


def test_files_that_are_none_of_these(tmp_path):
    np.savez(tmp_path / "other.npz", something=np.zeros((3, 4)))
    np.savez(tmp_path / "objects.npz", people=np.array([{"a": 1}], object))
    (tmp_path / "text.npz").write_text("nothing")
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "a_keypoints.json").write_text('{"people": [{"pose_keypoints_2d": [1, 2, 3]}]}')
    for name, words in {
        "other.npz": "none of the formats",
        "objects.npz": "pickled",
        "text.npz": "not a readable .npz",
        "empty": "neither",
        "bad": "25 points",
    }.items():
        with pytest.raises(CospeechError, match=words) as error:
            read_parts(tmp_path / name)
        assert name in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(CospeechError, match="no such file"):
        PrecomputedTracker(tmp_path / "gone.h5")
