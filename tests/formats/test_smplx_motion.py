"""SMPL-X parameters in the layouts of the field: one arm that swings is the same motion in all of them."""

import warnings

import numpy as np
import pytest
from scipy.io import wavfile
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.formats.mocap import read_mocap_take
from cospeech.formats.smplx_motion import is_smplx, smplx_animation, smplx_table
from cospeech.skeleton import UPPER55

FPS, FRAMES = 120, 360
quiet = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")
TIME = np.arange(FRAMES) / FPS
SWING = 0.8 * np.sin(np.pi * TIME)  # radians about y, of the right elbow
RIGHT_ELBOW, RIGHT_INDEX1 = 19, 40


def poses(z_up=False):
    """(T, 55, 3): the right forearm swings about y, the right index bends by 0.5 rad."""
    turns = np.zeros((FRAMES, 55, 3))
    turns[:, RIGHT_ELBOW, 1] = SWING
    turns[:, RIGHT_INDEX1, 2] = 0.5
    if z_up:
        turns[:, 0, 0] = np.pi / 2
    return turns


def matrices(turns):
    return Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(*turns.shape, 3)


def flat(turns):
    return turns.reshape(FRAMES, -1)


def layouts():
    """{name: arrays} of the same motion."""
    turns, up = poses(), poses(z_up=True)
    smplh = np.delete(up, slice(22, 25), axis=1)  # no jaw, no eyes
    apart = {"left_hand_pose": flat(turns[:, 25:40]), "right_hand_pose": flat(turns[:, 40:])}
    rate, old = {"mocap_frame_rate": np.array(120.0)}, {"mocap_framerate": np.array(120)}
    return {
        "AMASS": rate | {"poses": flat(up), "trans": np.zeros((FRAMES, 3)), "betas": np.zeros(16)},
        "AMASS, SMPL-H": old | {"poses": flat(smplh), "dmpls": np.zeros((FRAMES, 8)), "trans": np.zeros((FRAMES, 3))},
        "AMASS, pieces": rate
        | {
            "root_orient": up[:, 0],
            "pose_body": flat(up[:, 1:22]),
            "pose_hand": flat(up[:, 25:]),
            "pose_jaw": up[:, 22],
            "pose_eye": flat(up[:, 23:25]),
        },
        "BEAT2": rate
        | {
            "poses": flat(turns).astype(np.float32),
            "expressions": np.zeros((FRAMES, 100)),
            "betas": np.zeros(300),
            "model": np.array("smplx2020"),
        },
        "SHOW": rate
        | apart
        | {
            "global_orient": turns[:, :1],
            "body_pose": turns[:, 1:22],
            "jaw_pose": turns[:, 22],
            "leye_pose": turns[:, 23],
            "reye_pose": turns[:, 24],
        },
        "TalkSHOW": rate | apart | {"global_orient": turns[:, 0], "body_pose_axis": flat(turns[:, 1:22])},
        "matrices": rate
        | {
            "global_orient": matrices(turns[:, :1]),
            "body_pose": matrices(turns[:, 1:22]),
            "right_hand_pose": matrices(turns[:, 40:]),
        },
        "length alone": {"poses": flat(turns), "mocap_time_length": np.array(3.0)},
    }


@pytest.fixture
def read(tmp_path):
    """arrays -> the clip of a mocap take of them, whose file has whatever suffix."""

    def made(arrays, name="take.npz", fps=15.0, **options):
        wavfile.write(tmp_path / "take.wav", 16000, (1000 * np.sin(np.arange(48000) / 20)).astype(np.int16))
        np.savez(tmp_path / "take.npz", **arrays)
        (tmp_path / "take.npz").rename(tmp_path / name)
        return read_mocap_take(tmp_path / name, tmp_path / "take.wav", subject="s", clip="c", fps=fps, **options)

    return made


def forearm(clip):
    at = UPPER55.index
    return clip.positions[:, at["right_wrist"]] - clip.positions[:, at["right_elbow"]]


@quiet
@pytest.mark.parametrize("layout", layouts())
def test_every_layout_is_the_same_swinging_arm(read, layout):
    """From the T-pose the right forearm points to -x; turned about y by a it points to (-cos a, 0, sin a)."""
    arrays = layouts()[layout]
    assert is_smplx(arrays)
    clip = read(arrays, "take.bvh" if layout == "BEAT2" else "take.npz", fps=60.0)
    angle = 0.8 * np.sin(np.pi * np.arange(180) / 60)
    wanted = 0.25 * np.stack([-np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    assert clip.frames == 180
    np.testing.assert_allclose(forearm(clip)[5:-5], wanted[5:-5], atol=1e-3)  # the sinc has one side at the ends
    finger = clip.positions[90, UPPER55.index["right_index_1"]] - clip.positions[90, UPPER55.index["right_index_0"]]
    bent = Rotation.from_euler("Y", angle[90]).apply([-0.043 * np.cos(0.5), -0.043 * np.sin(0.5), 0])
    np.testing.assert_allclose(finger, bent, atol=1e-3)
    assert clip.positions[0, UPPER55.index["head_top"], 1] > 0.6
    assert clip.confidence.min() == 1 and clip.valid.all()


def test_what_is_assumed_is_said(read):
    with pytest.warns(CospeechNotice) as told:
        read({"poses": flat(poses())})
    lines = [str(one.message) for one in told]
    assert any("no frame rate" in line and "30 frames per second are assumed" in line for line in lines)
    assert any("default rest skeleton" in line for line in lines)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "(?s).*(rest skeleton|up axis).*")
        read(layouts()["BEAT2"])


def test_frames_with_nan_are_bridged_and_not_seen(read):
    arrays = layouts()["BEAT2"]
    whole = {key: value.copy() for key, value in arrays.items()}
    arrays["poses"][100] = np.nan
    arrays["poses"][200:232] = np.nan
    with pytest.warns(CospeechNotice, match="33 of 360 frames hold NaN, the first is 100"):
        clip = read(arrays, fps=120.0)
    expected = np.ones(FRAMES, bool)
    expected[[100, *range(200, 232)]] = False
    np.testing.assert_array_equal(clip.valid, expected)
    np.testing.assert_array_equal(clip.confidence[:, 0] > 0, expected)
    assert np.isfinite(clip.positions).all()
    np.testing.assert_allclose(forearm(clip)[90:110], forearm(read(whole, fps=120.0))[90:110], atol=1e-3)
    with pytest.warns(CospeechNotice, match="hold NaN"):
        slow = read(arrays, fps=15.0)
    assert 0 < slow.confidence[:, 0].min(where=slow.valid, initial=1) < 1  # one of eight frames is missing
    assert not slow.valid[27:29].any() and slow.valid[:25].all()


@quiet
def test_hands_of_pca_need_the_users_model(read, tmp_path):
    rest = np.array([smplx_table()["rest"][name] for name in list(smplx_table()["parents"])[:55]])
    model, rng = tmp_path / "SMPLX.npz", np.random.default_rng(0)
    basis, mean = rng.normal(size=(45, 45)), rng.normal(scale=0.1, size=45)
    np.savez(
        model,
        J_regressor=np.eye(55),
        v_template=rest,
        shapedirs=np.zeros((55, 3, 400)),
        hands_componentsl=basis,
        hands_componentsr=basis,
        hands_meanl=mean,
        hands_meanr=mean,
    )
    few = rng.normal(scale=0.1, size=(FRAMES, 12))
    arrays = layouts()["TalkSHOW"] | {"left_hand_pose": few}
    with pytest.raises(CospeechError, match=r"left_hand_pose has 12 numbers .* hands without their PCA.*body_model"):
        read(arrays)
    motion, _ = smplx_animation(arrays, "x.npz", model)
    turned = Rotation.from_quat(motion.rotations[7, 25:40]).as_rotvec()
    np.testing.assert_allclose(turned.ravel(), mean + few[7] @ basis[:12], atol=1e-9)
    assert read(arrays, body_model=model).frames == 45


@quiet
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mocap_frame_rate": np.array(0)}, "mocap_frame_rate is 0, expected frames per second"),
        ({"mocap_frame_rate": np.array("fast")}, "mocap_frame_rate is fast"),
        ({"poses": np.full((FRAMES, 165), np.nan)}, "no frame of its 360 is free of NaN"),
        ({"trans": np.zeros((7, 3))}, r"trans has shape \(7, 3\), expected \(360, 3\)"),
        ({"poses": np.zeros((FRAMES, 77))}, "no SMPL-X parameters"),
    ],
)
def test_files_that_cannot_be_get_one_clear_line(read, change, message):
    with pytest.raises(CospeechError, match=message) as error:
        read(layouts()["BEAT2"] | change)
    assert "take.npz" in str(error.value) and "\n" not in str(error.value)


def test_bvh_without_a_mapping_says_so(tmp_path):
    (tmp_path / "take.npz").write_text("HIERARCHY")
    with pytest.raises(CospeechError, match="needs 'skeleton'"):
        read_mocap_take(tmp_path / "take.npz", tmp_path / "take.wav", subject="s", clip="c")
