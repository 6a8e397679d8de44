"""Motion capture to clips: people whose motion is known, in several axes, units and hierarchies, and a real take."""

import warnings
from importlib.resources import files

import numpy as np
import pybvh
import pytest
import yaml
from humanoid import bvh_text, person
from scipy.io import wavfile
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.formats.mapping import load_mapping
from cospeech.formats.mocap import check_mapping, read_mocap_take
from cospeech.skeleton import BODY, LEFT_HAND, RIGHT_HAND, UPPER55, bone_lengths, to_parent_relative

J = UPPER55.index
quiet = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")


class Take:
    """Files of one made-up take in a folder of its own."""

    def __init__(self, folder):
        self.folder = folder

    def write(self, rows, fps=120, seconds=4.0, sound=None, mapping="zeggs", **text):
        (self.folder / "take.bvh").write_text(bvh_text(rows, round(seconds * fps), fps, **text))
        rng = np.random.default_rng(0)
        samples = rng.normal(scale=2000, size=round((sound or seconds) * 16000)).astype(np.int16)
        wavfile.write(self.folder / "take.wav", 16000, samples)
        self.mapping = mapping
        return self

    def without(self, *keys, **changed):
        """Use a copy of the mapping without these keys and with these others."""
        table = yaml.safe_load((files("cospeech") / "skeletons/zeggs.yaml").read_text())
        table = {k: v for k, v in table.items() if k not in keys} | changed
        self.mapping = self.folder / "own.yaml"
        self.mapping.write_text(yaml.safe_dump(table))
        return self

    def read(self, **options):
        bvh, wav = self.folder / "take.bvh", self.folder / "take.wav"
        return read_mocap_take(bvh, wav, self.mapping, subject="s", clip="c", **options)


@pytest.fixture
def take(tmp_path):
    return Take(tmp_path)


def ramp(fps, seconds, start, speed, column):
    """(T, 3) degrees for order ZYX: one angle that grows steadily."""
    angles = np.zeros((round(fps * seconds), 3))
    angles[:, column] = start + speed * np.arange(len(angles)) / fps
    return angles


def lively(fps=60, seconds=4.0):
    """A person who turns by 40 degrees, walks, nods and moves arms and fingers smoothly. -> angles, root"""
    t = np.arange(round(fps * seconds)) / fps
    wave = lambda size, hertz, shift=0.0: size * np.sin(2 * np.pi * hertz * t + shift)
    zero = 0 * t
    angles = {
        "Hips": np.stack([zero, 30 + 10 * t, zero], 1),
        "Spine2": np.stack([wave(5, 0.5), zero, wave(8, 0.4)], 1),
        "Head": np.stack([zero, wave(25, 0.7), wave(15, 1.0)], 1),
        "LeftArm": np.stack([-60 + wave(20, 0.8), wave(30, 0.6), zero], 1),
        "RightArm": np.stack([65 + wave(15, 0.9), zero, wave(30, 0.7)], 1),
        "RightForeArm": np.stack([zero, 60 + wave(30, 1.1), zero], 1),
        "LeftHandIndex2": np.stack([-20 + wave(20, 1.0), zero, zero], 1),
    }
    return angles, np.stack([10 * t, 90 + wave(2, 1.0), 20 * t], 1)


def test_a_spinning_arm_is_where_it_must_be(take):
    speed, start = 200.0, 30.0  # degrees a second: several times round, over +-180
    angles = {"LeftArm": ramp(120, 8, start, speed, 0)}
    clip = take.write(person(), seconds=8.0, angles=angles).read()
    assert (clip.frames, clip.fps) == (120, 15)
    theta = np.radians(start + speed * np.arange(120) / 15)
    arm = clip.positions[:, J["left_wrist"]] - clip.positions[:, J["left_shoulder"]]
    np.testing.assert_allclose(arm, 0.54 * np.stack([np.cos(theta), np.sin(theta), 0 * theta], 1), atol=2e-3)
    np.testing.assert_allclose(
        arm[8:-8], 0.54 * np.stack([np.cos(theta), np.sin(theta), 0 * theta], 1)[8:-8], atol=5e-4
    )


def test_tremor_too_fast_for_the_clip_vanishes_instead_of_folding(take):
    t = np.arange(480) / 120
    angles = {"LeftArm": np.stack([10 * np.sin(2 * np.pi * 14 * t), 0 * t, 0 * t], 1)}
    clip = take.write(person(), angles=angles).read()
    wrist = clip.positions[8:-8, J["left_wrist"]]
    assert np.ptp(wrist, axis=0).max() < 1e-4  # every eighth frame would swing by 19 cm


def test_axes_rest_and_root(take):
    clip = take.write(person()).read()
    at = {name: clip.positions[0, i] for name, i in J.items()}
    np.testing.assert_allclose(at["pelvis"], 0, atol=1e-9)
    np.testing.assert_allclose(at["left_wrist"], [0.67, 0.53, -0.02], atol=1e-6)
    np.testing.assert_allclose(at["right_wrist"], [-0.67, 0.53, -0.02], atol=1e-6)
    np.testing.assert_allclose(at["head_top"], [0, 0.82, -0.02], atol=1e-6)
    np.testing.assert_allclose(at["left_thumb_0"] - at["left_wrist"], [0.03, -0.01, 0.03], atol=1e-6)
    np.testing.assert_allclose(at["right_little_3"] - at["right_wrist"], [-0.17, 0, -0.04], atol=1e-6)
    np.testing.assert_allclose(clip.rotation, 0, atol=1e-6)  # the T-pose's head is not turned
    np.testing.assert_allclose(clip.root, np.tile([0, 0.9, 0], (60, 1)), atol=1e-6)
    assert (clip.confidence == 1).all()
    assert clip.valid.all()


def test_heading_is_removed_and_the_root_path_starts_ahead(take):
    """A person turned by 90 degrees to the left who walks ahead, along +x, looks and walks along +z in the clip."""
    t = np.arange(480) / 120
    angles = {"Hips": np.tile([0.0, 90.0, 0.0], (480, 1))}
    clip = take.write(person(), angles=angles, root=np.stack([50 * t, 90 + 0 * t, 0 * t], 1)).read()
    np.testing.assert_allclose(clip.positions[:, J["left_wrist"]], np.tile([0.67, 0.53, -0.02], (60, 1)), atol=1e-5)
    np.testing.assert_allclose(clip.root[30], [0, 0.9, 1.0], atol=1e-3)
    np.testing.assert_allclose(clip.rotation, 0, atol=1e-5)


def test_head_rotation_is_measured_in_the_characters_axes(take):
    """Turned to the back and nodding by 20 degrees: still a rotation about x, the axis to the left."""
    angles = {"Hips": np.tile([0.0, 180.0, 0.0], (480, 1)), "Head": np.tile([0.0, 0.0, 20.0], (480, 1))}
    clip = take.write(person(), angles=angles).read()
    np.testing.assert_allclose(clip.rotation, np.tile([np.radians(20), 0, 0], (60, 1)), atol=1e-5)


@quiet
@pytest.mark.parametrize("scale", [0.01, 1.0, 10.0, 1 / 2.54])
@pytest.mark.parametrize("turn", [None, "z up"])
@pytest.mark.parametrize("fingers", [True, False])
def test_units_and_up_axis_are_guessed_and_make_no_difference(take, scale, turn, fingers):
    angles, root = lively()
    rows = person(fingers)
    plain = take.write(rows, fps=60, angles=angles, root=root).read()
    other = take.write(rows, fps=60, angles=angles, root=root, scale=scale, turn=turn).without("units", "up").read()
    for name in ("positions", "rotation", "root", "confidence", "features"):
        np.testing.assert_allclose(getattr(other, name), getattr(plain, name), atol=2e-5, err_msg=name)


def test_guesses_are_told_and_declarations_overrule(take):
    take.write(person(), scale=0.01).without("units", "up")
    with pytest.warns(CospeechNotice) as told:
        take.read()
    lines = "\n".join(str(w.message) for w in told)
    assert "units are taken as m" in lines
    assert "up axis is taken as y" in lines
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        half = take.read(units="cm", up="y")
    assert half.positions[0, J["head_top"], 1] == pytest.approx(0.0082)
    with pytest.raises(CospeechError, match="units: 'feet'; expected one of m, cm"):
        take.read(units="feet")
    with pytest.raises(CospeechError, match="up: 'w'"):
        take.read(up="w")


def test_beats_hierarchy_is_read_by_its_own_mapping(take):
    angles, root = lively(120)
    rows = person(carpals=True)
    assert ("LeftHandThumb1", "LeftHandIndex") in [row[:2] for row in rows]
    beat = take.write(rows, angles=angles, root=root, mapping="beat", order="XYZ").read()
    zeggs = take.write(person(), angles=angles, root=root, order="XYZ").read()
    np.testing.assert_allclose(beat.positions, zeggs.positions, atol=1e-6)
    assert (beat.confidence == 1).all()


def test_missing_fingers_follow_the_wrist(take):
    down = {"LeftArm": np.tile([-90.0, 0.0, 0.0], (480, 1)), "LeftHand": np.tile([0.0, 0.0, 90.0], (480, 1))}
    take.write(person(fingers=False), angles=down)
    with pytest.warns(CospeechNotice, match="right fingers, left fingers not recorded"):
        clip = take.read()
    assert (clip.confidence[:, BODY] == 1).all()
    assert (clip.confidence[:, RIGHT_HAND][:, 1:] == 0).all()
    right, left = clip.positions[0, RIGHT_HAND], clip.positions[0, LEFT_HAND]
    np.testing.assert_allclose(right[0], clip.positions[0, J["right_wrist"]])
    reach = right[1:] - right[0]
    assert (reach[:, 0] < 0).all()  # a T-pose: right fingers point right,
    assert reach[J["right_thumb_3"] - J["right_hand_root"] - 1, 2] > 0.05  # the thumb forward,
    assert reach[J["right_middle_3"] - J["right_hand_root"] - 1, 1] < -0.02  # and relaxed fingers hang toward the palm
    # The arm hangs, twisted by 90 degrees about itself: fingers down, and what was forward now points aside.
    thumb = left[J["left_thumb_3"] - J["left_hand_root"]] - left[0]
    assert ((left[1:] - left[0])[:, 1] < 0).all()
    assert abs(thumb[0]) > 0.05 > abs(thumb[2])
    lengths = bone_lengths(clip.positions)
    assert np.ptp(np.linalg.norm(to_parent_relative(clip.positions), axis=-1), axis=0)[14:].max() < 1e-5
    assert 0.08 < lengths[J["right_middle_0"]] < 0.12


def test_one_missing_finger_tip_is_added_to_its_finger(take):
    rows = [row for row in person() if row[0] != "LeftHandIndex4"]
    take.write(rows)
    with pytest.warns(CospeechNotice, match="left_index_3 not recorded"):
        clip = take.read()
    assert np.flatnonzero(clip.confidence[0] == 0).tolist() == [J["left_index_3"]]
    tip = clip.positions[0, J["left_index_3"]] - clip.positions[0, J["left_index_2"]]
    assert 0.015 < np.linalg.norm(tip) < 0.03


def test_weights_offsets_end_sites_and_prefixes_in_an_own_mapping(take):
    rows = [(f"someone:{n}", p and f"someone:{p}", o) for n, p, o in person()]
    angles = {"someone:Head": np.tile([0.0, 0.0, 90.0], (480, 1))}  # the face looks down: what was up is ahead
    table = load_mapping("zeggs")
    joints = {name: next(iter(sources)) for name, (sources, _) in table.joints.items()}
    joints |= {
        "pelvis": {"LeftUpLeg": 0.5, "RightUpLeg": 0.5},
        "left_index_3": {"LeftHandIndex4": 2.0, "LeftHandIndex3": -1.0},
        "right_index_3": "RightHandIndex4_end",
        "head_top": {"joint": "Head", "offset": [0.0, 0.1, 0.0]},
    }
    clip = take.write(rows, angles=angles).without("joints", joints=joints).read()
    at = {name: clip.positions[0, i] for name, i in J.items()}
    np.testing.assert_allclose(at["head_top"] - at["head"], [0, 0, 0.1], atol=1e-6)
    np.testing.assert_allclose(at["left_index_3"] - at["left_index_2"], [0.04, 0, 0], atol=1e-6)
    np.testing.assert_allclose(at["right_index_3"] - at["right_index_2"], [-0.02, 0, 0], atol=1e-6)


@quiet
@pytest.mark.parametrize(("own", "prop"), [("ada:", "lamp:"), ("ada:", ""), ("", "lamp:")])
def test_a_props_joint_of_the_same_name_is_not_the_persons(take, own, prop):
    """Whichever comes last in the file: the head is 82 cm above the pelvis, the lamp's 3 m aside."""
    rows = [(own + n, p and own + p, o) for n, p, o in person()]
    plain = take.write(rows).read()
    for extra in (
        [*rows[:1], (f"{prop}Head", f"{own}Hips", (300, 0, 0)), *rows[1:]],
        [*rows, (f"{prop}Head", f"{own}Hips", (300, 0, 0))],
    ):
        np.testing.assert_allclose(take.write(extra).read().positions, plain.positions, atol=1e-6)
    table = load_mapping("zeggs")
    joints = {name: next(iter(sources)) for name, (sources, _) in table.joints.items()}
    aside = take.write([*rows, ("lamp2:Head", f"{own}Hips", (30, 80, 0))]).without(
        "joints", joints=joints | {"head": "lamp2:Head"}
    )
    assert aside.read().positions[0, J["head"], 0] == pytest.approx(0.3)  # a whole name is taken at its word


@quiet
def test_two_people_in_one_file_are_a_doubt(take):
    rows = [(f"ada:{n}", p and f"ada:{p}", o) for n, p, o in person()]
    rows += [(f"bob:{n}", f"bob:{p}" if p else "ada:Hips", o) for n, p, o in person()]
    with pytest.raises(CospeechError, match=r"may be ada:(\w+) or bob:\1; write the joint's whole name") as error:
        take.write(rows).read()
    assert "\n" not in str(error.value)


@quiet
def test_a_number_is_a_unit_and_a_dwarf_is_no_guess(take):
    plain = take.write(person()).read()
    cmu = take.write(person(), scale=0.01 / 0.056444).without("units")
    np.testing.assert_allclose(cmu.read(units=0.056444).positions, plain.positions, atol=1e-5)
    np.testing.assert_allclose(cmu.without("units", units=0.056444).read().positions, plain.positions, atol=1e-5)
    with pytest.raises(
        CospeechError, match=r"no usual unit fits.*as in 'units: 0\.0\d+', in the subject file"
    ) as error:
        cmu.without("units").read()
    size = float(str(error.value).split("units: ")[1].split("'")[0])
    assert size == pytest.approx(0.056444, rel=0.1)  # the person of the test is about the adult's size
    for wrong in (0, -1.0, float("nan"), True, "1e-2"):
        with pytest.raises(CospeechError, match=r"units: .* as a number"):
            cmu.read(units=wrong)


@quiet
def test_a_zero_pose_that_does_not_stand_is_replaced_by_the_first_frame(take):
    """A skeleton that leans by 45 degrees when all rotations are zero, set upright by its hips."""
    lean = Rotation.from_euler("x", 45, degrees=True)
    rows = [(name, parent, tuple(lean.apply(offset))) for name, parent, offset in person(fingers=False)]
    take.write(rows, angles={"Hips": np.tile([0.0, 0.0, -45.0], (480, 1))})
    with pytest.warns(CospeechNotice, match="first frame serves as the rest pose"):
        clip = take.read()
    np.testing.assert_allclose(clip.positions[0, J["left_wrist"]], [0.67, 0.53, -0.02], atol=1e-5)
    np.testing.assert_allclose(clip.rotation, 0, atol=1e-5)
    fingers = clip.positions[0, J["left_middle_0"]] - clip.positions[0, J["left_wrist"]]
    assert fingers[0] > 0.08


@pytest.mark.parametrize(
    ("seconds", "sound", "options", "frames", "told"),
    [
        (4.0, 4.0, {}, 60, None),
        (4.0, 3.0, {}, 45, "lasts 4.000 s"),
        (3.0, 4.0, {}, 45, "3.000 s"),
        (4.0, 4.02, {}, 60, None),
        (4.0, 4.0, {"start": 1.0, "end": 2.5}, 22, None),
        (4.0, 3.0, {"start": 1.0, "end": 2.5}, 22, None),
        (4.0, 4.0, {"fps": 25.0}, 100, None),
        (4.0, 4.0, {"fps": 240.0}, 960, None),
        (4.0, 3.0, {"end": 4.0}, 45, "what both have is used"),
    ],
)
def test_length_is_what_both_files_have(take, seconds, sound, options, frames, told):
    take.write(person(), seconds=seconds, sound=sound)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        clip = take.read(**options)
    assert clip.frames == frames == len(clip.features)
    lines = "\n".join(str(w.message) for w in seen if w.category is CospeechNotice)
    assert (told in lines) if told else not lines


def test_a_part_of_a_take_is_that_part_of_the_whole(take):
    angles, root = lively(60, 8.0)
    take.write(person(), fps=60, seconds=8.0, angles=angles, root=root)
    (take.folder / "take.tsv").write_text(
        "word\tstart\tend\nbefore\t0.5\t1.0\ninto\t1.9\t2.2\nwithin\t3.0\t3.5\nafter\t6.5\t7.0\n"
    )
    whole, part = take.read(), take.read(start=2.0, end=6.0)
    np.testing.assert_allclose(part.positions, whole.positions[30:90], atol=1e-5)
    np.testing.assert_allclose(part.rotation, whole.rotation[30:90], atol=1e-5)
    assert whole.words.text == ["before", "into", "within", "after"]
    assert part.words.text == ["into", "within"]
    np.testing.assert_allclose(part.words.start, [0.0, 1.0])
    np.testing.assert_allclose(part.words.end, [0.2, 1.5])


def test_where_a_clip_comes_from_is_kept(take, tmp_path):
    clip = take.write(person()).read(audio_path="../media/c.wav")
    clip.write(tmp_path / "c.h5")
    again = type(clip).read(tmp_path / "c.h5")
    assert (again.subject, again.clip, again.source, again.audio) == ("s", "c", "take.bvh", "../media/c.wav")
    assert len(again.source_sha256) == 64
    assert again.sample_rate == 16000
    assert -40 < again.loudness_lufs < 0
    np.testing.assert_array_equal(again.positions, clip.positions)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": 5.0}, "outside the recording"),
        ({"start": 1.0, "end": 9.0}, "outside the recording"),
        ({"start": -1.0}, "0 <= start < end"),
        ({"start": 2.0, "end": 1.0}, "0 <= start < end"),
        ({"start": 3.99}, "0 frames"),
        ({"words": "none.tsv"}, "none.tsv"),
    ],
)
def test_takes_that_cannot_be_get_one_clear_line(take, options, message):
    take.write(person())
    with pytest.raises(CospeechError, match=message) as error:
        take.read(**options)
    assert "\n" not in str(error.value)


def test_a_mapping_that_does_not_fit_names_what_is_missing(take):
    rows = [(n.replace("ForeArm", "LowerArm"), p and p.replace("ForeArm", "LowerArm"), o) for n, p, o in person()]
    take.write(rows)
    with pytest.raises(CospeechError, match=r"no joint RightForeArm \(right_elbow\), LeftForeArm \(left_elbow\)"):
        take.read()


def test_swapped_sides_are_noticed(take):
    swap = lambda n: n and n.replace("Left", "#").replace("Right", "Left").replace("#", "Right")
    take.write([(swap(n), swap(p), o) for n, p, o in person()])
    with pytest.raises(CospeechError, match="left and right are swapped"):
        take.read()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: [1, 2]", "not a joint mapping"),
        ("joints: {pelvis: [", "not readable as YAML"),
        ("joints: {pelvis: Hips}", "head_top, neck, right_shoulder"),
        ("unit: cm\njoints: {}", "unknown key 'unit'"),
        ("joints: {tail: Tail}", "'tail' is no joint of upper55"),
        ("joints: {pelvis: {A: 0.5, B: 0.6}}", "weights add up to 1.1"),
        ("joints: {pelvis: 3}", "expected a joint's name"),
        ("joints: {pelvis: {joint: A, offset: [1, 2]}}", r"offset: \[x, y, z\]"),
    ],
)
def test_wrong_mapping_files_get_one_clear_line(tmp_path, text, message):
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(CospeechError, match=message) as error:
        load_mapping(tmp_path / "own.yaml")
    assert "own.yaml" in str(error.value)
    assert "\n" not in str(error.value)
    with pytest.raises(CospeechError, match="no such joint mapping"):
        load_mapping("nobody")
    with pytest.raises(CospeechError, match="no such joint mapping"):
        load_mapping(tmp_path / "none.yaml")


@pytest.fixture(scope="module")
def zeggs(recordings):
    folder = recordings / "speech_motion/zeggs_067"
    return folder / "067_Speech_2_x_1_0.bvh", folder / "067_Speech_2_x_1_0.wav"


@pytest.fixture(scope="module")
def zeggs_clip(zeggs):
    return read_mocap_take(*zeggs, "zeggs", subject="zeggs", clip="067")


def test_real_take_is_a_person_who_faces_us(zeggs_clip):
    clip = zeggs_clip
    assert clip.frames == 1032 == round(68.8333125 * 15)
    mean = clip.positions.mean(axis=0)
    assert (mean[[i for n, i in J.items() if n.startswith("left_")], 0] > 0.05).all()
    assert (mean[[i for n, i in J.items() if n.startswith("right_")], 0] < -0.05).all()
    assert mean[J["pelvis"], 1] < mean[J["spine"], 1] < mean[J["neck"], 1] < mean[J["head"], 1] < mean[J["head_top"], 1]
    for side in ("left", "right"):
        wrist = clip.positions[:, J[f"{side}_wrist"]]
        assert (wrist[:, 1] < clip.positions[:, J["head_top"], 1] + 0.1).all()
        assert np.median(wrist[:, 1]) < mean[J["head"], 1]
        assert np.median(wrist[:, 2]) > 0.1  # she talks with her hands before her
    across = clip.positions[:, J["left_shoulder"]] - clip.positions[:, J["right_shoulder"]]
    assert np.degrees(np.abs(np.arctan2(across[:, 2], across[:, 0]).mean())) < 5
    assert 0.75 < clip.root[:, 1].mean() < 1.0
    assert np.degrees(np.linalg.norm(clip.rotation, axis=1)).max() < 60
    assert np.isfinite(clip.features).all()


def test_real_bones_keep_their_length(zeggs_clip):
    lengths = np.linalg.norm(to_parent_relative(zeggs_clip.positions), axis=-1)
    span = dict(zip(UPPER55.names, np.ptp(lengths, axis=0), strict=True))
    bending = {
        "head_top",
        "neck",
        "spine",
        "head",
        "right_shoulder",
        "left_shoulder",
    }  # across several joints of the file
    assert max(v for name, v in span.items() if name not in bending) < 1e-5
    assert max(span[name] for name in ("head_top", "neck", "spine", "head")) < 6e-3
    assert lengths[:, J["left_elbow"]].mean() == pytest.approx(0.2872, abs=1e-4)  # the file's own offsets
    assert lengths[:, J["right_index_1"]].mean() == pytest.approx(0.0406, abs=1e-4)


def test_real_positions_are_those_of_pybvh(zeggs, zeggs_clip):
    """Without heading: distances between joints, at the frames that both have, up to what 15 Hz cannot carry."""
    other = pybvh.read_bvh_file(str(zeggs[0]))
    names = [node.name for node in other.nodes]
    world = other.node_positions()[::2][:1032] / 100
    pairs = [("LeftHand", "Hips", "left_wrist", "pelvis"), ("RightHand", "Head", "right_wrist", "head")]
    for a, b, ours, theirs in pairs:
        truth = np.linalg.norm(world[:, names.index(a)] - world[:, names.index(b)], axis=-1)
        found = np.linalg.norm(zeggs_clip.positions[:, J[ours]] - zeggs_clip.positions[:, J[theirs]], axis=-1)
        assert np.abs(truth - found).mean() < 1e-3


def test_check_mapping_tells_the_bones_of_a_recording(zeggs):
    bones = check_mapping("zeggs", zeggs[0])
    assert list(bones) == list(UPPER55.names)
    assert bones["left_wrist"] == (pytest.approx(0.2572, abs=1e-4), pytest.approx(0, abs=1e-6))
    assert bones["spine"][1] < 0.006
