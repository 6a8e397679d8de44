"""HA2G's rulers: the autoencoders whose latents FGD and diversity are measured in, on unit bone vectors of 34 frames.

The layers are those of `fgd.AutoEncoder`. Two forms: `expressive` is trained as for TED Expressive (HA2G Table 9),
`trimodal` as for TED Gesture (Yoon et al. 2020). Each also as `<form>_compat`, with the dense layers' `LeakyReLU(True)`
of released code, whose slope is 1: their dense part is linear, and published FGDs were measured so. Trained on the
training part of the speakers alone, for a fixed number of iterations; no test motion has a say in a ruler.
"""

import hashlib
import json
from dataclasses import asdict, dataclass

import numpy as np
import torch
from torch.nn import functional

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics.fgd import FRAMES, AutoEncoder, FeatureNet, Reconstruction
from cospeech.files import sha256
from cospeech.gestures.ha2g.dataset.bones import bone_vectors
from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.learning.settings import COUNT, NATURAL, POSITIVE, Section, key
from cospeech.learning.training import device, train
from cospeech.learning.weights import load_weights
from cospeech.learning.windows import Windows

STRIDE = 10  # frames between the starts of two windows that are judged (HA2G section 4.1)


@dataclass(frozen=True)
class Form:
    """A ruler's joints, latent size and weight of the directions' term."""

    table: str
    latent: int
    cosine: float


FORMS = {"expressive": Form("expressive43", 128, 0.001), "trimodal": Form("ted10", 32, 0.0)}
RULERS = tuple(f"{form}{suffix}" for form in FORMS for suffix in ("", "_compat"))
SLOPES = {"": 0.2, "_compat": 1.0}


@dataclass(frozen=True)
class Settings(Section, section="ha2g_ruler"):
    """Of a ruler's training. Published for TED Expressive: 180 epochs, a tenth of the rate every 30 epochs."""

    steps: int = key(1500, "iterations", limits=COUNT, published=180_000)
    batch: int = key(64, "windows of 34 frames in each iteration", limits=COUNT)
    learning_rate: float = key(5e-4, "of Adam", limits=POSITIVE)
    decays: int = key(5, "how often, at even distances, the rate falls to a tenth", limits=NATURAL)


def form_of(ruler):
    """(Form, slope below zero) of one of `RULERS`."""
    name, _, compat = ruler.partition("_")
    if ruler not in RULERS:
        raise CospeechError(f"ruler {ruler!r} is not known; known: {', '.join(RULERS)}")
    return FORMS[name], SLOPES["_compat" if compat else ""]


def clip_vectors(clip, table):
    """What a ruler sees of a clip: its bone vectors (T, V, 3) float32, without bone lengths."""
    return bone_vectors(clip.positions, clip.rotation, table)


class VectorReconstruction(Reconstruction):
    """The training task: L1, L1 of frame differences and, as released, 0.001 of the sum of (1 - cosine) over a window.

    The sum, not the mean: for 42 bones and 34 frames the term weighs 1.4 times their mean.
    """

    def __init__(self, windows, network, settings, cosine, steps):
        super().__init__(windows, network, settings)
        self.cosine, self.rate, self.interval = cosine, settings.learning_rate, -(-steps // (settings.decays + 1))

    def loss(self, made, real):
        loss = super().loss(made, real)
        if self.cosine:
            cosines = functional.cosine_similarity(made.unflatten(2, (-1, 3)), real.unflatten(2, (-1, 3)), dim=-1)
            loss["direction"] = self.cosine * (1 - cosines).sum(dim=(1, 2)).mean()
        return loss

    def iterate(self, step, rng):
        for group in self.optimizers["network"].param_groups:
            group["lr"] = self.rate * 0.1 ** (step // self.interval)
        return super().iterate(step, rng)


class Ruler(FeatureNet):
    """A trained autoencoder of bone vectors. `description` says which and how, `sha256` names the file it is from."""

    @property
    def table(self):
        """The `LevelTable` of its bones."""
        return level_table(form_of(self.description["ruler"])[0].table)

    def latents(self, vectors, stride=STRIDE):
        """Latents of every `stride`-th window of a motion: (T, V, 3) -> (N, L); none when T < 34."""
        if len(vectors) < FRAMES:
            return self.encode(())
        flat = np.asarray(vectors, np.float32).reshape(len(vectors), -1)
        windows = np.lib.stride_tricks.sliding_window_view(flat, FRAMES, axis=0)[::stride]
        return self.encode(np.ascontiguousarray(windows.swapaxes(1, 2)))

    @classmethod
    def load(cls, path):
        """Read what `save` wrote; CospeechError when it is something else."""
        tensors, description = load_weights(path)
        if "ruler" not in description:
            raise CospeechError(f"{path}: weights of {description.get('network')!r}, expected a ruler of bone vectors")
        network = _network(description["ruler"])
        network.load_state_dict({name: torch.as_tensor(array) for name, array in tensors.items()})
        return cls(network.to(device()).eval(), description, sha256(path))


def _network(ruler):
    form, slope = form_of(ruler)
    return AutoEncoder(form.latent, 3 * level_table(form.table).vectors, slope)


def train_ruler(ruler, clips, settings=None, seed=0, checkpoint=None):
    """Train one of `RULERS` on the valid windows of `clips`, the training parts of all speakers: (Ruler, History).

    `settings`: a `Settings`. `seed`, `checkpoint`: see `training.train`. CospeechError when no clip has 34 valid frames
    in a row.
    """
    form, _ = form_of(ruler)
    settings = settings or Settings()
    torch.manual_seed(seed)
    table = level_table(form.table)
    sequences = [{"pose": clip_vectors(clip, table).reshape(clip.frames, -1)} for clip in clips]
    windows = Windows(sequences, [clip.valid for clip in clips], FRAMES)
    network = _network(ruler)
    network.mean = torch.as_tensor(windows.statistics("pose")[0])
    task = VectorReconstruction(windows, network.to(device()), settings, form.cosine, settings.steps)
    description = {
        "ruler": ruler, **asdict(settings), "latent": form.latent, "table": form.table, "frames": FRAMES,
        "fps": clips[0].fps, "seed": seed, "windows": len(windows), "speakers": sorted({c.subject for c in clips}),
        "motion_sha256": hashlib.sha256(windows.arrays["pose"]).hexdigest(),
    }  # fmt: skip
    history = train(
        task, settings.steps, seed=seed, checkpoint=checkpoint, identity=json.dumps(description, sort_keys=True),
        label=f"ruler {ruler}",
    )  # fmt: skip
    return Ruler(network.eval(), description), history
