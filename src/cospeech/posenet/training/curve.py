"""The learning curve: PCK on people that a training does not see, while it runs, and what history.h5 keeps of it."""

import numpy as np
import torch

from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.learning.training import HISTORY_SCHEMA, autocast, device
from cospeech.posenet.evaluation.accuracy import scores
from cospeech.posenet.network import images_of
from cospeech.posenet.store import Store
from cospeech.posenet.training.augment import center

PEOPLE = 300  # of each domain, evenly spaced through the store; the same at every point
POINTS = 10  # evenly spaced through a training
AT_ONCE = 100
TERM = "PCK "  # what a point's names in the training's history begin with


class LearningCurve:
    """Calling it with a network gives {"PCK <domain>": percent, globally scaled}, by the rules of `accuracy`.

    paths : stores of people with 3D truth. part : that they show. design : the network's. half : as in `Settings`.
    """

    def __init__(self, paths, part, design, half=False):
        self.part, self.joints, self.root = part, design.joints, design.joints.index(design.root)
        self.unit, self.half, self.people = 1000 * design.unit, half, {}
        for path in paths:
            store = Store(path)
            domain = store.tags.get("domain", np.full(len(store), store.attrs["source"]))
            known = np.abs(store.joints3d).any(axis=(1, 2))
            for name in sorted(set(domain[known].tolist())):
                chosen = np.flatnonzero(known & (domain == name))
                chosen = chosen[np.linspace(0, len(chosen) - 1, min(PEOPLE, len(chosen))).astype(int)]
                self.people[name] = center(store[chosen], design.input, part=part, margin=store.margin)

    def __call__(self, network):
        network.eval()
        found = {}
        with torch.inference_mode(), autocast(self.half):
            for name, people in self.people.items():
                pieces = images_of(people).contiguous(memory_format=torch.channels_last).split(AT_ONCE)
                poses = torch.cat([network(piece.to(device())).pose.float() for piece in pieces]).cpu().numpy()
                found[TERM + name] = scores(self.unit * poses, people.joints3d, "scale", self)["PCK"]
        network.train()
        return found


def write_history(path, history):
    """Write history.h5: the losses as every training does, and the learning curve as pck/step and pck/<domain>."""
    steps = np.array(history.step, np.int64)
    terms = {term: np.array(values, np.float32) for term, values in sorted(history.losses.items())}
    with writing_hdf5(path, HISTORY_SCHEMA, steps=history.step[-1] if history.step else 0) as file:
        put(file, "step", steps)
        file.create_group("loss")
        for term, values in terms.items():
            if not term.startswith(TERM):
                put(file, f"loss/{term}", values)
                continue
            known = np.isfinite(values)
            put(file, f"pck/{term.removeprefix(TERM)}", values[known])
            if "step" not in file["pck"]:
                put(file, "pck/step", steps[known])


def learning_curve(path):
    """(steps (P,) iterations done, {domain: (P,) PCK in percent}) of a history.h5; empty where it has no curve."""
    with reading_hdf5(path, HISTORY_SCHEMA) as file:
        found = {name: data[()] for name, data in file.get("pck", {}).items()}
    return found.pop("step", np.zeros(0, np.int64)), found
