"""GLB: the container, the skeleton, the skin and the motion, read back with a small reader of the published format."""

import json
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cospeech.formats.glb import write_glb
from tests.formats.figure import pose

COMPONENTS = {5126: "<f4", 5123: "<u2", 5125: "<u4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    """A GLB file's JSON (`document`) and its accessors as arrays."""

    def __init__(self, path):
        data = path.read_bytes()
        assert struct.unpack_from("<4sII", data) == (b"glTF", 2, len(data)) and len(data) % 4 == 0
        length, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        self.document = json.loads(data[20 : 20 + length])
        size, kind = struct.unpack_from("<I4s", data, 20 + length)
        assert kind == b"BIN\0" and 28 + length + size == len(data)
        self.binary = data[28 + length :]

    def array(self, index):
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width, dtype = WIDTHS[accessor["type"]], COMPONENTS[accessor["componentType"]]
        values = np.frombuffer(self.binary, dtype, accessor["count"] * width, view["byteOffset"])
        assert values.nbytes == view["byteLength"]
        return values.reshape(-1, width)

    def tracks(self):
        """{(node name, path): (times (T,), values (T, n))}."""
        animation = self.document["animations"][0]
        found = {}
        for channel in animation["channels"]:
            sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
            key = self.document["nodes"][target["node"]]["name"], target["path"]
            found[key] = self.array(sampler["input"])[:, 0], self.array(sampler["output"])
        return found


def waving(frames=20):
    angles = np.sin(np.arange(frames) / 3)[:, None]
    root = np.array([0.1, 0.9, 0.2]) + 0.02 * angles
    return pose(frames, {"LeftArm": angles * [0, 0, 1], "Head": angles * [0, 0.5, 0]}, root=root)


@pytest.fixture
def glb(tmp_path):
    write_glb(tmp_path / "a.glb", waving())
    return Glb(tmp_path / "a.glb")


def test_nodes_are_the_joints_in_their_tree(glb):
    animation, nodes = waving(), glb.document["nodes"]
    assert [node["name"] for node in nodes[:55]] == list(animation.names)
    parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
    assert [parents.get(i, -1) for i in range(55)] == animation.parents.tolist()
    offsets = np.array([node["translation"] for node in nodes[1:55]])
    np.testing.assert_allclose(offsets, animation.offsets[1:])


def test_motion_is_every_joints_rotation_and_the_roots_path(glb):
    animation, tracks = waving(), glb.tracks()
    assert len(tracks) == 56
    for joint, name in enumerate(animation.names):
        times, values = tracks[name, "rotation"]
        np.testing.assert_allclose(times, np.arange(20) / 15.0, atol=1e-6)
        np.testing.assert_allclose(values, animation.rotations[:, joint], atol=1e-6)
    np.testing.assert_allclose(tracks["Hips", "translation"][1], animation.translation, atol=1e-6)


def test_skin_leaves_the_rest_pose_where_it_is_and_moves_with_one_joint(glb):
    document = glb.document
    skin, primitive = document["skins"][0], document["meshes"][0]["primitives"][0]
    assert skin["joints"] == list(range(55))
    attributes = {name: glb.array(index) for name, index in primitive["attributes"].items()}
    places = np.zeros((55, 3))
    for joint, node in enumerate(document["nodes"][:55]):
        places[joint] += node["translation"]
        for child in node.get("children", []):
            places[child] += places[joint]
    inverse = glb.array(skin["inverseBindMatrices"]).reshape(55, 4, 4).transpose(0, 2, 1)
    np.testing.assert_allclose(inverse[:, :3, 3], -places, atol=1e-6)
    np.testing.assert_allclose(attributes["WEIGHTS_0"].sum(axis=1), 1.0)
    owner = attributes["JOINTS_0"][:, 0]
    reach = np.linalg.norm(attributes["POSITION"] - places[owner], axis=1)
    assert reach.max() < 0.31  # no vertex is further from its joint than the longest bone
    np.testing.assert_allclose(np.linalg.norm(attributes["NORMAL"], axis=1), 1.0, atol=1e-6)
    assert glb.array(primitive["indices"]).max() == len(owner) - 1


def test_faces_point_outwards(glb):
    primitive = glb.document["meshes"][0]["primitives"][0]
    corners = glb.array(primitive["attributes"]["POSITION"]).reshape(-1, 8, 3, 3).astype(float)
    normals = glb.array(primitive["attributes"]["NORMAL"]).reshape(-1, 8, 3, 3)[:, :, 0]
    centers = corners.reshape(len(corners), -1, 3).mean(axis=1)
    outward = np.einsum("bfi,bfi->bf", corners.mean(axis=2) - centers[:, None], normals)
    winding = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    assert outward.min() > 0 and np.einsum("bfi,bfi->bf", winding, normals).min() > 0


def test_bounds_are_those_of_the_stored_values(glb):
    bounded = [i for i, accessor in enumerate(glb.document["accessors"]) if "min" in accessor]
    assert len(bounded) == 2  # times and vertex positions, as the format demands
    for index in bounded:
        accessor, values = glb.document["accessors"][index], glb.array(index).astype(float)
        assert accessor["min"] == values.min(axis=0).tolist() and accessor["max"] == values.max(axis=0).tolist()


def test_same_animation_same_bytes_and_one_frame_is_enough(tmp_path):
    for name in ("a.glb", "b.glb"):
        write_glb(tmp_path / name, waving(1))
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()
    assert len(Glb(tmp_path / "a.glb").tracks()["Hips", "rotation"][0]) == 1


def test_moving_offsets_become_translation_tracks(tmp_path):
    animation = waving(6)
    animation.local = np.broadcast_to(animation.offsets, (6, 55, 3)) * np.linspace(1, 1.2, 6)[:, None, None]
    write_glb(tmp_path / "a.glb", animation)
    _, values = Glb(tmp_path / "a.glb").tracks()["LeftHand", "translation"]
    np.testing.assert_allclose(values, animation.local[:, animation.names.index("LeftHand")], atol=1e-6)


def test_rotations_are_unit_quaternions(glb):
    for (_, kind), (_, values) in glb.tracks().items():
        if kind == "rotation":
            np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1.0, atol=1e-6)
            Rotation.from_quat(values)
