"""BVH against the independent reader pybvh, against scipy, and against files that are wrong."""

import warnings
from contextlib import nullcontext

import numpy as np
import pybvh
import pytest
from humanoid import bvh_text, person
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.formats.animation import Animation
from cospeech.formats.bvh import read_bvh, write_bvh

quiet = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:pybvh")
SMALL = """HIERARCHY
ROOT hips
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT arm
  {
    OFFSET 10 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 5 0 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.04
0 90 0 0 0 0 90 0 0
0 91 0 0 0 90 0 0 0
"""


@pytest.fixture
def file(tmp_path):
    def write(text, name="take.bvh"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def motion(seed, frames, rows, amount=60.0):
    rng = np.random.default_rng(seed)
    return {name: rng.normal(scale=amount, size=(frames, 3)) for name, _, _ in rows}


def pybvh_positions(path):
    return pybvh.read_bvh_file(str(path)).node_positions()


def test_a_file_small_enough_to_work_out_by_hand(file):
    animation = read_bvh(file(SMALL))
    assert animation.names == ("hips", "arm", "arm_end")
    assert animation.fps == 25
    positions, _ = animation.forward_kinematics()
    np.testing.assert_allclose(positions[0], [[0, 90, 0], [10, 90, 0], [10, 95, 0]], atol=1e-9)  # the arm up: z by 90
    np.testing.assert_allclose(positions[1], [[0, 91, 0], [0, 91, -10], [0, 91, -15]], atol=1e-9)  # all round: y by 90


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_every_order_of_channels_is_read_as_pybvh_and_scipy_read_it(file, order):
    rows = person()
    angles = motion(1, 5, rows)
    path = file(bvh_text(rows, 5, 30, angles, order=order))
    animation = read_bvh(path)
    head = animation.names.index("Head")
    expected = Rotation.from_euler(order, angles["Head"], degrees=True)
    assert (Rotation.from_quat(animation.rotations[:, head]).inv() * expected).magnitude().max() < 1e-6
    np.testing.assert_allclose(animation.forward_kinematics()[0], pybvh_positions(path), atol=1e-6)


def test_real_recording_is_read_as_pybvh_reads_it(recordings):
    path = recordings / "speech_motion/zeggs_067/067_Speech_2_x_1_0.bvh"
    animation = read_bvh(path)
    assert len(animation) == 2065
    assert animation.fps == 30
    np.testing.assert_allclose(animation.forward_kinematics()[0], pybvh_positions(path), atol=1e-6)


def test_position_channels_move_joints_frame_by_frame(file):
    text = SMALL.replace("CHANNELS 3 Z", "CHANNELS 6 Xposition Yposition Zposition Z")
    lines = text.splitlines()
    lines[-2:] = ["0 90 0 0 0 0  10 0 0 90 0 0", "0 91 0 0 0 0  12 1 0 0 0 0"]
    positions, _ = read_bvh(file("\n".join(lines))).forward_kinematics()
    np.testing.assert_allclose(positions[:, 1], [[10, 90, 0], [12, 92, 0]], atol=1e-9)
    np.testing.assert_allclose(positions[:, 2], [[10, 95, 0], [17, 92, 0]], atol=1e-9)
    lines[-2:] = ["0 90 0 0 0 0  0 0 0 90 0 0", "0 91 0 0 0 0  0 0 0 0 0 0"]
    with pytest.warns(CospeechNotice, match="position channels of arm are all zero"):
        assert read_bvh(file("\n".join(lines))).local is None


@pytest.mark.parametrize(
    ("printed", "fps"),
    [
        ("0.0333333", 30),
        ("0.033", 30),
        ("0.008333", 120),
        ("0.00833333", 120),
        ("0.04", 25),
        ("0.1", 10),
        ("0.016667", 60),
        ("0.033367", 30000 / 1001),
        ("3.3333333e-2", 30),
        ("0.01234567", 1 / 0.01234567),
    ],
)
@quiet
def test_frame_times_rounded_in_print_mean_the_rate_they_stand_for(file, printed, fps):
    assert read_bvh(file(SMALL.replace("0.04", printed))).fps == pytest.approx(fps, rel=1e-6)


def printed_rates():
    """Common rates and their frame times with 3 to 7 decimals, less those that are another whole rate: 0.008 s, 125."""
    for rate in (10, 12, 15, 20, 24, 25, 30, 50, 60, 72, 90, 100, 120, 240):
        for decimals in range(3, 8):
            printed = f"{1 / rate:.{decimals}f}"
            whole = round(1 / float(printed))
            if whole == rate or abs(whole * float(printed) - 1) >= 1e-9:
                yield rate, printed


@pytest.mark.parametrize(("rate", "printed"), printed_rates())
@quiet
def test_every_common_rate_survives_the_rounding_of_its_frame_time(file, rate, printed):
    assert read_bvh(file(SMALL.replace("0.04", printed))).fps == rate


@pytest.mark.parametrize(
    ("printed", "fps"), [("0.067", 15), ("0.0667", 15), ("0.066", 15), ("0.016", 60), ("0.0416", 24)]
)
def test_a_guessed_rate_is_told(file, printed, fps):
    with pytest.warns(CospeechNotice, match="taken as") if abs(float(printed) * fps - 1) > 1e-3 else nullcontext():
        assert read_bvh(file(SMALL.replace("0.04", printed))).fps == fps


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_names_in_japanese_are_read(file, tmp_path, encoding):
    text = SMALL.replace("hips", "腰").replace("arm", "右腕")
    (tmp_path / "japanese.bvh").write_bytes(text.encode(encoding))
    assert read_bvh(tmp_path / "japanese.bvh").names == tuple(
        {"hips": "腰", "arm": "右腕", "arm_end": "右腕_end"}.get(name, name) for name in read_bvh(file(SMALL)).names
    )


@pytest.mark.parametrize(("encoding", "arm", "line"), [("shift_jis", "右腕", 6), ("latin-1", "bras_coudé", 6)])
def test_another_encoding_is_told_with_its_line(tmp_path, encoding, arm, line):
    assert SMALL.splitlines()[line - 1].strip() == "JOINT arm"
    (tmp_path / "take.bvh").write_bytes(SMALL.replace("JOINT arm", f"JOINT {arm}").encode(encoding))
    with pytest.raises(CospeechError, match=rf"take\.bvh: line {line} is not UTF-8") as error:
        read_bvh(tmp_path / "take.bvh")
    assert "\n" not in str(error.value)


def cut(text, word):
    return text[: text.index(word)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("RIFF....WAVE", "not a BVH"),
        ("", "not a BVH"),
        (cut(SMALL, "End Site"), "incomplete"),
        (cut(SMALL, "MOTION"), "no MOTION"),
        (SMALL.replace("OFFSET 10 0 0", "OFFSET 10 zero 0"), "'zero' where a number belongs"),
        (SMALL.replace("OFFSET 10 0 0", "OFFSET 10 nan 0"), "OFFSET of joint arm is not a finite number"),
        (SMALL.replace("JOINT arm", "JOINT hips"), "two joints are named 'hips'"),
        (SMALL.replace("3 Zrotation", "3 Wrotation"), "wrotation"),
        (SMALL.replace("Frames: 2", "Frames: two"), "must be numbers"),
        (SMALL.replace("Frame Time: 0.04", "Frame Time: 0"), "frame time is 0 s"),
        (SMALL.replace("Frame Time: 0.04", "Frame Time: -0.04"), "frame time is -0.04 s"),
        (SMALL.replace("Frame Time: 0.04", "Frame Time: nan"), "frame time is nan s"),
        (SMALL.replace("Frames: 2\n", ""), "do not follow MOTION"),
        (cut(SMALL, "0 90 0").replace("Frames: 2", "Frames: 0"), "0 frames"),
        (
            SMALL.replace("0 90 0 0 0 0 90 0 0", "0 90 0 0 0 0 90 0"),
            "line 19 holds 8 numbers, the hierarchy has 9 channels",
        ),
        (SMALL.replace("0 90 0 0 0 0 90 0 0", "0 90 0 0 0 0 9O 0 0"), "line 19 holds '9O'"),
        (SMALL.replace("0 91 0", "0 nan 0"), "line 20 holds 'nan'"),
        (SMALL + SMALL, "line 21 holds 1 numbers"),
    ],
)
@quiet
def test_wrong_files_get_one_clear_line(file, text, message):
    with pytest.raises(CospeechError, match=message) as error:
        read_bvh(file(text))
    assert "take.bvh" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CospeechError, match=r"none\.bvh: no such file"):
        read_bvh(tmp_path / "none.bvh")


def test_a_wrong_frame_count_uses_the_frames_that_are_there(file):
    with pytest.warns(CospeechNotice, match="Frames: 9, but 2 whole lines"):
        assert len(read_bvh(file(SMALL.replace("Frames: 2", "Frames: 9")))) == 2
    with pytest.warns(CospeechNotice, match="Frames: 1, but 2 whole lines"):
        assert len(read_bvh(file(SMALL.replace("Frames: 2", "Frames: 1")))) == 2
    with pytest.warns(CospeechNotice, match="Frames: 2, but 1 whole lines"):
        assert len(read_bvh(file(SMALL[:-8]))) == 1


def test_odd_but_lawful_text_is_read(file):
    plain = read_bvh(file(SMALL))
    odd = "\ufeff" + SMALL.replace("\n", "\r\n").replace("  ", "\t").replace("Frames:", "FRAMES: ") + "\r\n\r\n"
    np.testing.assert_array_equal(read_bvh(file(odd)).rotations, plain.rotations)
    assert read_bvh(file(SMALL.replace("JOINT arm", "JOINT left arm"))).names[1] == "left arm"


def random_animation(seed, joints, frames, moving=False):
    rng = np.random.default_rng(seed)
    parents = np.array([-1] + [rng.integers(0, i) for i in range(1, joints)])
    offsets = rng.normal(scale=0.3, size=(joints, 3))
    local = offsets + rng.normal(scale=0.01, size=(frames, joints, 3)) if moving else None
    rotations = Rotation.random(frames * joints, random_state=seed).as_quat().reshape(frames, joints, 4)
    names = tuple(f"joint{i}" for i in range(joints))
    return Animation(names, parents, offsets, rotations, rng.normal(size=(frames, 3)), 15.0, local)


def by_name(animation):
    positions, _ = animation.forward_kinematics()
    return {name: positions[:, i] for i, name in enumerate(animation.names)}


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6), st.integers(1, 12), st.integers(1, 5), st.sampled_from(["ZYX", "XYZ", "YXZ"]), st.booleans()
)
def test_what_is_written_reads_back(tmp_path_factory, seed, joints, frames, order, moving):
    path = tmp_path_factory.mktemp("bvh") / "a.bvh"
    animation = random_animation(seed, joints, frames, moving)
    write_bvh(path, animation, order=order)
    again, expected = by_name(read_bvh(path)), by_name(animation)
    for name, positions in expected.items():
        np.testing.assert_allclose(again[name], positions * 100, atol=1e-4)
    if not moving:
        other = pybvh.read_bvh_file(str(path))
        found = other.node_positions()
        for name, positions in expected.items():
            np.testing.assert_allclose(found[:, [n.name for n in other.nodes].index(name)], positions * 100, atol=1e-4)


def test_gimbal_lock_is_written_without_loss_and_without_a_word(tmp_path):
    animation = random_animation(0, 3, 4)
    animation.rotations[:] = Rotation.from_euler("ZYX", [33, 90, 21], degrees=True).as_quat()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_bvh(tmp_path / "a.bvh", animation)
    np.testing.assert_allclose(
        by_name(read_bvh(tmp_path / "a.bvh"))["joint2"], by_name(animation)["joint2"] * 100, atol=1e-4
    )


def test_end_sites_come_back_as_end_sites_and_bytes_repeat(file, tmp_path):
    first = read_bvh(file(SMALL))
    write_bvh(tmp_path / "a.bvh", first, scale=1.0)
    write_bvh(tmp_path / "b.bvh", first, scale=1.0)
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()
    again = read_bvh(tmp_path / "a.bvh")
    assert again.names == first.names
    assert again.fps == first.fps
    np.testing.assert_allclose(again.forward_kinematics()[0], first.forward_kinematics()[0], atol=1e-4)


def test_numbers_of_every_size_keep_six_decimals(tmp_path):
    animation = random_animation(0, 1, 4)
    animation.translation = np.array(
        [[0, -0.0, 1e-9], [-1e-9, 12345.6789012, -0.1234567], [99.9999999, -1, 1], [1e6, 0, 0]]
    )
    write_bvh(tmp_path / "a.bvh", animation, scale=1.0)
    np.testing.assert_allclose(read_bvh(tmp_path / "a.bvh").translation, animation.translation, atol=5.1e-7)
    assert "-0.000000" not in (tmp_path / "a.bvh").read_text()


def test_nan_and_empty_animations_are_refused(tmp_path):
    animation = random_animation(0, 2, 3)
    animation.translation[1, 1] = np.nan
    with pytest.raises(CospeechError, match="NaN or infinity"):
        write_bvh(tmp_path / "a.bvh", animation)
    with pytest.raises(CospeechError, match="0 frames"):
        write_bvh(tmp_path / "a.bvh", random_animation(0, 2, 0))
    assert not list(tmp_path.iterdir())


def test_frame_rate_survives_for_an_hour(tmp_path):
    for fps in (15.0, 30000 / 1001, 23.456789, 120.0):
        animation = random_animation(0, 2, 2)
        animation.fps = fps
        write_bvh(tmp_path / "a.bvh", animation)
        assert abs(3600 * fps / read_bvh(tmp_path / "a.bvh").fps - 3600) < 1e-3


def test_an_unwritable_place_is_one_clear_line(tmp_path):
    (tmp_path / "a.bvh").mkdir()
    with pytest.raises(CospeechError, match="cannot be written"):
        write_bvh(tmp_path / "a.bvh", random_animation(0, 2, 2))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bvh"]
