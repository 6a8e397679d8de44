"""Training of the pose network (thesis 3.4.2): 2D heatmaps first, then every loss, for `cospeech.training.train`.

A mini-batch of the second stage mixes people with 3D labels (studio) and people with 2D labels alone (wild); which loss
acts on whom is `losses.total_loss`'s business.
"""

import json
import math
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
import torch

from cospeech import files
from cospeech.errors import CospeechError
from cospeech.posenet.loader import Loader, Mixture
from cospeech.posenet.losses import PRETRAINING, Labels, Weights, total_loss
from cospeech.posenet.network import DESIGNS, Output, PoseNet, heatmap_targets, load_imagenet
from cospeech.training import autocast, descend, device, finish, train
from cospeech.weights import save_weights

AUGMENT = {"scale": 0.2, "rotate": 30.0, "translate": 0.1, "colour": 0.2, "replace": 0.0, "occlude": 0.0, "blur": 0.0}
SHAPE = ("input", "blocks", "width", "free", "latent", "camera")  # fields of Design that a budget may change
OPTIMIZERS = ("adadelta", "adam")
SCHEDULES = ("exponential", "cosine")
# Table 3.6: what each row's second stage learns from. All rows start from the same 2D pre-training.
ROWS = {
    "baseline": {"studio": 1.0, "weights": {"heatmap": 0.0, "projection": 0.0}},
    "latent": {"weights": {"projection": 0.0}},
    "projection": {"weights": {"heatmap": 0.0}},
    "both": {},
}


@dataclass(frozen=True)
class Settings:
    """Of one training; the defaults are the published ones (thesis 3.4.2) where there are any.

    pretraining, pretraining_batch : iterations of stage 1 and people in each. steps, batch : of stage 2.
    studio : share of 3D-labelled people in a mini-batch of stage 2 (not published).
    optimizer : adadelta (rho 0.9) or adam. schedule : exponential, `decay` (not published) over `decay_steps`, or
        cosine, down to 0 at the stage's end after a short warm-up; both start anew in stage 2.
    discrepancy : in stage 2 the pre-trained layers learn so many times slower; 100 when only Human3.6M has 3D labels.
    sigma : of a heatmap's peak, in its pixels (not published).
    augment : how much crops are changed (`augment.augment`); the thesis crops, shifts and turns, and not by how much.
        `replace` is the chance of another background, out of the people without 3D labels.
    people : how many synthetic ones of each domain to train with, and how many of each to test with.
    half : compute in bfloat16 on processors that have instructions for it, too. threads : CPU threads of torch; another
        number may round differently.
    """

    pretraining: int = 186_000
    pretraining_batch: int = 21
    steps: int = 240_000
    batch: int = 10
    studio: float = 0.5
    optimizer: str = "adadelta"
    learning_rate: float = 0.05
    schedule: str = "exponential"
    decay: float = 0.1
    decay_steps: int = 60_000
    discrepancy: float = 1.0
    sigma: float = 1.0
    input: int = 256
    blocks: tuple = (3, 4, 6)
    width: int = 64
    free: int = 50
    latent: int = 1024
    camera: int = 256
    weights: dict = field(default_factory=lambda: asdict(Weights()))
    augment: dict = field(default_factory=lambda: AUGMENT.copy())
    people: dict = field(default_factory=lambda: {"studio": 20_000, "wild": 20_000, "test": 2_000})
    half: bool = False
    threads: int = 1

    def __post_init__(self):
        for key, known in {"optimizer": OPTIMIZERS, "schedule": SCHEDULES}.items():
            if getattr(self, key) not in known:
                raise CospeechError(f"budget: posenet.{key} is {getattr(self, key)!r}; known: {', '.join(known)}")
        if not 0 <= self.studio <= 1:
            raise CospeechError(f"budget: posenet.studio is {self.studio}, a share between 0 and 1 is expected")

    def design(self, part):
        """The Design of a part's network, of this size."""
        if part not in DESIGNS:
            raise CospeechError(f"pose network: part {part!r} is not known; known: {', '.join(DESIGNS)}")
        return replace(DESIGNS[part], **{name: getattr(self, name) for name in SHAPE})

    def row(self, name):
        """These settings as a row of Table 3.6 (`ROWS`) has them."""
        change = ROWS[name]
        return replace(self, **change | {"weights": self.weights | change.get("weights", {})})


class PoseTask:
    """The two stages as one `cospeech.training.Task`.

    people : `loader.Mixture`. imagenet : path of ResNet-50 weights, or None.
    """

    def __init__(self, people, settings, seed, imagenet=None):
        torch.manual_seed(seed)
        self.people, self.settings, self.seed = people, settings, seed
        self.design = settings.design(people.part)
        self.labelled, self.unlabelled = np.flatnonzero(people.labelled3d), np.flatnonzero(~people.labelled3d)
        if not len(self.labelled):
            raise CospeechError(f"{people.stores[0].path}: nobody has 3D labels; add a data set that has them")
        self.lengths = (people.bone_lengths / (1000 * self.design.unit)).astype(np.float32)
        network = PoseNet(self.design)
        load_imagenet(network, imagenet)
        self.network = network.to(device(), memory_format=torch.channels_last)
        self.modules = {"network": self.network}
        self.optimizers = {"pretraining": self._optimizer(1.0), "training": self._optimizer(settings.discrepancy)}
        self.loader = Loader(self.draw, settings.pretraining + settings.steps)
        kept = {k: v for k, v in asdict(settings).items() if k not in (*SHAPE, "people", "threads")}
        self.description = {
            "model": "posenet", "part": people.part, "design": asdict(self.design), "settings": kept,
            "mean_pose": people.mean_pose.round(1).tolist(), "licence_note": people.licence_note,
        }  # fmt: skip

    def _optimizer(self, discrepancy):
        """One for each stage, as the second starts anew; the layers that stage 1 trains may learn slower in it."""
        trained = [*self.network.backbone.parameters(), *self.network.f3d.parameters()]
        rest = [p for p in self.network.parameters() if all(p is not q for q in trained)]
        groups = [{"params": trained, "share": 1 / discrepancy}, {"params": rest, "share": 1.0}]
        if self.settings.optimizer == "adam":
            return torch.optim.Adam(groups, self.settings.learning_rate, fused=True)
        return torch.optim.Adadelta(groups, self.settings.learning_rate, rho=0.9)

    def iterate(self, step, rng):
        """One mini-batch. Its people are drawn from (seed, step), by the loader's thread and ahead of time."""
        s = self.settings
        stage, weights = ("pretraining", PRETRAINING) if step < s.pretraining else ("training", Weights(**s.weights))
        images, labels = self.loader.take(step)
        for group in self.optimizers[stage].param_groups:
            group["lr"] = group["share"] * self.learning_rate(step)
        with autocast(s.half):
            output = self.network(images)
        terms, loss = total_loss(_float(output), labels, self.network.heatmap_joints, self.design.parents, weights)
        descend(self, stage, loss)
        return {name: term.detach() for name, term in terms.items()}

    def learning_rate(self, step):
        """Of an iteration, from its number alone."""
        s = self.settings
        first, total = (0, s.pretraining) if step < s.pretraining else (s.pretraining, s.steps)
        done = step - first
        if s.schedule == "exponential":
            return s.learning_rate * s.decay ** (done / s.decay_steps)
        warm = min(1.0, (done + 1) / (0.05 * total))
        return s.learning_rate * warm * (1 + math.cos(math.pi * done / total)) / 2

    # ---- mini-batches ------------------------------------------------------------------------------------------------

    def draw(self, step):
        """(images (B, 3, S, S) float32, Labels) of an iteration, from (seed, step) alone."""
        rng = np.random.default_rng([self.seed, step, 1])
        batch = self.people.crops(self._chosen(step, rng), rng, self.design.input, **self.settings.augment)
        labels = self.labels(batch, self.lengths[rng.integers(len(self.lengths), size=len(batch))])
        return images_of(batch).to(device()), labels

    def _chosen(self, step, rng):
        """Whom to train on: people with 2D labels alone in stage 1, a fixed mix in stage 2; or whoever there is."""
        s = self.settings
        stage1 = step < s.pretraining
        count = s.pretraining_batch if stage1 else s.batch
        labelled = count if not len(self.unlabelled) else 0 if stage1 else round(count * s.studio)
        parts = [rng.choice(self.labelled, labelled)]
        if labelled < count:
            parts.append(rng.choice(self.unlabelled, count - labelled))
        return np.concatenate(parts)

    def labels(self, batch, lengths):
        """A Batch as `Labels`; lengths (B, J) in the design's unit."""
        design, tensor = self.design, lambda x: torch.from_numpy(np.ascontiguousarray(x)).to(device())
        points = tensor((2 * batch.joints2d + 1) / design.input - 1)
        maps = heatmap_targets(points, design.side, self.settings.sigma)
        pose = tensor(batch.joints3d / np.float32(1000 * design.unit))
        return Labels(points, tensor(batch.visible), maps, pose, tensor(batch.labelled3d), tensor(lengths))


def images_of(batch):
    """A Batch's crops as the network reads them: (N, 3, S, S) float32 RGB, 0 to 1."""
    return torch.from_numpy(batch.images).permute(0, 3, 1, 2).float().div_(255)


def _float(output):
    """An Output in float32, in which the losses are computed whatever the network ran in."""
    *tensors, intermediate = output
    return Output(*(tensor.float() for tensor in tensors), tuple(maps.float() for maps in intermediate))


def train_posenet(paths, settings, *, seed, folder, imagenet=None, checkpoint=None):
    """Train a network and write weights.safetensors and history.h5 into `folder`; returns the finished PoseTask.

    Parameters
    ----------
    paths : stores of people of one part. settings : Settings. imagenet : path of ResNet-50 weights, or None.
    checkpoint : path for resuming, outside `folder`.
    """
    cv2.setNumThreads(1)  # the loader is one thread
    torch.set_num_threads(settings.threads)
    task = PoseTask(Mixture(paths, settings.augment.get("replace", 0) > 0), settings, seed, imagenet)
    identity = sha256(json.dumps([task.description, str(imagenet)], sort_keys=True).encode())
    for path in paths:
        identity.update(files.sha256(path).encode())
    torch.set_flush_denormal(True)  # dying activations would slow a training down tenfold
    try:
        history = train(
            task, settings.pretraining + settings.steps, seed=seed, checkpoint=checkpoint,
            identity=identity.hexdigest(), label=f"posenet {task.people.part}",
        )  # fmt: skip
    finally:
        task.loader.close()
        torch.set_flush_denormal(False)
    folder = Path(folder)
    save_weights(folder / "weights.safetensors", task.network.cpu().state_dict(), task.description)
    history.write(folder / "history.h5")
    finish(checkpoint)
    return task
