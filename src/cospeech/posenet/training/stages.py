"""Training of the pose network (thesis 3.4.2): 2D heatmaps first, then every loss, for `learning.training.train`.

A mini-batch of the second stage mixes people with 3D labels (studio) and people with 2D labels alone (wild); which loss
acts on whom is `pose_losses.total_loss`'s business.
"""

import json
import math
import os
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
import torch

from cospeech import files
from cospeech.errors import CospeechError
from cospeech.learning.settings import (
    COUNT,
    LEFT_OUT,
    NATURAL,
    POSITIVE,
    SHARE,
    UNPUBLISHED,
    WEIGHT,
    Section,
    counts,
    key,
    one_of,
    some_of,
)
from cospeech.learning.training import autocast, descend, device, finish, train
from cospeech.learning.weights import save_weights
from cospeech.posenet.network import DESIGNS, Output, PoseNet, heatmap_targets, images_of, load_imagenet
from cospeech.posenet.training.curve import POINTS, LearningCurve, write_history
from cospeech.posenet.training.loader import Loader, Mixture
from cospeech.posenet.training.pose_losses import LIFTING, PRETRAINING, Labels, Weights, total_loss

STAGES = ("pretraining", "lifting", "training")
PREFETCH = 3  # mini-batches that are made while the network learns
LIFTED = 256  # people in a mini-batch of the stage that looks at no images
SHAPE = ("input", "blocks", "width", "free", "latent", "camera")  # fields of Design that a budget may change
# Table 3.6: what each row's second stage learns from. All rows start from the same 2D pre-training.
ROWS = {
    "baseline": {"studio": 1.0, "weights": {"heatmap": 0.0, "projection": 0.0}},
    "latent": {"weights": {"projection": 0.0}},
    "projection": {"weights": {"heatmap": 0.0}},
    "both": {},
}


@dataclass(frozen=True)
class Settings(Section, section="posenet"):
    """Of one training; the defaults are the published ones (thesis 3.4.2) where there are any."""

    pretraining: int = key(186_000, "stage 1: heatmaps alone, of people with 2D labels", "iterations", NATURAL)
    pretraining_batch: int = key(21, "people in each of them", limits=COUNT)
    lifting: int = key(
        0,
        "a stage between the two: only what follows F3D is trained, on heatmaps drawn from the 2D labels of people "
        "with 3D labels, so that stage 2 starts with a network that lifts",
        "iterations",
        NATURAL,
        published=UNPUBLISHED,
    )
    steps: int = key(240_000, "stage 2: every loss", "iterations", COUNT)
    batch: int = key(10, "people in each of them", limits=COUNT)
    studio: float = key(
        0.5, "share of people with 3D labels in a mini-batch of stage 2", limits=SHARE, published=UNPUBLISHED
    )
    optimizer: str = key("adadelta", "of all stages; adadelta with a rho of 0.9", limits=one_of("adadelta", "adam"))
    learning_rate: float = key(0.05, "of the optimiser, its highest", limits=POSITIVE)
    schedule: str = key(
        "exponential",
        "of the rate: exponential decay, or cosine down to 0 after a short rise; starts anew in every stage",
        limits=one_of("exponential", "cosine"),
    )
    decay: float = key(0.1, "what the rate is multiplied by over decay_steps", limits=POSITIVE, published=UNPUBLISHED)
    decay_steps: int = key(60_000, "of the exponential schedule", "iterations", COUNT)
    discrepancy: float = key(
        1.0,
        "how many times slower pre-trained layers learn in stage 2; 100 when only Human3.6M has 3D labels",
        limits=POSITIVE,
    )
    sigma: float = key(1.0, "of a heatmap's peak", "its pixels", POSITIVE, published=UNPUBLISHED)
    input: int = key(256, "side of the crop", "pixels", {"minimum": 16, "multipleOf": 16})
    blocks: tuple = key((3, 4, 6), "in ResNet's levels 2 to 4", limits=counts(3))
    width: int = key(64, "channels of ResNet's first level", limits=COUNT)
    free: int = key(50, "free channels, beside the joints' heatmaps", limits=COUNT)
    latent: int = key(1024, "numbers of z", limits=COUNT)
    camera: int = key(256, "units of the camera network", limits=COUNT)
    weights: dict = key(
        asdict(Weights()),
        "of the loss terms (eq. 3.8)",
        limits=WEIGHT,
        parts={
            "heatmap": "2D heatmaps",
            "pose": "3D joints of people with 3D labels",
            "bone_vector": "their bones",
            "bone_length": "bone lengths of the others (eq. 3.6)",
            "projection": "3D joints through the camera against 2D labels",
        },
    )
    augment: dict = key(
        {"scale": 0.2, "rotate": 30.0, "translate": 0.1, "colour": 0.2, "replace": 0.0, "occlude": 0.0, "blur": 0.0},
        "how much crops are changed",
        limits=WEIGHT,
        parts={
            "scale": "zoom, share of the size",
            "rotate": "turn, degrees",
            "translate": "shift, share of the side",
            "colour": "contrast, share",
            "replace": "chance of another background, of the people without 3D labels",
            "occlude": "chance that pieces of backgrounds cover a person",
            "blur": "Gaussian blur of at most so many pixels, of every second crop",
        },
        published=UNPUBLISHED,
    )
    people: dict = key(
        {"studio": 20_000, "wild": 20_000, "test": 2_000},
        "synthetic people, for want of data sets",
        limits=COUNT,
        parts={
            "studio": "to train with, of the studio",
            "wild": "to train with, of the wild",
            "test": "to test with, of each domain",
        },
        published=UNPUBLISHED,
    )
    labelled: tuple = key(
        ("studio",), "domains of which the training knows the 3D labels", limits=some_of("studio", "wild", least=1)
    )
    half: bool = key(
        False, "compute in bfloat16 on processors that have instructions for it, too", published=UNPUBLISHED
    )
    threads: int = key(
        1, "CPU threads of torch, the budget's `threads` where left out", limits=COUNT, published=LEFT_OUT
    )

    def __post_init__(self):
        super().__post_init__()
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
    """The stages as one `cospeech.learning.training.Task`.

    people : `loader.Mixture`. imagenet : path of ResNet-50 weights, or None. test : stores of people to draw the
    learning curve with, or None. `total` iterations make the whole training.
    """

    def __init__(self, people, settings, seed, imagenet=None, test=None):
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
        if settings.lifting:
            self.optimizers["lifting"] = self._optimizer(1.0)
        self.ends = np.cumsum([settings.pretraining, settings.lifting, settings.steps]).tolist()
        self.total = self.ends[-1]
        self.curve = LearningCurve(test, people.part, self.design, settings.half) if test else None
        self.points = {(k + 1) * self.total // POINTS - 1 for k in range(POINTS)} if test else ()
        self.loader = Loader(self.draw, self.total, prefetch=PREFETCH if _spare_core() else 0)
        kept = {k: v for k, v in asdict(settings).items() if k not in (*SHAPE, "people", "threads")}
        self.description = {
            "model": "posenet",
            "part": people.part,
            "design": asdict(self.design),
            "settings": kept,
            "mean_pose": people.mean_pose.round(1).tolist(),
            "licence_note": people.licence_note,
        }

    def _optimizer(self, discrepancy):
        """One for each stage, as each starts anew; the layers that stage 1 trains may learn slower in the last."""
        trained = [*self.network.backbone.parameters(), *self.network.f3d.parameters()]
        rest = [p for p in self.network.parameters() if all(p is not q for q in trained)]
        groups = [{"params": trained, "share": 1 / discrepancy}, {"params": rest, "share": 1.0}]
        if self.settings.optimizer == "adam":
            return torch.optim.Adam(groups, self.settings.learning_rate, fused=True)
        return torch.optim.Adadelta(groups, self.settings.learning_rate, rho=0.9)

    def iterate(self, step, rng):
        """One mini-batch. Its people are drawn from (seed, step), by the loader's thread and ahead of time."""
        stage, *_ = self.stage(step)
        weights = {"pretraining": PRETRAINING, "lifting": LIFTING}.get(stage) or Weights(**self.settings.weights)
        images, labels = self.loader.take(step)
        for group in self.optimizers[stage].param_groups:
            group["lr"] = group["share"] * self.learning_rate(step)
        with autocast(self.settings.half):
            output = self.network.lifted(images) if stage == "lifting" else self.network(images)
        terms, loss = total_loss(_float(output), labels, self.network.heatmap_joints, self.design.parents, weights)
        descend(self, stage, loss)
        found = {name: term.detach() for name, term in terms.items()}
        return found | (self.curve(self.network) if step in self.points else {})

    def stage(self, step):
        """(name, first iteration, iterations) of the stage that an iteration belongs to."""
        number = int(np.searchsorted(self.ends[:-1], step, side="right"))
        first = self.ends[number - 1] if number else 0
        return STAGES[number], first, self.ends[number] - first

    def learning_rate(self, step):
        """Of an iteration, from its number alone."""
        s, (_, first, total) = self.settings, self.stage(step)
        done = step - first
        if s.schedule == "exponential":
            return s.learning_rate * s.decay ** (done / s.decay_steps)
        warm = min(1.0, (done + 1) / (0.05 * total))
        return s.learning_rate * warm * (1 + math.cos(math.pi * done / total)) / 2

    # ---- mini-batches ------------------------------------------------------------------------------------------------

    def draw(self, step):
        """(images (B, 3, S, S) float32, or F3D where no images are looked at; Labels), from (seed, step) alone."""
        rng = np.random.default_rng([self.seed, step, 1])
        chosen, size, options = self._chosen(step, rng), self.design.input, self.settings.augment
        lifting = self.stage(step)[0] == "lifting"
        if lifting:
            options = {name: options[name] for name in ("scale", "rotate", "translate") if name in options}
        batch = (self.people.labels if lifting else self.people.crops)(chosen, rng, size, **options)
        labels = self.labels(batch, self.lengths[rng.integers(len(self.lengths), size=len(batch))])
        return (self._drawn(labels, rng) if lifting else images_of(batch)).to(device()), labels

    def _chosen(self, step, rng):
        """Whom to train on: people with 2D labels alone in stage 1, a fixed mix in stage 2; or whoever there is."""
        s, stage = self.settings, self.stage(step)[0]
        if stage == "lifting":
            return rng.choice(self.labelled, LIFTED)
        count = s.pretraining_batch if stage == "pretraining" else s.batch
        labelled = count if not len(self.unlabelled) else 0 if stage == "pretraining" else round(count * s.studio)
        parts = [rng.choice(self.labelled, labelled)]
        if labelled < count:
            parts.append(rng.choice(self.unlabelled, count - labelled))
        return np.concatenate(parts)

    def _drawn(self, labels, rng):
        """F3D (B, K + free, side, side) with heatmaps of the 2D labels, as uncertain as a network's, alone."""
        count, joints = labels.visible.shape
        strength = rng.uniform(0.6, 1.1, (count, joints)) * (rng.random((count, joints)) > 0.1)
        strength = torch.from_numpy(np.float32(strength)).to(device()) * labels.visible
        maps = labels.heatmaps * strength[:, :, None, None]
        maps = maps + torch.from_numpy(np.float32(rng.normal(0, 0.05, maps.shape))).to(device())
        return torch.cat([maps, maps.new_zeros(count, self.design.free, *maps.shape[2:])], dim=1)

    def labels(self, batch, lengths):
        """A Batch as `Labels`; lengths (B, J) in the design's unit."""
        design, tensor = self.design, lambda x: torch.from_numpy(np.ascontiguousarray(x)).to(device())
        points = tensor((2 * batch.joints2d + 1) / design.input - 1)
        maps = heatmap_targets(points, design.side, self.settings.sigma)
        pose = tensor(batch.joints3d / np.float32(1000 * design.unit))
        return Labels(points, tensor(batch.visible), maps, pose, tensor(batch.labelled3d), tensor(lengths))


def _spare_core():
    """Whether there is a core beside those that the network computes on."""
    return device().type == "cuda" or torch.get_num_threads() < (os.cpu_count() or 1)


def _float(output):
    """An Output in float32, in which the losses are computed whatever the network ran in."""
    *tensors, intermediate = output
    return Output(*(tensor.float() for tensor in tensors), tuple(maps.float() for maps in intermediate))


def train_posenet(paths, settings, *, seed, folder, imagenet=None, checkpoint=None, test=None):
    """Train a network and write weights.safetensors and history.h5 into `folder`; returns the finished PoseTask.

    Parameters
    ----------
    paths : stores of people of one part. settings : Settings. imagenet : path of ResNet-50 weights, or None.
    checkpoint : path for resuming, outside `folder`. test : stores of people to draw the learning curve with, or None.
    """
    cv2.setNumThreads(1)  # the loader is one thread
    torch.set_num_threads(settings.threads)
    task = PoseTask(Mixture(paths, settings.augment.get("replace", 0) > 0), settings, seed, imagenet, test)
    identity = sha256(json.dumps([task.description, str(imagenet)], sort_keys=True).encode())
    for path in [*paths, *(test or ())]:
        identity.update(files.sha256(path).encode())
    torch.set_flush_denormal(True)  # dying activations would slow a training down tenfold
    try:
        history = train(
            task,
            task.total,
            seed=seed,
            checkpoint=checkpoint,
            identity=identity.hexdigest(),
            label=f"posenet {task.people.part}",
        )
    finally:
        task.loader.close()
        torch.set_flush_denormal(False)
    folder = Path(folder)
    save_weights(folder / "weights.safetensors", task.network.cpu().state_dict(), task.description)
    write_history(folder / "history.h5", history)
    finish(checkpoint)
    return task
