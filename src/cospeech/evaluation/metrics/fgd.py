"""The feature network of FGD and diversity: a convolutional autoencoder of 34-frame windows of one speaker.

Layers as in TED Expressive's network (HA2G appendix B, Table 9) with the printed slope of 0.2, which released code
misses; trained on the training part only, for a fixed number of iterations, so that no test motion and no test score
has a say in the ruler. A window is seen as unit bone directions: who has longer arms is not farther away.
"""

import hashlib
import json
from dataclasses import asdict, dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics.gesture_metrics import BONES, bone_directions, low_pass
from cospeech.files import sha256
from cospeech.learning.settings import COUNT, POSITIVE, Section, key
from cospeech.learning.training import device, train
from cospeech.learning.weights import load_weights, save_weights
from cospeech.learning.windows import Windows

FRAMES = 34
CHANNELS = 3 * len(BONES)


@dataclass(frozen=True)
class Settings(Section, section="feature_net"):
    """Of the network's training. TED Expressive's: batch 64, latent 128; TED Gesture's: batch 128, latent 32.

    A small latent suits small test parts: a covariance of D dimensions wants several times D independent windows.
    """

    steps: int = key(1000, "iterations", limits=COUNT, published=50_000)
    batch: int = key(32, "windows of 34 frames in each iteration", limits=COUNT, published=64)
    latent: int = key(32, "width of the latent vector, in which FGD is measured", limits=COUNT)
    learning_rate: float = key(5e-4, "of Adam", limits=POSITIVE)


def _layer(layer, width, slope=0.2):
    return nn.Sequential(layer, nn.BatchNorm1d(width), nn.LeakyReLU(slope))


class AutoEncoder(nn.Module):
    """HA2G Table 9: (B, 34, C) -> latent (B, L) -> (B, 34, C). `slope`: of the dense layers' activation below zero."""

    def __init__(self, latent=32, channels=CHANNELS, slope=0.2):
        super().__init__()
        self.encoder = nn.Sequential(
            _layer(nn.Conv1d(channels, 32, 3), 32),
            _layer(nn.Conv1d(32, 64, 3), 64),
            _layer(nn.Conv1d(64, 64, 4, stride=2), 64),
            nn.Conv1d(64, 32, 3),
            nn.Flatten(),
            _layer(nn.Linear(384, 256), 256, slope),
            _layer(nn.Linear(256, 128), 128, slope),
            nn.Linear(128, latent),
        )
        self.decoder = nn.Sequential(
            _layer(nn.Linear(latent, 64), 64, slope),
            nn.Linear(64, 136),
            nn.Unflatten(1, (4, FRAMES)),
            _layer(nn.ConvTranspose1d(4, 32, 3), 32),
            _layer(nn.ConvTranspose1d(32, 32, 3), 32),
            nn.Conv1d(32, 32, 3),
            nn.Conv1d(32, channels, 3),
        )
        self.register_buffer("mean", torch.zeros(channels))

    def encode(self, windows):
        return self.encoder((windows - self.mean).swapaxes(1, 2))

    def forward(self, windows):
        return self.decoder(self.encode(windows)).swapaxes(1, 2) + self.mean


def pose_vectors(positions):
    """What the network sees of a frame: (T, 55, 3) -> (T, 156) float32 unit bone directions."""
    return bone_directions(positions).reshape(len(positions), CHANNELS).astype(np.float32)


class Reconstruction:
    """The training task: L1 + L1 of frame differences, Adam as published.

    The released 0.001 (1 - cosine) is left out: it moves the loss by a thousandth and takes half of the time.
    """

    def __init__(self, windows, network, settings):
        self.windows, self.network, self.batch = windows, network, settings.batch
        self.modules = {"network": network}
        adam = torch.optim.Adam(network.parameters(), settings.learning_rate, betas=(0.5, 0.999))
        self.optimizers = {"network": adam}

    def loss(self, made, real):
        """{term: scalar} of windows (B, 34, C)."""
        return {
            "position": functional.l1_loss(made, real),
            "difference": functional.l1_loss(made.diff(dim=1), real.diff(dim=1)),
        }

    def iterate(self, step, rng):
        real = torch.as_tensor(self.windows.sample(rng, self.batch)["pose"], device=device())
        loss = self.loss(self.network(real), real)
        optimizer = self.optimizers["network"]
        optimizer.zero_grad(set_to_none=True)
        sum(loss.values()).backward()
        optimizer.step()
        return {term: value.detach() for term, value in loss.items()}


@dataclass
class FeatureNet:
    """A trained feature network. `description` says how it was trained; `sha256` names the file it was read from."""

    network: AutoEncoder
    description: dict
    sha256: str = ""

    def encode(self, windows):
        """Latents of windows of pose vectors: (N, 34, 156) -> (N, L) float64."""
        if not len(windows):
            return np.zeros((0, self.description["latent"]))
        batches = np.array_split(windows, -(-len(windows) // 1024))
        with torch.inference_mode():
            latents = [self.network.encode(torch.as_tensor(batch, device=device())) for batch in batches]
        return torch.cat(latents).cpu().numpy().astype(np.float64)

    def latents(self, positions, stride=5):
        """Latents of every `stride`-th window of a motion: (T, 55, 3) -> (N, L); none when T < 34."""
        if len(positions) < FRAMES:
            return self.encode(())
        windows = np.lib.stride_tricks.sliding_window_view(pose_vectors(positions), FRAMES, axis=0)[::stride]
        return self.encode(np.ascontiguousarray(windows.swapaxes(1, 2)))

    def save(self, path):
        """Write as safetensors; the description goes into its header."""
        save_weights(path, {k: v.cpu().numpy() for k, v in self.network.state_dict().items()}, self.description)

    @classmethod
    def load(cls, path):
        """Read what `save` wrote; CospeechError when it is something else."""
        tensors, description = load_weights(path)
        if description.get("network") != "fgd":
            raise CospeechError(f"{path}: weights of {description.get('network')!r}, expected the FGD feature network")
        network = AutoEncoder(description["latent"])
        network.load_state_dict({name: torch.as_tensor(array) for name, array in tensors.items()})
        return cls(network.to(device()).eval(), description, sha256(path))


def train_feature_net(clips, settings=None, sigma=1.5, seed=0, checkpoint=None):
    """Train on the valid windows of `clips`, the training part; return (FeatureNet, History).

    `settings`: a `Settings`. `sigma`: the low-pass in frames that evaluation applies to every row. `seed`,
    `checkpoint`: see `training.train`. CospeechError when no clip has 34 valid frames in a row.
    """
    settings = settings or Settings()
    torch.manual_seed(seed)
    sequences = [{"pose": pose_vectors(low_pass(clip.positions, sigma))} for clip in clips]
    windows = Windows(sequences, [clip.valid for clip in clips], FRAMES)
    network = AutoEncoder(settings.latent)
    network.mean = torch.as_tensor(windows.statistics("pose")[0])
    task = Reconstruction(windows, network.to(device()), settings)
    description = {
        "network": "fgd", **asdict(settings), "frames": FRAMES, "fps": clips[0].fps, "sigma": sigma, "seed": seed,
        "windows": len(windows), "motion_sha256": hashlib.sha256(windows.arrays["pose"]).hexdigest(),
    }  # fmt: skip
    history = train(
        task, settings.steps, seed=seed, checkpoint=checkpoint, identity=json.dumps(description, sort_keys=True),
        label=f"{clips[0].subject} feature net",
    )  # fmt: skip
    return FeatureNet(network.eval(), description), history
