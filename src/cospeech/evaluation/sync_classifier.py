"""The sync classifier of thesis Table 4.4: chapter 4's discriminator, trained to tell whether motion belongs to speech.

In sync is a window's own motion, off sync that of another window; both have the speaker's own poses, so timing is all
there is to tell them apart. It is no measure of quality: in the publication it rated synthesis above recordings and the
plain CNN highest, so `WARNING` stands beside its scores.
"""

import csv
import json
from dataclasses import asdict, dataclass
from hashlib import sha256

import numpy as np
import torch
from torch.nn import functional as F

from cospeech.errors import CospeechError
from cospeech.files import reading_hdf5, writing, writing_hdf5
from cospeech.gestures.pairs import MotionNetwork, Pairs
from cospeech.gestures.vectors import motion_to_vectors
from cospeech.training import autocast, descend, device, train
from cospeech.unet1d import MULTIPLE, Critic, preset
from cospeech.weights import load_weights, save_weights

JUDGED = ("features", "body", "hands")  # the face is excluded, as from the discriminator
WARNING = "not a measure of quality: the published classifier rated synthesis above recordings (thesis section 4.5)"
SCHEMA = "cospeech.sync"
STRIDE = 4  # windows are judged at starts this many to a window apart: every quarter


@dataclass(frozen=True)
class Settings:
    """Of one training. frames: length of the judged windows, 64, 32 or 16 in Table 4.4, a multiple of 8.

    noise: deviation of Gaussian noise on the z-scored input in training, against learning short recordings by heart.
    """

    steps: int = 20_000
    batch: int = 25
    frames: int = 64
    learning_rate: float = 5e-4
    preset: str = "resync"
    width: float = 1.0
    noise: float = 0.0
    weight_decay: float = 0.0


class Classifier(MotionNetwork):
    """Speech features (B, 28, T), body (B, 42, T), hands (B, 126, T) -> (B,) logits, above 0 for in sync."""

    def __init__(self, pairs, settings):
        super().__init__(pairs)
        widths = preset(settings.preset).scaled(settings.width)
        channels = sum(pairs.channels[name] for name in JUDGED)
        self.critic = Critic(channels, widths.critic, settings.frames)

    def seen(self, given):
        """{name: (B, C, T)} -> (B, 196, T) z-scored."""
        return torch.cat([self.standardized(name, given[name]) for name in JUDGED], dim=1)

    def forward(self, given):
        return self.critic(self.seen(given))


class SyncTask:
    """Half of each batch is in sync; the other half pairs the same speech with the motion of other windows."""

    def __init__(self, clips, settings, seed):
        if settings.frames % MULTIPLE:
            raise CospeechError(f"sync classifier: {settings.frames} frames is not a multiple of {MULTIPLE}")
        torch.manual_seed(seed)
        self.settings, self.pairs = settings, Pairs(clips, settings.frames)
        self.network = Classifier(self.pairs, settings).to(device())
        adam = torch.optim.AdamW(self.network.parameters(), settings.learning_rate, weight_decay=settings.weight_decay)
        self.modules, self.optimizers = {"network": self.network}, {"network": adam}

    def iterate(self, step, rng):
        real, other = self.pairs.sample(rng, self.settings.batch), self.pairs.sample(rng, self.settings.batch)
        seen = torch.cat([self.network.seen(real), self.network.seen(other | {"features": real["features"]})])
        seen = seen + self.settings.noise * torch.randn_like(seen)
        with autocast():
            true, false = self.network.critic(seen).float().chunk(2)
        loss = (F.softplus(-true).mean() + F.softplus(false).mean()) / 2
        descend(self, "network", loss)
        right = ((true > 0).float().mean() + (false <= 0).float().mean()) / 2
        return {"cross_entropy": loss.detach(), "accuracy": right.detach()}


@dataclass
class SyncClassifier:
    """A trained classifier; `description` says how it was trained."""

    network: Classifier
    description: dict

    @property
    def frames(self):
        return self.description["settings"]["frames"]

    def windows(self, features, motion):
        """Every quarter window of a motion: (T, 28) features and a `Motion` -> {name: (N, C, frames)} tensors."""
        given = {"features": features, **motion_to_vectors(motion)}
        views = {n: np.lib.stride_tricks.sliding_window_view(given[n], self.frames, axis=0) for n in JUDGED}
        return {n: torch.from_numpy(v[:: self.frames // STRIDE].copy()).to(device()) for n, v in views.items()}

    def logits(self, given):
        """(N,) float32, above 0 for in sync."""
        with torch.inference_mode():
            return self.network(given).cpu().numpy()

    def score(self, features, motion):
        """Share of a motion's windows that are judged in sync with the speech; NaN if it is shorter than a window."""
        if len(features) < self.frames:
            return float("nan")
        return float((self.logits(self.windows(features, motion)) > 0).mean())

    def accuracy(self, clips, seed=0):
        """{"in_sync", "off_sync", "combined"} accuracies on takes that were not trained on (Table 4.4).

        Off sync is each window's speech with the motion of a random window of another clip, or, where there is one clip
        only, of a window that does not overlap.
        """
        long = [clip for clip in clips if clip.frames >= self.frames]
        if not long:
            raise CospeechError(f"test part: no clip has the {self.frames} frames that the sync classifier judges")
        windows = [self.windows(clip.features, clip.motion) for clip in long]
        owner = np.repeat(np.arange(len(windows)), [len(w["body"]) for w in windows])
        given = {name: torch.cat([w[name] for w in windows]) for name in JUDGED}
        rng, places = np.random.default_rng(seed), np.arange(len(owner))
        other = np.empty(len(owner), int)
        for i in places:
            far = (owner != owner[i]) if len(long) > 1 else np.abs(places - i) >= STRIDE
            if not far.any():
                raise CospeechError("test part: one clip of hardly more than a window; mismatching needs two takes")
            other[i] = rng.choice(places[far])
        inside = float((self.logits(given) > 0).mean())
        off = float((self.logits({n: given[n] if n == "features" else given[n][other] for n in JUDGED}) <= 0).mean())
        return {"in_sync": inside, "off_sync": off, "combined": (inside + off) / 2}

    def save(self, path):
        """Write as safetensors; the description goes into its header."""
        save_weights(path, {k: v.cpu().numpy() for k, v in self.network.state_dict().items()}, self.description)

    @classmethod
    def load(cls, path):
        """Read what `save` wrote; CospeechError when it is something else."""
        tensors, description = load_weights(path)
        if description.get("network") != "sync_classifier":
            raise CospeechError(f"{path}: weights of {description.get('network')!r}, expected a sync classifier")
        channels = description["channels"]
        shape = _Shape(channels, {name: (np.zeros(c, "f4"), np.ones(c, "f4")) for name, c in channels.items()})
        network = Classifier(shape, Settings(**description["settings"]))
        network.load_state_dict({name: torch.as_tensor(array) for name, array in tensors.items()})
        return cls(network.to(device()).eval(), description)


@dataclass
class _Shape:
    """What `Classifier` asks of its `Pairs` when it is read from a file."""

    channels: dict
    statistics: dict
    parts: tuple = ()


def train_sync_classifier(clips, settings, seed=0, checkpoint=None):
    """Train on the training part; return (SyncClassifier, History). `checkpoint`: see `training.train`."""
    task = SyncTask(clips, settings, seed)
    description = {"network": "sync_classifier", "settings": asdict(settings), "channels": task.pairs.channels,
                   "seed": seed}  # fmt: skip
    identity = sha256(json.dumps(description, sort_keys=True).encode())
    for clip in clips:
        identity.update(clip.features.tobytes() + clip.positions.tobytes())
    history = train(
        task, settings.steps, seed=seed, checkpoint=checkpoint, identity=identity.hexdigest(),
        label=f"{clips[0].subject} sync classifier, {settings.frames} frames",
    )  # fmt: skip
    return SyncClassifier(task.network.eval(), description), history


def write_judgement(path, subject, frames, accuracy, scores):
    """One file of what a classifier found: accuracies on held-out takes, and {row: mean share judged in sync}."""
    with writing_hdf5(path, SCHEMA, subject=subject, frames=frames, warning=WARNING) as file:
        for group, values in (("accuracy", accuracy), ("score", scores)):
            file.create_group(group).attrs.update(values)


def write_table(path, judgements):
    """Table 4.4 as CSV from files of `write_judgement`: accuracies in percent, then each row's share in sync."""
    lines = []
    for judgement in judgements:
        with reading_hdf5(judgement, SCHEMA) as file:
            lines.append((dict(file.attrs), dict(file["accuracy"].attrs), dict(file["score"].attrs)))
    rows = list(dict.fromkeys(row for _, _, scores in lines for row in scores))
    percent = lambda value: f"{100 * value:.1f}" if np.isfinite(value) else "n/a"  # noqa: E731
    with writing(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["subject", "frames", "in_sync [%]", "off_sync [%]", "combined [%]",
                        *(f"{row} judged in sync [%]" for row in rows), "warning"])  # fmt: skip
        for about, accuracy, scores in lines:
            accuracies = (accuracy[name] for name in ("in_sync", "off_sync", "combined"))
            shares = (scores.get(row, np.nan) for row in rows)
            table.writerow([about["subject"], about["frames"], *map(percent, (*accuracies, *shares)), WARNING])
