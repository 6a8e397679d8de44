"""How fast is pose estimation: each hot path of `cospeech.posenet` against the obvious alternative, in one run.

python benchmarks/bench_posenet.py
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np
import torch
from scipy.spatial.transform import Rotation
from timing import fastest, timed
from torch import nn

from cospeech.learning.training import autocast
from cospeech.learning.weights import OnnxNetwork, export_onnx
from cospeech.people.synthetic import write_people
from cospeech.posenet import camera
from cospeech.posenet.evaluation import pose_metrics as metrics
from cospeech.posenet.network import Design, PoseNet, heatmap_targets, level
from cospeech.posenet.onnx_export import INPUT, OUTPUTS, Exported
from cospeech.posenet.training.loader import Mixture
from cospeech.posenet.training.stages import PoseTask, Settings


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
        (
            "Procrustes, 2929 poses (by poses)",
            lambda: metrics.align(pred, truth, "procrustes"),
            lambda: procrustes_by_poses(pred, truth),
        ),
        ("AUC, 2929 poses (31 times PCK)", lambda: metrics.auc(pred, truth), lambda: auc_by_thresholds(pred, truth)),
        ("crop of 2048 x 2048 (blur, then warp)", lambda: crop.image(image), lambda: crop_by_blur(crop, image)),
        ("heatmap targets, 64 x 14 (loops)", lambda: heatmap_targets(points, 16), lambda: targets_by_loops(points, 16)),
        ("network, 4 crops (bare ResNet-50)", lambda: infer(network, images), lambda: infer(classifier, images)),
    ]
    for name, ours, obvious in cases:
        mine, other = fastest(ours), fastest(obvious, 3)
        print(f"{name:40s} {1e3 * mine:9.2f} ms   {other / mine:8.2f} times the speed of the alternative")
    through_onnxruntime(network, classifier)
    training_step()
    widths()
    if torch.cuda.is_available():
        on_a_gpu(network)


def through_onnxruntime(network, classifier, threads=2):
    """Both networks as ONNX on the same crop, in turns, so that what else the machine does hits both alike."""
    crops, sessions = torch.rand(1, 3, 256, 256), []
    with tempfile.TemporaryDirectory() as folder:
        for name, module, outputs in (("posenet", Exported(network), OUTPUTS), ("resnet50", classifier, ("scores",))):
            path = Path(folder) / f"{name}.onnx"
            export_onnx(module, path, {INPUT: torch.rand(2, 3, 256, 256)}, outputs, {"model": name}, sequences=False)
            sessions.append(OnnxNetwork(path, threads))
        best = [float("inf")] * 2
        for _ in range(30):
            for i, session in enumerate(sessions):
                best[i] = min(best[i], fastest(lambda run=session: run(images=crops.numpy()), 1))
    print(
        f"onnxruntime, {threads} threads, a crop of 256 x 256: network {1e3 * best[0]:.1f} ms, bare ResNet-50 "
        f"{1e3 * best[1]:.1f} ms, ratio {best[0] / best[1]:.2f}"
    )


def training_step(steps=40):
    """Seconds of a step of the demo budget's network, and the share of them that the data holds it up."""
    settings = Settings(
        pretraining=0,
        steps=steps,
        batch=32,
        optimizer="adam",
        input=64,
        blocks=(1, 1, 2),
        width=16,
        free=18,
        latent=256,
        camera=64,
    )
    with tempfile.TemporaryDirectory() as folder:
        write_people(f"{folder}/people.h5", "body", {"studio": 128, "wild": 128}, size=64, seed=0)
        task = PoseTask(Mixture([f"{folder}/people.h5"]), settings, 0)
        for step in range(5):
            task.iterate(step, None)
        before = task.loader.waited
        took, _ = timed(lambda: [task.iterate(step, None) for step in range(5, steps)])
        waited = task.loader.waited - before
        drawn, _ = timed(lambda: task.draw(0))
        task.loader.close()
    print(
        f"training step, 32 people of 64 x 64: {1e3 * took / (steps - 5):.1f} ms, waiting for data "
        f"{100 * waited / took:.1f} %; making a mini-batch takes {1e3 * drawn:.1f} ms in its thread"
    )


def widths(rounds=5, batch=64):
    """Images per second of training steps in bfloat16 by width, in turns: 16, of the demo budget, beside wider ones."""
    torch.set_num_threads(2)
    steps, best = {}, {}
    for width in (16, 24, 32):
        network = PoseNet(Design(input=64, blocks=(1, 1, 2), width=width, free=18, latent=256, camera=64))
        network = network.to(memory_format=torch.channels_last)
        optimizer = torch.optim.Adam(network.parameters(), fused=True)
        images = torch.rand(batch, 3, 64, 64).contiguous(memory_format=torch.channels_last)

        def step(network=network, optimizer=optimizer, images=images):
            with autocast(half=True):
                output = network(images)
            optimizer.zero_grad()
            sum(part.float().square().mean() for part in (output.pose, output.points, output.heatmaps)).backward()
            optimizer.step()

        steps[width] = step
    for _ in range(rounds):
        for width, step in steps.items():
            best[width] = min(best.get(width, 1e9), fastest(step, 3))
    print(
        "training, 64 x 64, 2 threads, images/s by width: "
        + ", ".join(
            f"{width}: {batch / took:.0f} ({took / best[16]:.2f} times the time of 16)" for width, took in best.items()
        )
    )


def on_a_gpu(network):
    """Images per second of the full network in mixed precision, by batch size."""
    network = network.cuda().to(memory_format=torch.channels_last)
    for batch in (1, 8, 32, 128, 512):
        images = torch.rand(batch, 3, 256, 256, device="cuda").to(memory_format=torch.channels_last)

        def run(images=images):
            with autocast():
                infer(network, images)
            torch.cuda.synchronize()

        fastest(run, 3)
        print(f"GPU, mixed precision, batch {batch:3d}: {batch / fastest(run, 10):9.0f} images/s")


if __name__ == "__main__":
    main()
