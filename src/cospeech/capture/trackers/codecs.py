"""From a network's outputs to points: pure numpy, one function a way of coding. N crops, K points.

Every decoder takes {output name: array} and the manifest's `codec` entry, and returns (points, score): points (N, K, 2)
or (N, K, 3) in pixels of the crop (and metres for what comes third), score (N, K) clipped to 0..1.
"""

import numpy as np

RTMW3D_DEPTH = 2.1744869  # metres from the middle bin to the first; mmpose's codec SimCC3DLabel


def simcc2d(outputs, codec):
    """SimCC: a classification of each coordinate into `split` bins a pixel (RTMPose). Score: the mean of both maxima.

    x (N, K, split * W), y (N, K, split * H).
    """
    x, y, split = outputs[codec["x"]], outputs[codec["y"]], codec.get("split", 2.0)
    points = np.stack([x.argmax(-1), y.argmax(-1)], -1) / split
    return points.astype(np.float32), np.clip((x.max(-1) + y.max(-1)) / 2, 0, 1)


def simcc3d(outputs, codec):
    """SimCC with depth (RTMW3D). Score: the smaller of the maxima in x and y, as its authors take it.

    x (N, K, split * W), y (N, K, split * H), z (N, K, B): depth in metres = (2 bin / B - 1) * `depth`, so that the
    middle bin is 0, the depth of the middle of the hips. (Dividing by the crop's height instead, as some ports do,
    shifts and shrinks it.)
    """
    x, y, z = (outputs[codec[axis]] for axis in "xyz")
    split, depth = codec.get("split", 2.0), codec.get("depth", RTMW3D_DEPTH)
    metres = (2.0 * z.argmax(-1) / z.shape[-1] - 1.0) * depth
    points = np.stack([x.argmax(-1) / split, y.argmax(-1) / split, metres], -1)
    return points.astype(np.float32), np.clip(np.minimum(x.max(-1), y.max(-1)), 0, 1)


def heatmap(outputs, codec):
    """Heatmaps (N, K, h, w) of a crop of `size` (W, H): their maxima, refined by a parabola through the neighbours.

    Pixel centres of map and crop are aligned at the corners of the picture: crop = (map + 0.5) * W / w - 0.5.
    """
    maps = outputs[codec["maps"]]
    count, joints, height, width = maps.shape
    flat = maps.reshape(count, joints, -1)
    best = flat.argmax(-1)
    row, column = best // width, best % width
    grid = np.ix_(range(count), range(joints))

    def refined(at, size, value):
        """Position of the top of the parabola through three neighbours, at most half a cell away."""
        inner = np.clip(at, 1, size - 2)
        left, middle, right = value(inner - 1), value(inner), value(inner + 1)
        bend = left - 2 * middle + right
        shift = np.divide(0.5 * (left - right), bend, out=np.zeros_like(bend), where=bend < -1e-9)
        return np.where((at == inner) & (size > 2), at + np.clip(shift, -0.5, 0.5), at)

    x = refined(column, width, lambda c: maps[*grid, row, np.clip(c, 0, width - 1)].astype(float))
    y = refined(row, height, lambda r: maps[*grid, np.clip(r, 0, height - 1), column].astype(float))
    points = (np.stack([x, y], -1) + 0.5) * np.array(codec["size"]) / (width, height) - 0.5
    return points.astype(np.float32), np.clip(flat.max(-1), 0, 1)


def direct(outputs, codec):
    """Coordinates themselves: (N, K * D) or (N, K, D), D = `columns` of them a point, x and y first.

    `unit`: "crop" (pixels), "unit" (0..1 of the crop) or "symmetric" (-1..1). A column listed as `score` is one; an
    output named by `scores` gives them, else they are 1. `depth_scale` turns the third coordinate into metres.
    """
    columns, size = codec["columns"], np.array(codec["size"], np.float32)
    values = outputs[codec["points"]]
    values = values.reshape(len(values), -1, len(columns)).astype(np.float32)
    column = {name: values[..., i] for i, name in enumerate(columns)}
    scale, shift = {"crop": (1.0, 0.0), "unit": (size, 0.0), "symmetric": (size / 2, size / 2)}[codec["unit"]]
    points = np.stack([column["x"], column["y"]], -1) * scale + shift
    if "z" in column:
        points = np.concatenate([points, column["z"][..., None] * codec.get("depth_scale", 1.0)], -1)
    score = column.get("score", np.ones(points.shape[:2], np.float32))
    if "scores" in codec:
        score = outputs[codec["scores"]].reshape(score.shape)
    return points.astype(np.float32), np.clip(score, 0, 1)


def pose(outputs, codec):
    """Our own pose networks (docs/posenet.md). Returns (pixels (N, K, 2), metres from the root (N, K, 3), score).

    points (N, K, 2): -1..1 between the outer edges of the crop's pixels; pose (N, K, 3) in millimetres; maps
    (N, M, h, w): heatmaps of the points `mapped`, whose maxima are their confidence; the others take the mean.
    """
    points, size = outputs[codec["points"]], np.array(codec["size"], np.float32)
    certain = np.clip(outputs[codec["maps"]].max(axis=(2, 3)), 0, 1)
    score = np.repeat(certain.mean(axis=1, keepdims=True), points.shape[1], axis=1)
    score[:, codec["mapped"]] = certain
    return ((points + 1) * size - 1) / 2, outputs[codec["pose"]] / 1000, score


def coefficients(outputs, codec):
    """A face model's coefficients: slices [first, end) of one vector. Returns (expression (N, E), angles (N, 3))."""
    vector = outputs[codec["vector"]]
    (first, last), (start, end) = codec["expression"], codec["angles"]
    return vector[:, first:last].astype(np.float32), vector[:, start:end].astype(np.float32)


POINTS = {"simcc2d": simcc2d, "simcc3d": simcc3d, "heatmap": heatmap, "direct": direct}
