"""The sync classifier of thesis Table 4.4: chapter 4's discriminator, trained to tell whether motion belongs to speech.

In sync is a window's own motion, off sync that of another window; both have the speaker's own poses, so timing is all
there is to tell them apart. It is no measure of quality: in the publication it rated synthesis above recordings and the
plain CNN highest, so `WARNING` stands beside its scores.
"""

import json
from dataclasses import asdict, dataclass
from hashlib import sha256

import numpy as np
import torch
from torch.nn import functional as F

from cospeech.errors import CospeechError
from cospeech.files import reading_hdf5, writing_hdf5
from cospeech.formats.result_table import fixed, headings, mean_and_deviation, write_table
from cospeech.gestures.chapter4.pairs import MotionNetwork, Pairs
from cospeech.gestures.chapter4.vectors import motion_to_vectors
from cospeech.learning.settings import COUNT, POSITIVE, UNPUBLISHED, WEIGHT, Section, key, one_of
from cospeech.learning.training import autocast, descend, device, train
from cospeech.learning.unet1d import MULTIPLE, Critic, preset
from cospeech.learning.unet1d import PRESETS as WIDTHS
from cospeech.learning.weights import load_weights, save_weights

JUDGED = ("features", "body", "hands")  # the face is excluded, as from the discriminator
WARNING = "not a measure of quality: the published classifier rated synthesis above recordings (thesis section 4.5)"
SCHEMA = "cospeech.sync"
DRAWS = 4  # of other windows for each, when the threshold is found
STRIDE = 4  # windows are judged at starts this many to a window apart: every quarter


@dataclass(frozen=True)
class Settings(Section, section="sync_classifier"):
    """Of one training. frames: length of the judged windows, 64, 32 or 16 in Table 4.4, a multiple of 8.

    `frames` is no key of a budget: the workflow trains one classifier for each length of the table.
    """

    steps: int = key(20_000, "iterations", limits=COUNT)
    batch: int = key(25, "windows in each iteration", limits=COUNT)
    frames: int = 64
    learning_rate: float = key(5e-4, "of AdamW", limits=POSITIVE)
    preset: str = key("resync", "which reconstruction of the channels, which nobody printed", limits=one_of(*WIDTHS))
    width: float = key(1.0, "factor on the number of channels", limits=POSITIVE)
    noise: float = key(
        0.0,
        "deviation of noise on the z-scored input in training, against learning short recordings by heart",
        limits=WEIGHT,
        published=UNPUBLISHED,
    )
    weight_decay: float = key(0.0, "of AdamW", limits=WEIGHT, published=UNPUBLISHED)


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
    """A trained classifier; `description` says how it was trained, and above which `threshold` a logit is in sync."""

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
            return self.network(given).cpu().numpy() - np.float32(self.description.get("threshold", 0.0))

    def calibrated(self, clips, seed=0):
        """The classifier with the threshold that is best for these clips, the validation part.

        What was trained on ten minutes knows them, and takes new pairs for off sync too readily. Without a clip of
        three windows it stays as it is.
        """
        long = [clip for clip in clips if clip.frames >= 3 * self.frames]
        if not long:
            return self
        inside, off = self._pairs(long, seed, DRAWS)
        at = np.sort(np.concatenate([inside, off]))
        combined = np.mean(inside[:, None] > at, axis=0) + np.mean(off[:, None] <= at, axis=0)
        best = self.description.get("threshold", 0.0) + float(at[combined == combined.max()].mean())
        return SyncClassifier(self.network, self.description | {"threshold": best})

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
        inside, off = self._pairs(long, seed)
        inside, off = float((inside > 0).mean()), float((off <= 0).mean())
        return {"in_sync": inside, "off_sync": off, "combined": (inside + off) / 2}

    def _pairs(self, long, seed, draws=1):
        """Logits of every window (N,), and of its speech with other windows' motion (draws * N,)."""
        windows = [self.windows(clip.features, clip.motion) for clip in long]
        owner = np.repeat(np.arange(len(windows)), [len(w["body"]) for w in windows])
        given = {name: torch.cat([w[name] for w in windows]) for name in JUDGED}
        rng, places = np.random.default_rng(seed), np.arange(len(owner))
        other = np.empty((draws, len(owner)), int)
        for i in places:
            far = (owner != owner[i]) if len(long) > 1 else np.abs(places - i) >= STRIDE
            if not far.any():
                raise CospeechError("test part: one clip of hardly more than a window; mismatching needs two takes")
            other[:, i] = rng.choice(places[far], size=draws)
        off = [self.logits({n: given[n] if n == "features" else given[n][o] for n in JUDGED}) for o in other]
        return self.logits(given), np.concatenate(off)

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
    description = {
        "network": "sync_classifier",
        "settings": asdict(settings),
        "channels": task.pairs.channels,
        "seed": seed,
    }
    identity = sha256(json.dumps(description, sort_keys=True).encode())
    for clip in clips:
        identity.update(clip.features.tobytes() + clip.positions.tobytes())
    history = train(
        task,
        settings.steps,
        seed=seed,
        checkpoint=checkpoint,
        identity=identity.hexdigest(),
        label=f"{clips[0].subject} sync classifier, {settings.frames} frames",
    )
    return SyncClassifier(task.network.eval(), description), history


def write_judgement(path, subject, frames, accuracy, scores, seed=0):
    """One file of what a classifier found: accuracies on held-out takes, and {row: mean share judged in sync}."""
    with writing_hdf5(path, SCHEMA, subject=subject, frames=frames, seed=seed, warning=WARNING) as file:
        for group, values in (("accuracy", accuracy), ("score", scores)):
            file.create_group(group).attrs.update(values)


def write_accuracies(path, judgements):
    """Table 4.4 (IVA 2021 Table S1) as CSV from files of `write_judgement`, a line a subject and window length.

    Accuracies, and each row's share in sync, are means over the classifiers' seeds, in percent, with their sample
    deviations.
    """
    groups = {}
    for judgement in judgements:
        with reading_hdf5(judgement, SCHEMA) as file:
            values = dict(file["accuracy"].attrs)
            values |= {f"{row} judged in sync": share for row, share in file["score"].attrs.items()}
            groups.setdefault((file.attrs["subject"], file.attrs["frames"]), []).append(values)
    names = list(dict.fromkeys(name for runs in groups.values() for values in runs for name in values))
    lines = []
    for (subject, frames), runs in groups.items():
        shares = [np.array([values.get(name, np.nan) for values in runs]) for name in names]
        cells = [fixed(100 * x, 1) for share in shares for x in mean_and_deviation(share)]
        lines.append([subject, frames, len(runs), *cells, WARNING])
    heads = (heading for name in names for heading in headings(name, "%"))
    write_table(path, ["subject", "frames", "runs", *heads, "warning"], lines)
