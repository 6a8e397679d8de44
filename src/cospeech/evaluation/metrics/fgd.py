"""The feature networks of FGD and diversity: one convolutional autoencoder of 34-frame windows, in several presets.

Layers as in TED Expressive's network (HA2G appendix B, Table 9) with the printed slope of 0.2, which released code
misses; trained on the training part only, for a fixed number of iterations, so that no test motion and no test score
has a say in what measures it. A window is seen as unit vectors: who has longer arms is not farther away.
"""

import hashlib
import json
from dataclasses import asdict, dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics import expressive
from cospeech.evaluation.metrics.gesture_metrics import BONES, bone_directions, low_pass
from cospeech.files import sha256
from cospeech.gestures.ha2g.dataset.bones import bone_vectors
from cospeech.gestures.ha2g.dataset.levels import level_table
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


@dataclass(frozen=True)
class Preset:
    """What a feature network sees of a motion, and how its training differs.

    table : level table of HA2G whose bone vectors it sees; "" for the 52 bones of `gesture_metrics.BONES`. latent :
    None for the settings'. slope : of the dense layers' activation below zero. cosine : weight of the directions' term.
    stride : frames between the starts of two windows that are compared. settings : the class of its training's.
    """

    table: str = ""
    latent: int | None = None
    slope: float = 0.2
    cosine: float = 0.0
    stride: int = 5
    settings: type = Settings

    @property
    def channels(self):
        """C, the numbers that it sees of a frame."""
        return 3 * level_table(self.table).vectors if self.table else CHANNELS

    def vectors(self, positions, rotation=None):
        """What it sees: (T, 55, 3), head rotation (T, 3) or None -> (T, C) float32 unit vectors."""
        if not self.table:
            return bone_directions(positions).reshape(len(positions), CHANNELS).astype(np.float32)
        vectors = bone_vectors(positions, rotation, level_table(self.table))
        return np.asarray(vectors, np.float32).reshape(len(positions), -1)


OURS = "directions"
# HA2G's: windows 10 frames apart (section 4.1). `expressive` is trained as for TED Expressive (Table 9), `trimodal` as
# for TED Gesture (Yoon et al. 2020). `_compat`: the dense layers' `LeakyReLU(True)` of released code, whose slope is 1:
# their dense part is linear, and published FGDs were measured so.
_HA2G = {"stride": expressive.STRIDE, "settings": expressive.Settings}
PRESETS = {
    "expressive": Preset("expressive43", 128, 0.2, 0.001, **_HA2G),
    "expressive_compat": Preset("expressive43", 128, 1.0, 0.001, **_HA2G),
    "trimodal": Preset("ted10", 32, 0.2, **_HA2G),
    "trimodal_compat": Preset("ted10", 32, 1.0, **_HA2G),
    OURS: Preset(),
}


def preset_of(name):
    """One of `PRESETS`; CospeechError that lists them."""
    if name not in PRESETS:
        raise CospeechError(f"feature network {name!r} is not known; known: {', '.join(PRESETS)}")
    return PRESETS[name]


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


class Reconstruction:
    """The training task: L1 + L1 of frame differences, Adam as published; the rate falls to a tenth `decays` times.

    cosine : weight of the sum of (1 - cosine) over a window's directions, 0.001 as released. The sum, not the mean: for
    42 bones and 34 frames it weighs 1.4 times their mean. Our own network goes without: of its loss it is a thousandth,
    and half of the time.
    """

    def __init__(self, windows, network, settings, cosine=0.0):
        self.windows, self.network, self.batch, self.cosine = windows, network, settings.batch, cosine
        decays = getattr(settings, "decays", 0)  # our own network's rate stays as it is
        self.rate, self.interval = settings.learning_rate, -(-settings.steps // (decays + 1))
        self.modules = {"network": network}
        adam = torch.optim.Adam(network.parameters(), settings.learning_rate, betas=(0.5, 0.999))
        self.optimizers = {"network": adam}

    def loss(self, made, real):
        """{term: scalar} of windows (B, 34, C)."""
        loss = {
            "position": functional.l1_loss(made, real),
            "difference": functional.l1_loss(made.diff(dim=1), real.diff(dim=1)),
        }
        if self.cosine:
            cosines = functional.cosine_similarity(made.unflatten(2, (-1, 3)), real.unflatten(2, (-1, 3)), dim=-1)
            loss["direction"] = self.cosine * (1 - cosines).sum(dim=(1, 2)).mean()
        return loss

    def iterate(self, step, rng):
        optimizer = self.optimizers["network"]
        for group in optimizer.param_groups:
            group["lr"] = self.rate * 0.1 ** (step // self.interval)
        real = torch.as_tensor(self.windows.sample(rng, self.batch)["pose"], device=device())
        loss = self.loss(self.network(real), real)
        optimizer.zero_grad(set_to_none=True)
        sum(loss.values()).backward()
        optimizer.step()
        return {term: value.detach() for term, value in loss.items()}


@dataclass
class FeatureNet:
    """A trained feature network. `description` says which and how, `sha256` names the file it was read from."""

    network: AutoEncoder
    description: dict
    sha256: str = ""

    @property
    def preset(self):
        """Its `Preset`; "ruler" is what files of earlier versions call the key."""
        return PRESETS[_name(self.description)]

    def encode(self, windows):
        """Latents of windows of its vectors: (N, 34, C) -> (N, L) float64."""
        if not len(windows):
            return np.zeros((0, self.description["latent"]))
        batches = np.array_split(windows, -(-len(windows) // 1024))
        with torch.inference_mode():
            latents = [self.network.encode(torch.as_tensor(batch, device=device())) for batch in batches]
        return torch.cat(latents).cpu().numpy().astype(np.float64)

    def latents(self, positions, rotation=None, stride=None):
        """Latents of every `stride`-th window (None: its preset's) of a motion: (T, 55, 3), and the head's rotation
        (T, 3) for those that see the face -> (N, L); none when T < 34."""
        return self.latents_of_vectors(self.preset.vectors(positions, rotation), stride)

    def latents_of_vectors(self, vectors, stride=None):
        """`latents` of what the network sees of a motion, (T, C) float32."""
        if len(vectors) < FRAMES:
            return self.encode(())
        windows = np.lib.stride_tricks.sliding_window_view(vectors, FRAMES, axis=0)[:: stride or self.preset.stride]
        return self.encode(np.ascontiguousarray(windows.swapaxes(1, 2)))

    def save(self, path):
        """Write as safetensors; the description goes into its header."""
        save_weights(path, {k: v.cpu().numpy() for k, v in self.network.state_dict().items()}, self.description)

    @classmethod
    def load(cls, path, preset=None):
        """Read what `save` wrote; CospeechError when it is something else, or of another preset than this one."""
        tensors, description = load_weights(path)
        found, network = _name(description), description.get("network")
        if found not in PRESETS or preset not in (None, found):
            expected = f"the FGD feature network {preset!r}" if preset else "the FGD feature network"
            raise CospeechError(f"{path}: weights of {found or network!r}, expected {expected}")
        network = _network(PRESETS[found], description["latent"])
        network.load_state_dict({name: torch.as_tensor(array) for name, array in tensors.items()})
        return cls(network.to(device()).eval(), description, sha256(path))


def _name(description):
    """The preset that a description names; None of something else. Our own has none, others were once "ruler"s."""
    own = OURS if description.get("network") == "fgd" else None
    return description.get("preset", description.get("ruler", own))


def _network(preset, latent):
    return AutoEncoder(latent, preset.channels, preset.slope)


def train_feature_net(clips, settings=None, sigma=1.5, seed=0, checkpoint=None, preset=OURS):
    """Train on the valid windows of `clips`, the training part of one speaker or of many: (FeatureNet, History).

    Parameters
    ----------
    settings : of the preset's training; None for its defaults.
    sigma : the low-pass in frames that evaluation applies to every row, of our own preset; HA2G's are not smoothed.
    seed, checkpoint : see `training.train`. preset : one of `PRESETS`.

    CospeechError when no clip has 34 valid frames in a row.
    """
    name, preset = preset, preset_of(preset)
    settings = settings or preset.settings()
    torch.manual_seed(seed)
    smoothed = (clip.positions if preset.table else low_pass(clip.positions, sigma) for clip in clips)
    sequences = [{"pose": preset.vectors(p, c.rotation)} for p, c in zip(smoothed, clips, strict=True)]
    windows = Windows(sequences, [clip.valid for clip in clips], FRAMES)
    latent = preset.latent or settings.latent
    network = _network(preset, latent)
    network.mean = torch.as_tensor(windows.statistics("pose")[0])
    task = Reconstruction(windows, network.to(device()), settings, preset.cosine)
    description = {
        "network": "fgd",
        **asdict(settings),
        "latent": latent,
        "frames": FRAMES,
        "fps": clips[0].fps,
        "seed": seed,
        "windows": len(windows),
        "motion_sha256": hashlib.sha256(windows.arrays["pose"]).hexdigest(),
    }
    if preset.table:
        description |= {"preset": name, "table": preset.table, "speakers": sorted({clip.subject for clip in clips})}
    else:
        description |= {"sigma": sigma}
    label = f"feature network {name}" if preset.table else f"{clips[0].subject} feature net"
    history = train(
        task,
        settings.steps,
        seed=seed,
        checkpoint=checkpoint,
        identity=json.dumps(description, sort_keys=True),
        label=label,
    )
    return FeatureNet(network.eval(), description), history
