"""A clip leaves by one door, and independent readers (pybvh, three.js, the Khronos validator) see what we meant."""

import csv
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pybvh
import pytest

from cospeech.clip import Clip
from cospeech.errors import CospeechError
from cospeech.face.expressions import COSPEECH64
from cospeech.formats.export import export_clip
from cospeech.formats.ik import NAMES, SOURCES, animation_from_clip
from cospeech.skeleton import UPPER55
from tests.formats.figure import clip_of, pose

HERE = Path(__file__).parent
FRAMES = (0, 7, 29)


@pytest.fixture(scope="module")
def clip():
    """Two seconds in which everything turns."""
    rng = np.random.default_rng(5)
    phases = np.arange(30)[:, None] / 6
    turns = {name: 0.5 * np.sin(phases + rng.uniform(0, 6, 3)) * rng.uniform(-1, 1, 3) for name in NAMES}
    return clip_of(pose(30, turns, root=np.array([0.2, 0.9, -0.1]) + 0.05 * np.sin(phases)))


@pytest.fixture(scope="module")
def world(clip):
    """True world positions (30, 55, 3) in metres, in the order of NAMES."""
    return (clip.positions + clip.root[:, None])[:, SOURCES]


@pytest.fixture(scope="module")
def node():
    """Runs a script of this folder under Node.js with its packages; skips where they are missing."""
    modules = Path(os.environ.get("COSPEECH_NODE_MODULES", HERE.parent / "node_modules"))
    if not shutil.which("node"):
        pytest.skip("node is not installed")
    for package in ("three", "gltf-validator"):
        if not (modules / package).is_dir():
            pytest.skip(f"no Node.js package {package} in {modules} (npm install --prefix tests)")

    def run(script, *arguments):
        command = ["node", str(HERE / script), str(modules), *map(str, arguments)]
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout)

    return run


def test_three_js_puts_bvh_joints_where_the_clip_has_them(clip, world, node, tmp_path):
    export_clip(clip, tmp_path / "a.bvh")
    seen = node("three_positions.mjs", tmp_path / "a.bvh", *FRAMES)
    for frame, joints in zip(FRAMES, seen["frames"], strict=True):
        found = np.array([joints[name] for name in NAMES]) / 100  # BVH is in centimetres
        np.testing.assert_allclose(found, world[frame], atol=1e-5)
    assert seen["duration"] == pytest.approx(29 / 15, abs=1e-6)


def test_three_js_puts_glb_joints_and_skin_where_the_clip_has_them(clip, world, node, tmp_path):
    export_clip(clip, tmp_path / "a.glb")
    seen = node("three_positions.mjs", tmp_path / "a.glb", *FRAMES)
    for frame, joints, bones in zip(FRAMES, seen["frames"], seen["bones"], strict=True):
        np.testing.assert_allclose(np.array([joints[name] for name in NAMES]), world[frame], atol=1e-5)
        gaps = np.linalg.norm(np.array(bones)[:, None] - world[frame], axis=-1)
        assert gaps.min(axis=1).max() < 1e-5  # every bone of the mesh starts at a joint
    assert seen["duration"] == pytest.approx(29 / 15, abs=1e-6)


def test_khronos_validator_finds_nothing(clip, node, tmp_path):
    export_clip(clip, tmp_path / "a.glb")
    report = node("validate_glb.mjs", tmp_path / "a.glb")
    issues = report["issues"]
    assert (issues["numErrors"], issues["numWarnings"], issues["numInfos"]) == (0, 0, 0), issues["messages"]
    assert report["info"]["animationCount"] == 1 and report["info"]["hasSkins"]


def test_pybvh_reads_the_bvh_as_the_clip(clip, world, tmp_path):
    export_clip(clip, tmp_path / "a.bvh")
    bvh = pybvh.read_bvh_file(tmp_path / "a.bvh", world_up="+y")
    positions = bvh.joint_positions() / 100
    found = positions[:, [list(bvh.joint_names).index(name) for name in NAMES]]
    np.testing.assert_allclose(found, world, atol=1e-5)
    assert bvh.frame_time == pytest.approx(1 / clip.fps, abs=1e-9)


def test_csv_has_a_named_column_for_every_number(clip, tmp_path):
    clip = Clip(
        **vars(clip) | {"expression": np.random.default_rng(0).uniform(size=(30, 64)), "face_model": "cospeech64"}
    )
    clip.rotation = np.full((30, 3), 0.25)
    export_clip(clip, tmp_path / "a.csv")
    with open(tmp_path / "a.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 30
    assert float(rows[15]["time"]) == 1.0
    wrist = clip.positions[15, UPPER55.index["left_wrist"]]
    assert [float(rows[15][f"left_wrist_{axis}"]) for axis in "xyz"] == pytest.approx(wrist, abs=1e-5)
    assert float(rows[15]["root_y"]) == pytest.approx(clip.root[15, 1], abs=1e-5)
    assert float(rows[3]["head_rotation_z"]) == 0.25
    assert float(rows[4][COSPEECH64[2]]) == pytest.approx(clip.expression[4, 2], abs=1e-5)
    assert len(rows[0]) == 1 + 165 + 3 + 3 + 64


def test_csv_numbers_the_coefficients_of_an_unknown_face_model(clip, tmp_path):
    export_clip(Clip(**vars(clip) | {"expression": np.ones((30, 5)), "face_model": "bfm"}), tmp_path / "a.csv")
    header = (tmp_path / "a.csv").read_text().split("\n")[0]
    assert header.endswith("root_z,e0,e1,e2,e3,e4")


def test_h5_is_the_clip_itself(clip, tmp_path):
    export_clip(clip, tmp_path / "a.h5")
    np.testing.assert_allclose(Clip.read(tmp_path / "a.h5").positions, clip.positions, atol=1e-6)


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".csv"])
def test_same_clip_same_bytes(clip, suffix, tmp_path):
    for name in ("a", "b"):
        export_clip(clip, tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("name", ["a.fbx", "a", "a.mp3"])
def test_an_unknown_suffix_names_the_known_ones(clip, name, tmp_path):
    with pytest.raises(CospeechError, match=r"use \.bvh, \.glb, \.csv, \.h5"):
        export_clip(clip, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_suffix_in_capitals_is_the_same(clip, tmp_path):
    export_clip(clip, tmp_path / "A.BVH")
    assert (tmp_path / "A.BVH").read_text().startswith("HIERARCHY")


def test_a_clip_with_nan_is_refused_by_name(clip, tmp_path):
    broken = Clip(**vars(clip) | {"positions": clip.positions * np.where(np.arange(30) == 4, np.nan, 1)[:, None, None]})
    with pytest.raises(CospeechError, match="positions holds NaN or infinity, first in frame 4"):
        export_clip(broken, tmp_path / "a.bvh")
    assert not list(tmp_path.iterdir())


def test_rest_pose_of_the_bvh_is_a_t_pose(clip, tmp_path):
    export_clip(clip, tmp_path / "a.bvh")
    bvh = pybvh.read_bvh_file(tmp_path / "a.bvh", world_up="+y")
    rest = {name: bvh.rest_pose_positions()[index] for name, index in bvh.node_index.items()}
    arm, hand, tip = (np.array(rest[name]) for name in ("LeftArm", "LeftHand", "LeftHandMiddle4"))
    for part in (hand - arm, tip - hand):
        assert part[0] / np.linalg.norm(part) == pytest.approx(1.0, abs=1e-3)
    assert rest["HeadTop_End"][1] > rest["Neck"][1] > rest["Hips"][1] > rest["RightUpLeg"][1]


def test_animation_and_export_agree_on_the_frame_count(clip):
    assert len(animation_from_clip(clip)) == clip.frames
