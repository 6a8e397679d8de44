"""How fast is pose estimation: each hot path of `cospeech.posenet` against the obvious alternative, in one run.

python benchmarks/bench_posenet.py
"""

import time

import cv2
import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import nn

from cospeech.posenet import camera, metrics
from cospeech.posenet.network import Design, PoseNet, heatmap_targets, level


def seconds(function, repeat=5):
    """The fastest of `repeat` calls."""
    best = float("inf")
    for _ in range(repeat):
        began = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - began)
    return best


def procrustes_by_poses(pred, truth):
    aligned = []
    for p, g in zip(pred - pred.mean(1, keepdims=True), truth - truth.mean(1, keepdims=True), strict=True):
        p = Rotation.align_vectors(g, p)[0].apply(p)
        aligned.append(p * (p * g).sum() / (p * p).sum())
    return np.array(aligned) + truth.mean(1, keepdims=True)


def auc_by_thresholds(pred, truth):
    return np.mean([metrics.pck(pred, truth, threshold) for threshold in metrics.THRESHOLDS])


def crop_by_blur(crop, image):
    image = cv2.GaussianBlur(image, (0, 0), crop.scale / 2)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpPerspective(image, crop.to_image, (crop.size, crop.size), flags=flags)


def targets_by_loops(points, side):
    y, x = torch.meshgrid(*[(2 * torch.arange(side) + 1) / side - 1] * 2, indexing="ij")
    maps = torch.zeros(*points.shape[:2], side, side)
    for b, person in enumerate(points):
        for k, joint in enumerate(person):
            maps[b, k] = torch.exp(-((x - joint[0]) ** 2 + (y - joint[1]) ** 2) * (side / 2) ** 2 / 2)
    return maps


class ResNet50(nn.Module):
    """The bare classifier, for comparison."""

    def __init__(self):
        super().__init__()
        backbone = PoseNet(Design()).backbone
        stem = [backbone.conv1, backbone.bn1, nn.ReLU(), nn.MaxPool2d(3, 2, 1)]
        levels = [backbone.layer1, backbone.layer2, backbone.layer3, level(1024, 512, 3, 2)]
        self.body = nn.Sequential(*stem, *levels, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(2048, 1000))

    def forward(self, x):
        return self.body(x)


def infer(network, images):
    with torch.inference_mode():
        return network(images)


def main():
    rng = np.random.default_rng(0)
    truth = rng.normal(0, 300, (2929, 17, 3))  # as many poses as the 3DHP test set has
    pred = truth + rng.normal(0, 60, truth.shape)
    image = rng.integers(0, 255, (2048, 2048, 3), np.uint8)
    crop = camera.person_crop(rng.uniform(500, 1700, (14, 2)), camera.camera_matrix(1499.2, 2048, 2048))
    points = torch.rand(64, 14, 2) * 2 - 1
    images = torch.rand(4, 3, 256, 256)
    network, classifier = PoseNet().eval(), ResNet50().eval()
    cases = [
        ("Procrustes, 2929 poses (by poses)", lambda: metrics.align(pred, truth, "procrustes"),
         lambda: procrustes_by_poses(pred, truth)),
        ("AUC, 2929 poses (31 times PCK)", lambda: metrics.auc(pred, truth), lambda: auc_by_thresholds(pred, truth)),
        ("crop of 2048 x 2048 (blur, then warp)", lambda: crop.image(image), lambda: crop_by_blur(crop, image)),
        ("heatmap targets, 64 x 14 (loops)", lambda: heatmap_targets(points, 16), lambda: targets_by_loops(points, 16)),
        ("network, 4 crops (bare ResNet-50)", lambda: infer(network, images), lambda: infer(classifier, images)),
    ]  # fmt: skip
    for name, ours, obvious in cases:
        mine, other = seconds(ours), seconds(obvious, 3)
        print(f"{name:40s} {1e3 * mine:9.2f} ms   {other / mine:8.2f} times the speed of the alternative")


if __name__ == "__main__":
    main()
