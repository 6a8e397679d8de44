"""GLB (binary glTF 2.0) out: skeleton, a simple mesh skinned to it, and one animation. Metres, Y up, +Z forward."""

import json
import struct
from pathlib import Path

import numpy as np

from cospeech import __version__
from cospeech.files import writing

FLOAT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5123, 5125  # glTF component types
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963  # glTF buffer view targets
SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [5, 1, 2], [5, 2, 3], [5, 3, 4], [5, 4, 1]])


def write_glb(path, animation):
    """Write an `Animation` as one GLB that Blender, Unreal, Unity and browsers open without a plug-in.

    Each joint is a node of its name, skinned to a mesh of one octahedron a bone; the rest pose is the animation's, with
    the root where its first frame has it. Every joint has a rotation track, the root a translation track (all joints,
    where the offsets themselves are animated). Same animation, same bytes.
    """
    binary = _Binary()
    document = {
        "asset": {"version": "2.0", "generator": f"cospeech {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0, len(animation.names)]}],
        "nodes": [*_joint_nodes(animation), {"name": "Bones", "mesh": 0, "skin": 0}],
        "meshes": [{"name": "Bones", "primitives": [_mesh(animation, binary)]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0}}],
        "skins": [_skin(animation, binary)],
        "animations": [_motion(animation, binary)],
    }
    document |= {"accessors": binary.accessors, "bufferViews": binary.views, "buffers": [{"byteLength": binary.size}]}
    text = json.dumps(document, separators=(",", ":")).encode()
    chunks = [_chunk(b"JSON", text, b" "), _chunk(b"BIN\0", b"".join(binary.parts), b"\0")]
    with writing(Path(path)) as temporary:
        temporary.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + sum(map(len, chunks))) + b"".join(chunks))


def _chunk(kind, data, padding):
    data += padding * (-len(data) % 4)
    return struct.pack("<I4s", len(data), kind) + data


class _Binary:
    """The binary chunk and the accessors that describe it, filled array by array."""

    def __init__(self):
        self.parts, self.views, self.accessors, self.size = [], [], [], 0

    def add(self, array, component=FLOAT, target=None, bounds=False):
        """Append an array (N, ...) and return the index of its accessor."""
        dtype = {FLOAT: "<f4", UNSIGNED_SHORT: "<u2", UNSIGNED_INT: "<u4"}[component]
        array = np.ascontiguousarray(array, dtype)
        view = {"buffer": 0, "byteOffset": self.size, "byteLength": array.nbytes}
        self.views.append(view | ({"target": target} if target else {}))
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(array)}
        accessor["type"] = SHAPES[array.shape[1:]]
        if bounds:  # float32 values as they are stored, which the format asks to match exactly
            rows = array.reshape(len(array), -1).astype(float)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        self.parts.append(array.tobytes() + b"\0" * (-array.nbytes % 4))
        self.size += len(self.parts[-1])
        return len(self.accessors) - 1


def _joint_nodes(animation):
    nodes = [{"name": name} for name in animation.names]
    for joint, parent in enumerate(animation.parents):
        offset = animation.translation[0] if parent < 0 else animation.offsets[joint]
        nodes[joint]["translation"] = np.asarray(offset, float).tolist()
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(joint)
    return nodes


def _rest_positions(animation):
    """World positions (J, 3) of the joints in the rest pose."""
    positions = np.array(animation.offsets, float)
    positions[0] = animation.translation[0]
    for joint, parent in enumerate(animation.parents[1:], 1):
        positions[joint] += positions[parent]
    return positions


def _skin(animation, binary):
    inverse = np.tile(np.eye(4), (len(animation.names), 1, 1))
    inverse[:, 3, :3] = -_rest_positions(animation)  # column-major, so the translation is the last row
    return {"inverseBindMatrices": binary.add(inverse), "skeleton": 0, "joints": list(range(len(animation.names)))}


def _mesh(animation, binary):
    """One octahedron from each joint to each of its children, moved by the joint alone."""
    places, owners = _rest_positions(animation), []
    bones = {}  # two children in one place make one bone
    for joint, parent in enumerate(animation.parents):
        if parent >= 0 and np.linalg.norm(animation.offsets[joint]) > 1e-6:
            bones.setdefault((int(parent), tuple(animation.offsets[joint])), joint)
    owners = np.array([parent for parent, _ in bones])
    corners = _octahedra(places[owners], places[list(bones.values())])[:, FACES]  # (B, 8, 3, 3)
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    joints = np.zeros((corners.size // 3, 4))
    joints[:, 0] = np.repeat(owners, FACES.size)
    weights = np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1))
    attributes = {
        "POSITION": binary.add(corners.reshape(-1, 3), target=ARRAY_BUFFER, bounds=True),
        "NORMAL": binary.add(np.repeat(normals, 3, axis=1).reshape(-1, 3), target=ARRAY_BUFFER),
        "JOINTS_0": binary.add(joints, UNSIGNED_SHORT, ARRAY_BUFFER),
        "WEIGHTS_0": binary.add(weights, target=ARRAY_BUFFER),
    }
    indices = binary.add(np.arange(len(joints)), UNSIGNED_INT, ELEMENT_ARRAY_BUFFER)
    return {"attributes": attributes, "indices": indices, "material": 0}


def _octahedra(heads, tails):
    """Corners (B, 6, 3): head, a ring of four a fifth of the way up, tail. Bones from heads to tails (B, 3)."""
    along = tails - heads
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    across *= 0.1 * np.linalg.norm(along, axis=1, keepdims=True) / np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(along, across) / np.linalg.norm(along, axis=1, keepdims=True)
    ring = heads + 0.2 * along
    return np.stack([heads, ring + across, ring + third, ring - across, ring - third, tails], axis=1)


def _motion(animation, binary):
    frames, joints = animation.rotations.shape[:2]
    times = binary.add(np.arange(frames) / animation.fps, bounds=True)
    moves = {0: animation.translation}
    if animation.local is not None:
        moves |= {joint: animation.local[:, joint] for joint in range(1, joints)}
    tracks = [(joint, "rotation", animation.rotations[:, joint]) for joint in range(joints)]
    tracks += [(joint, "translation", values) for joint, values in moves.items()]
    samplers = [{"input": times, "output": binary.add(values)} for _, _, values in tracks]
    channels = [
        {"sampler": sampler, "target": {"node": joint, "path": kind}} for sampler, (joint, kind, _) in enumerate(tracks)
    ]
    return {"name": "gesture", "samplers": samplers, "channels": channels}
