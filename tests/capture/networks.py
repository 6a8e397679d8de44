"""Small ONNX graphs with the inputs and outputs of published networks, whose answers can be checked by eye.

Point k is where channel k of the picture (0 red, 1 green, 2 blue) is brightest: the graphs only sort brightness into
each coding, so that whatever comes out of the tracker can be compared with where the dots were drawn.
"""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper


def save(path, nodes, outputs, size, constants=None, batch="n", layout="NCHW"):
    width, height = size
    shape = [batch, 3, height, width] if layout == "NCHW" else [batch, height, width, 3]
    graph = helper.make_graph(
        nodes,
        "dots",
        [helper.make_tensor_value_info("input", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in outputs],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in (constants or {}).items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, path)
    return path


def simcc_network(path, size, points=3, depth_bins=None, split=2, batch="n"):
    """simcc_x (N, K, split W), simcc_y (N, K, split H) and, with `depth_bins` (one a point), simcc_z (N, K, split W).

    K = `points`: the three channels over and over.
    """
    width = size[0]
    repeats = -(-points // 3)
    constants = {
        "tile": np.array([1, repeats, 1, 1], np.int64),
        "start": np.array([0], np.int64),
        "end": np.array([points], np.int64),
        "axis": np.array([1], np.int64),
        "sx": np.array([1, 1, split], np.float32),
        "row": np.array([2], np.int64),
        "column": np.array([3], np.int64),
    }
    nodes = [
        helper.make_node("Tile", ["input", "tile"], ["tiled"]),
        helper.make_node("Slice", ["tiled", "start", "end", "axis"], ["channels"]),
        helper.make_node("ReduceMax", ["channels"], ["along_x"], axes=[2], keepdims=0),
        helper.make_node("ReduceMax", ["channels"], ["along_y"], axes=[3], keepdims=0),
    ]
    for name in "xy":
        nodes.append(
            helper.make_node(
                "Resize",
                [f"along_{name}", "", "sx"],
                [f"simcc_{name}"],
                mode="nearest",
                coordinate_transformation_mode="asymmetric",
                nearest_mode="floor",
            )
        )
    outputs = ["simcc_x", "simcc_y"]
    if depth_bins is not None:
        one_hot = np.zeros((1, points, split * width), np.float32)
        one_hot[0, np.arange(points), depth_bins] = 1
        constants |= {"bins": one_hot, "zero": np.float32(0)}
        nodes += [
            helper.make_node("ReduceMax", ["channels"], ["some"], axes=[2, 3], keepdims=1),
            helper.make_node("Squeeze", ["some", "row"], ["flat"]),
            helper.make_node("Mul", ["flat", "zero"], ["nothing"]),
            helper.make_node("Add", ["nothing", "bins"], ["simcc_z"]),
        ]
        outputs.append("simcc_z")
    del constants["column"]
    if depth_bins is None:
        del constants["row"]
    return save(path, nodes, outputs, size, constants, batch)


def constant_network(path, size, **outputs):
    """Whatever the picture: the same arrays for every crop, under these names."""
    nodes = [
        helper.make_node("ReduceMax", ["input"], ["some"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Mul", ["some", "zero"], ["nothing"]),
    ]
    constants = {"zero": np.float32(0)}
    for name, value in outputs.items():
        value = np.asarray(value, np.float32)[None]
        constants |= {f"{name}_value": value, f"{name}_axes": np.arange(1, value.ndim)}
        nodes += [
            helper.make_node("Unsqueeze", ["nothing", f"{name}_axes"], [f"{name}_column"]),
            helper.make_node("Add", [f"{name}_column", f"{name}_value"], [name]),
        ]
    return save(path, nodes, list(outputs), size, constants)


def dots(places, height=120, width=160, radius=2):
    """Black pictures with a red, a green and a blue dot: places (F, 3, 2) pixels -> (F, H, W, 3) uint8."""
    rows, columns = np.mgrid[:height, :width]
    pictures = np.zeros((len(places), height, width, 3), np.float32)
    for frame, three in enumerate(places):
        for channel, (x, y) in enumerate(three):
            distance = (columns - x) ** 2 + (rows - y) ** 2
            pictures[frame, ..., channel] = 255 * np.exp(-distance / (2 * radius**2))
    return pictures.astype(np.uint8)
