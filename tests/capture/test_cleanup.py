"""Clean-up: gaps by the published limit, outliers by geometry, constant bones, published smoothing, the clip's axes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from person import J, make_track, positions
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from cospeech.capture.cleanup.assemble import assemble, in_metres
from cospeech.capture.cleanup.clean import Cleanup, clean, speaker_bones, window_mean
from cospeech.capture.cleanup.fill import EXCLUDED, INTERPOLATED, OBSERVED, fill_gaps
from cospeech.capture.cleanup.gates import agreement_gate, bone_gate, robust_bones, speed_gate
from cospeech.capture.cleanup.stretch import Face
from cospeech.errors import CospeechError
from cospeech.skeleton import LEFT_HAND, RIGHT_HAND, bone_lengths

OFF = Cleanup(
    bone_tolerance=0,
    speed_limit=0,
    agreement=0,
    joined=0,
    sigma=0,
    upright=False,
    forward=False,
    unify_bones=False,
    threshold=0,
    wrists=False,
    ahead=False,
)


def cleaned(track, settings=OFF, seconds=4.0, **options):
    return clean(assemble(track), track.fps, round(seconds * 15), settings=settings, cuts=track.cuts, **options)


def millimetres(a, b):
    return 1000 * np.linalg.norm(a - b, axis=-1)


def test_a_perfect_track_becomes_the_truth_in_the_clips_axes():
    result = cleaned(make_track(fps=15.0))
    assert millimetres(result.positions, positions(4.0, 15)).max() < 0.01
    assert (result.state == OBSERVED).all() and (result.confidence == 1).all()


def test_any_video_rate_comes_to_15_hz_without_drift():
    result = cleaned(make_track(seconds=8.0, fps=29.97), seconds=8.0)
    assert millimetres(result.positions, positions(8.0, 15))[3:-3].max() < 1.0


def test_all_steps_together_bring_a_turned_and_shaking_person_back():
    clear = cleaned(make_track(yaw=0.0), Cleanup(threshold=0))
    result = cleaned(make_track(yaw=0.6, noise=0.005), Cleanup(threshold=0))
    assert np.median(millimetres(result.positions, clear.positions)) < 7.0


@pytest.mark.parametrize("missing", [1, 6, 7, 8, 12])
def test_a_hand_is_filled_up_to_seven_missing_frames_and_no_further(missing):
    track = make_track(fps=15.0)
    truth = assemble(track).positions[:, LEFT_HAND]
    gap = slice(20, 20 + missing)
    track.left_hand.observed[gap] = False
    track.left_hand.xyz[gap] = 0
    result = cleaned(track)
    state = result.state[:, LEFT_HAND]
    assert (state[gap] == (INTERPOLATED if missing <= 7 else EXCLUDED)).all()
    assert (np.delete(state, np.r_[gap], axis=0) == OBSERVED).all()
    assert (result.state[:, RIGHT_HAND] == OBSERVED).all()
    hand = result.positions[:, LEFT_HAND] - result.positions[:, J["left_wrist"], None]
    if missing <= 7:
        known = np.delete(np.arange(60), np.r_[gap])
        assert np.allclose(hand[gap], CubicSpline(known, truth[known])(np.arange(60))[gap], atol=1e-5)
        assert (result.confidence[gap, LEFT_HAND] > 0).all() and (result.confidence[gap, LEFT_HAND] < 1).all()
    else:
        assert (result.confidence[gap, LEFT_HAND] == 0).all() and np.isfinite(hand).all()


def test_the_limit_counts_frames_of_15_hz_at_any_video_rate():
    track = make_track(fps=30.0)
    track.left_hand.observed[40:55] = False  # two believed frames 16 frames of 30 Hz apart
    assert (cleaned(track).state[:, LEFT_HAND] != EXCLUDED).all()
    track.left_hand.observed[40:57] = False
    assert (cleaned(track).state[21:28, LEFT_HAND] == EXCLUDED).all()


@given(st.lists(st.booleans(), min_size=2, max_size=60), st.integers(1, 12))
def test_filling_marks_every_frame_and_changes_no_believed_one(believed, apart):
    believed = np.array(believed)
    values = np.random.default_rng(0).normal(size=(len(believed), 3))
    filled, state = fill_gaps(values, believed, apart)
    assert np.array_equal(filled[believed], values[believed]) and (state[believed] == OBSERVED).all()
    assert np.isfinite(filled).all()
    known = np.flatnonzero(believed)
    for frame in np.flatnonzero(~believed):
        before, after = known[known < frame], known[known > frame]
        inside = len(before) and len(after) and after[0] - before[-1] <= apart
        assert state[frame] == (INTERPOLATED if inside else EXCLUDED)


def test_smoothing_is_scipys_gaussian_of_one_and_a_half_frames():
    track = make_track(fps=15.0)
    rough = cleaned(track)
    smooth = cleaned(track, Cleanup(**{**OFF.__dict__, "sigma": 1.5}))
    assert np.allclose(smooth.positions, gaussian_filter1d(rough.positions, 1.5, axis=0, mode="nearest"), atol=1e-9)


def test_head_rotation_is_smoothed_and_expression_is_not():
    t = np.arange(60) / 15
    face = Face(np.stack([0 * t, 0.3 * np.sin(2 * np.pi * 2 * t), 0 * t], 1), np.ones(60), np.sin(20 * t)[:, None])
    result = cleaned(make_track(fps=15.0), Cleanup(upright=False, forward=False), face=face).face
    damping = np.exp(-0.5 * (2 * np.pi * 2 * 0.1) ** 2)  # of 2 Hz by a Gaussian of 0.1 s
    assert np.allclose(result.rotation[8:-8, 1], 0.3 * damping * np.sin(2 * np.pi * 2 * t)[8:-8], atol=0.01)
    assert np.allclose(result.expression, face.expression)


def test_bones_are_constant_and_the_speakers_after_the_clean_up():
    track = make_track(noise=0.005)
    bones = speaker_bones([assemble(track), assemble(make_track(noise=0.005, seed=1))], [30.0, 30.0])
    result = cleaned(track, Cleanup(), bones=bones)
    relative = np.linalg.norm(np.diff(result.positions[:, [J["left_elbow"], J["left_wrist"]]], axis=1), axis=-1)
    assert np.ptp(relative) < 1e-9 and np.isclose(relative[0, 0], bones[J["left_wrist"]])
    assert np.allclose(bone_lengths(result.positions), bones, atol=1e-9)
    truth = bone_lengths(positions(4.0, 15))
    assert np.abs(bones - truth).max() < 0.005 and np.allclose(bones[LEFT_HAND], bones[RIGHT_HAND])


def test_a_constant_pose_stays_as_it_is():
    track = make_track()
    for points in track.parts.values():
        points.xyz[:], points.xy[:] = points.xyz[:1], points.xy[:1]
    result = cleaned(track, Cleanup())
    assert np.ptp(result.positions, axis=0).max() < 1e-6


@pytest.mark.parametrize(("gate", "settings"), [("speed", {"speed_limit": 8.0}), ("bone", {"bone_tolerance": 0.5})])
def test_an_outlier_is_removed_and_marked_however_confident_it_was(gate, settings):
    track = make_track(fps=15.0)
    wrist = track.body.table.index["left_wrist"]
    track.body.xyz[30, wrist] += [0.5, -0.6, 0.3]
    result = cleaned(track, Cleanup(**{**OFF.__dict__, **settings}))
    assert result.state[30, J["left_wrist"]] == INTERPOLATED and result.dropped[gate] > 0
    assert (np.delete(result.state[:, J["left_wrist"]], 30) == OBSERVED).all()
    away = millimetres(result.positions, positions(4.0, 15))
    assert away[30, J["left_wrist"]] < 20 and away[:, : J["left_wrist"]].max() < 0.01


def test_a_joint_that_2d_and_3d_disagree_about_is_dropped():
    observed = assemble(make_track())
    body = slice(0, 13)
    arguments = observed.positions[:, body], observed.pixels[:, body].copy(), observed.seen[:, body], 0.6
    assert not agreement_gate(*arguments).any()
    arguments[1][10:20, J["right_wrist"]] += 400
    wrong = agreement_gate(*arguments)
    assert wrong[10:20, J["right_wrist"]].all() and wrong.sum() == 10


def test_a_hand_that_is_not_at_its_arm_is_dropped():
    track = make_track()
    track.left_hand.xy[50:70] += [300, 0]  # somebody else's
    result = cleaned(track, Cleanup(**{**OFF.__dict__, "joined": 0.4}))
    assert (result.state[26:34, LEFT_HAND] != OBSERVED).all() and (result.state[:24, LEFT_HAND] == OBSERVED).all()


def test_gates_leave_fast_gestures_alone():
    t = np.arange(100) / 25
    fast = np.zeros((100, 55, 3))
    fast[:, J["left_wrist"], 0] = 0.3 * np.sin(2 * np.pi * 3 * t)  # up to 5.7 m/s
    assert not speed_gate(fast, np.ones((100, 55), bool), 25, 8.0).any()


def test_bone_gate_blames_the_joint_that_moved_not_its_child():
    truth = positions(2.0, 15)
    seen = np.ones(truth.shape[:2], bool)
    bones = robust_bones([truth], [seen])
    truth[5, J["left_elbow"]] += [0.5, 0, 0.4]
    wrong = bone_gate(truth, seen, bones, 0.5)
    assert wrong[5, J["left_elbow"]] and wrong.sum() == 1


def test_a_leaning_camera_is_turned_upright_and_the_heading_taken_out():
    track = make_track(yaw=0.5)
    tilt = Rotation.from_euler("X", 15, degrees=True).as_matrix()
    for points in track.parts.values():
        points.xyz[:] = points.xyz @ tilt.T
    result = cleaned(track, Cleanup(**{**OFF.__dict__, "upright": True, "forward": True}))
    assert result.tilt == pytest.approx(15, abs=0.1)
    away = millimetres(result.positions, cleaned(make_track(), Cleanup(**{**OFF.__dict__, "forward": True})).positions)
    assert away[3:-3].max() < 2.0
    left = result.positions[:, J["left_shoulder"]] - result.positions[:, J["right_shoulder"]]
    assert (left[:, 0] > 0.3).all()


def head_of(track, offset=(0, 0, 0)):
    """A head that nods, turned by `offset` (degrees about x, y, z)."""
    t = np.arange(track.frames) / track.fps
    nods = Rotation.from_rotvec(np.stack([0.2 * np.sin(3 * t), 0 * t, 0 * t], 1))
    return Face((Rotation.from_euler("XYZ", offset, degrees=True) * nods).as_rotvec(), np.ones(track.frames))


@pytest.mark.parametrize("camera", [0, 15])
def test_hands_lean_back_with_the_camera_but_not_with_the_bodys_tracker(camera):
    """The body is seen to lean by 15 degrees: with the head, then it is the camera, and hands lean too; or alone."""
    track, settings = make_track(seconds=6.0), Cleanup(**{**OFF.__dict__, "upright": True})
    truth = positions(6.0, 15)
    tilt = Rotation.from_euler("X", 15, degrees=True).as_matrix()
    for name, points in track.parts.items():
        if name == "body" or camera:
            points.xyz[:] = points.xyz @ tilt.T
    result = cleaned(track, settings, 6.0, face=head_of(track, (camera, 0, 0)))
    for hand, root in ((LEFT_HAND, "left_hand_root"), (RIGHT_HAND, "right_hand_root")):
        own, real = (p[:, hand] - p[:, [J[root]]] for p in (result.positions, truth))
        assert millimetres(own, real)[3:-3].max() < 3.0
    track.left_hand.space = track.right_hand.space = "camera"  # of one network with the body: it leans as one
    result = cleaned(track, settings, 6.0, face=head_of(track, (camera, 0, 0)))
    own, real = (p[:, LEFT_HAND] - p[:, [J["left_hand_root"]]] for p in (result.positions, truth))
    assert (millimetres(own, real).max() > 20) == (camera == 0)


def test_hands_face_between_where_the_body_and_the_head_do():
    """The body's tracker alone sees the speaker turned aside by 20 degrees."""
    track, truth = make_track(seconds=6.0), positions(6.0, 15)
    track.body.xyz[:] = track.body.xyz @ Rotation.from_euler("Y", 20, degrees=True).as_matrix().T
    finger, root = J["left_middle_0"], J["left_hand_root"]
    for ahead, off in ((False, 20), (True, 10)):
        settings = Cleanup(**{**OFF.__dict__, "forward": True, "ahead": ahead})
        found = cleaned(track, settings, 6.0, face=head_of(track)).positions
        one, other = ((p[:, finger] - p[:, root])[:, [0, 2]] @ [1, 1j] for p in (found, truth))
        assert np.abs(np.degrees(np.angle(one / other))) == pytest.approx(np.full(90, off), abs=1)


def test_a_speaker_looks_straight_ahead_on_average():
    """A constant turn of the head is the tracker's or the camera's; short shots are too short to tell."""
    for seconds, ahead, left in ((6.0, True, False), (6.0, False, True), (4.0, True, True)):
        track = make_track(seconds=seconds)
        settings = Cleanup(**{**OFF.__dict__, "ahead": ahead})
        face = cleaned(track, settings, seconds, face=head_of(track, (10, 20, 5))).face
        mean = np.degrees(Rotation.from_rotvec(face.rotation).mean().magnitude())
        assert mean > 15 if left else mean < 0.1
        nods = Rotation.from_rotvec(face.rotation).as_matrix()[:, 1, 2]
        assert np.ptp(nods) > 0.3  # it still nods


def test_wrists_go_where_their_hands_were_seen():
    track, settings = make_track(), Cleanup(**{**OFF.__dict__, "wrists": True})
    truth, j = positions(4.0, 15), J["left_wrist"]
    wrist = track.body.table.index["left_wrist"]
    track.body.xyz[:, wrist, :2] += [0.05, -0.04]
    track.body.xy[:, wrist] += np.array([0.05, -0.04]) * 1500 / 2.0  # as the camera shows it, about
    before, after = (millimetres(cleaned(track, s).positions, truth) for s in (OFF, settings))
    assert np.median(before[:, j]) > 60 and np.median(after[:, j]) < 15
    others = [k for k in range(13) if k != j]
    assert np.allclose(before[:, others], after[:, others])
    track.left_hand.observed[:] = False
    assert np.allclose(millimetres(cleaned(track, settings).positions, truth)[:, j], before[:, j])


def test_windows_without_hands_or_face_are_excluded_and_short_occlusions_tolerated():
    track, settings = make_track(seconds=20.0, fps=15.0), Cleanup(**{**OFF.__dict__, "threshold": 0.3, "window": 64})
    track.left_hand.observed[150:250] = track.right_hand.observed[150:250] = False
    valid = cleaned(track, settings, 20.0).valid
    hidden = np.ones(300)
    hidden[150:250] = 0
    assert np.array_equal(valid, window_mean(hidden, 64) >= 0.3) and not valid[200] and valid[100]
    track.left_hand.observed[:] = True
    assert cleaned(track, settings, 20.0).valid.all()  # one hand is enough


@given(st.integers(1, 30), st.integers(1, 40))
def test_window_mean_is_the_mean_of_the_frames_around(frames, window):
    values = np.random.default_rng(frames).random(frames)
    first = np.arange(frames) - window // 2
    expected = [values[max(a, 0) : max(a, 0) + window + min(a, 0)].mean() for a in first]
    assert np.allclose(window_mean(values, window), expected)


def test_nothing_is_smoothed_or_filled_across_a_cut():
    track = make_track(fps=15.0)
    track.body.xyz[30:, track.body.table.index["left_wrist"]] += [0.1, 0.1, 0]
    track.cuts = np.array([30])
    track.left_hand.observed[28:32] = False
    track.left_hand.xyz[28:32] = 0
    result = cleaned(track, Cleanup(**{**OFF.__dict__, "sigma": 1.5}))
    separate = cleaned(make_track(fps=15.0), Cleanup(**{**OFF.__dict__, "sigma": 1.5}))
    jump = np.diff(result.positions[:, J["left_wrist"]], axis=0)[29]
    assert np.linalg.norm(jump - np.diff(separate.positions[:, J["left_wrist"]], axis=0)[29]) > 0.1
    assert (result.state[28:32, LEFT_HAND] == EXCLUDED).all() and not result.valid[30]


def test_a_hand_never_seen_rests_on_its_arm_without_confidence():
    track = make_track(fps=15.0)
    track.right_hand = None
    result = cleaned(track)
    assert (result.state[:, RIGHT_HAND] == EXCLUDED).all() and (result.confidence[:, RIGHT_HAND] == 0).all()
    assert millimetres(result.positions[:, J["right_hand_root"]], result.positions[:, J["right_wrist"]]).max() < 1e-6
    forearm = result.positions[:, J["right_wrist"]] - result.positions[:, J["right_elbow"]]
    finger = result.positions[:, J["right_middle_0"]] - result.positions[:, J["right_wrist"]]
    cosine = np.sum(forearm * finger, 1) / np.linalg.norm(forearm, axis=1) / np.linalg.norm(finger, axis=1)
    assert (cosine > 0.9).all()


def test_a_track_without_scale_becomes_an_adult():
    track = make_track()
    for points in track.parts.values():
        points.xyz *= 370
        points.metric = False
    result = clean(in_metres(assemble(track)), 30.0, 60, settings=OFF)
    truth = positions(4.0, 15)
    ratio = bone_lengths(result.positions)[J["neck"]] / bone_lengths(truth)[J["neck"]]
    assert 0.9 < ratio < 1.2 and np.allclose(result.positions[3:-3], truth[3:-3] * ratio, atol=2e-3)


def test_a_body_that_is_never_believable_is_one_clear_line():
    track = make_track()
    track.body.observed[:] = False
    with pytest.raises(CospeechError, match="no believable body"):
        cleaned(track)
