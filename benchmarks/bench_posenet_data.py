"""How fast does data reach the pose network: store and augmentation against the obvious alternatives, in one run.

python benchmarks/bench_posenet_data.py
"""

import tempfile
from pathlib import Path

import cv2
import h5py
import numpy as np
import torch
from timing import fastest

from cospeech.posenet.camera import camera_matrix, person_crop
from cospeech.posenet.network import PoseNet
from cospeech.posenet.samples import Batch
from cospeech.posenet.store import Store, write_store
from cospeech.posenet.training import pose_losses as losses
from cospeech.posenet.training.augment import augment

COUNT, SIDE, SIZE, BATCH = 256, 384, 256, 10


def picture(rng, side):
    """An image with the spectrum of photographs."""
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side)) + 1 / side
    noise = np.fft.fft2(rng.normal(size=(3, side, side))) / frequency**1.2
    image = np.fft.ifft2(noise).real.transpose(1, 2, 0)
    return np.clip(127 + 45 * image / image.std(), 0, 255).astype(np.uint8)


def crops(rng):
    pictures = np.stack([picture(rng, SIDE) for _ in range(16)])
    return Batch(
        pictures[np.arange(COUNT) % 16],
        rng.uniform(0, SIDE, (COUNT, 14, 2)).astype(np.float32),
        np.ones((COUNT, 14), bool),
        rng.normal(0, 300, (COUNT, 21, 3)).astype(np.float32),
        np.ones(COUNT, bool),
    )


def from_full_frames(path, frames, rng):
    """No store: every sample's image file is decoded and its crop cut out, each time."""
    camera = camera_matrix(1499.2, frames[0].shape[1], frames[0].shape[0])
    for _ in range(BATCH):
        image = cv2.imread(str(path))
        person_crop(rng.uniform(600, 1400, (14, 2)), camera, SIDE).image(image)


def augment_by_torch(batch, rng):
    """Rotation, zoom and shift by grid_sample on float images."""
    images = torch.from_numpy(batch.images).permute(0, 3, 1, 2).float()
    angle = torch.from_numpy(rng.uniform(-0.5, 0.5, len(batch)).astype(np.float32))
    rows = [
        torch.stack([angle.cos(), -angle.sin(), 0 * angle], 1),
        torch.stack([angle.sin(), angle.cos(), 0 * angle], 1),
    ]
    grid = torch.nn.functional.affine_grid(torch.stack(rows, 1), (len(batch), 3, SIZE, SIZE), align_corners=False)
    return torch.nn.functional.grid_sample(images, grid, align_corners=False).byte()


def training_step(network, optimizer, batch):
    images = torch.from_numpy(batch.images).permute(0, 3, 1, 2).float() / 255
    output = network(images)
    loss = losses.pose_loss(output.pose, torch.from_numpy(batch.joints3d) / 1000) + output.heatmaps.square().mean()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


def report(name, mine, other):
    print(f"{name:56s} {1e3 * mine:9.2f} ms   {other / mine:8.2f} times the speed of the alternative")


def main():
    rng = np.random.default_rng(0)
    made = crops(rng)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        write_store(
            folder / "store.h5", [made[i : i + 32] for i in range(0, COUNT, 32)], part="body", source="benchmark"
        )
        store = Store(folder / "store.h5")
        with h5py.File(folder / "raw.h5", "w") as file:
            file.create_dataset("images", data=made.images, chunks=(1, SIDE, SIDE, 3))
        frame = picture(rng, 2048)
        cv2.imwrite(str(folder / "frame.jpg"), frame)
        index = rng.permutation(COUNT)[:BATCH]
        load = fastest(lambda: store[index])
        with h5py.File(folder / "raw.h5") as file:
            raw = fastest(lambda: [file["images"][i] for i in index])
        report(
            f"{BATCH} crops of {SIDE} (decode and crop full frames)",
            load,
            fastest(lambda: from_full_frames(folder / "frame.jpg", [frame], rng), 2),
        )
        report(f"{BATCH} crops of {SIDE} (raw pixels, in the page cache)", load, raw)
        bytes_ = [(folder / name).stat().st_size / COUNT / 1e3 for name in ("store.h5", "raw.h5")]
        print(f"{'kB a crop, and raw':56s} {bytes_[0]:9.1f} kB   {bytes_[1]:8.1f} kB")
    batch = made[:BATCH]
    move = fastest(lambda: augment(batch, rng, SIZE, margin=1.5))
    report(
        f"augmentation of {BATCH} crops to {SIZE} (torch grid_sample)",
        move,
        fastest(lambda: augment_by_torch(batch, rng)),
    )
    network = PoseNet()
    optimizer = torch.optim.Adadelta(network.parameters(), 0.05, rho=0.9)
    small = augment(batch, rng, SIZE, margin=1.5)
    step = fastest(lambda: training_step(network, optimizer, small), 2)
    share = (load + move) / step
    print(f"{'training step of the full network, batch 10':56s} {1e3 * step:9.2f} ms   data is {share:.2%} of it")


if __name__ == "__main__":
    main()
