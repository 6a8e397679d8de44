"""The one training loop of every network here: resumable, deterministic, logged.

A network is trained by writing a `Task`: which modules and optimisers there are, and what one iteration does. The loop
owns everything else. Iteration `i` draws its randomness from (seed, i) alone, so a run that was killed and resumed from
its checkpoint ends in the same bytes as one that was not.
"""

import time
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from tqdm import tqdm

from cospeech.errors import CospeechError, notice
from cospeech.files import put, reading_hdf5, writing, writing_hdf5

HISTORY_SCHEMA = "cospeech.history"
HISTORY_ROWS = 400  # at most about so many points in a training curve, each the mean of its interval
CHECKPOINT_SECONDS = 20.0


class Task(Protocol):
    """What the loop needs to know.

    modules {name: nn.Module}, optimizers {name: Optimizer}; `iterate(step, rng)` does one iteration (forward, backward
    and optimiser steps) with the given numpy Generator and returns {loss term: detached scalar tensor or float}. Terms
    may be missing in some iterations (a generator that is updated every fifth one).
    """

    modules: dict
    optimizers: dict

    def iterate(self, step, rng) -> dict: ...


@dataclass
class History:
    """Training curves: `step` (S,) iterations done, `losses` {term: (S,) float32 mean over the interval}, `seconds`."""

    step: list = field(default_factory=list)
    losses: dict = field(default_factory=dict)
    seconds: float = 0.0

    def append(self, step, means):
        for term in self.losses.keys() | means.keys():
            curve = self.losses.setdefault(term, [float("nan")] * len(self.step))
            curve.append(means.get(term, float("nan")))
        self.step.append(step)

    def write(self, path):
        with writing_hdf5(path, HISTORY_SCHEMA, steps=self.step[-1] if self.step else 0) as file:
            put(file, "step", np.array(self.step, np.int64))
            losses = file.create_group("loss")
            for term in sorted(self.losses):
                put(losses, term, np.array(self.losses[term], np.float32))

    @classmethod
    def read(cls, path):
        with reading_hdf5(path, HISTORY_SCHEMA) as file:
            return cls(file["step"][()].tolist(), {term: data[()] for term, data in file["loss"].items()})


def device():
    """CUDA where there is one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def autocast(half=False):
    """Mixed precision (bfloat16, which needs no loss scaling) on CUDA; on the CPU float32, or `half` if that is asked.

    Convolutions of many channels gain by it on processors that have instructions for it; others lose much.
    """
    native = device().type == "cuda" or (half and torch.ops.mkldnn._is_mkldnn_bf16_supported())
    return torch.autocast(device().type, dtype=torch.bfloat16, enabled=native)


def descend(task, name, loss):
    """One step of a task's optimiser `name` down a scalar loss; its other networks' left-over gradients are dropped."""
    for optimizer in task.optimizers.values():
        optimizer.zero_grad(set_to_none=True)
    loss.backward()
    task.optimizers[name].step()


def train(task, steps, *, seed=0, checkpoint=None, identity="", label="training"):
    """Run `steps` iterations of `task`; return its History.

    Parameters
    ----------
    seed : int, the only source of randomness.
    checkpoint : path where progress is kept every 20 seconds and found again after an interruption; removed by
        `finish` once the result is written. None keeps nothing.
    identity : str that says what is being trained on what; a checkpoint of another identity is ignored.
    label : str in front of the progress bar.
    """
    torch.backends.cudnn.deterministic = True
    interval = max(1, steps // HISTORY_ROWS)
    identity = f"{identity} steps={steps} seed={seed}"
    start, history = _resume(task, checkpoint, identity)
    began = saved = time.monotonic()
    terms = {}
    with tqdm(total=steps, initial=start, desc=label, unit="it", mininterval=1.0, dynamic_ncols=True) as bar:
        for step in range(start, steps):
            rng = np.random.default_rng([seed, step])
            torch.manual_seed(int(rng.integers(2**62)))
            for term, value in task.iterate(step, rng).items():
                terms.setdefault(term, []).append(torch.as_tensor(value).float())
            bar.update()
            if (step + 1) % interval and step + 1 < steps:
                continue
            means = {term: torch.stack(values).mean().item() for term, values in terms.items()}
            _check(means, label, step)
            history.append(step + 1, means)
            terms = {}
            bar.set_postfix({term: f"{value:.3g}" for term, value in means.items()}, refresh=False)
            if checkpoint and time.monotonic() - saved > CHECKPOINT_SECONDS:
                _save(task, checkpoint, identity, step + 1, history)
                saved = time.monotonic()
    history.seconds = time.monotonic() - began
    return history


def finish(checkpoint):
    """Remove a checkpoint whose training is over and whose results are on disk."""
    if checkpoint:
        Path(checkpoint).unlink(missing_ok=True)


def _check(means, label, step):
    bad = [term for term, value in means.items() if not np.isfinite(value)]
    if bad:
        raise CospeechError(
            f"{label}: loss term {bad[0]} is not finite after {step + 1} iterations; lower learning_rate in the budget"
        )


def _save(task, path, identity, step, history):
    state = {
        "identity": identity,
        "step": step,
        "history": {"step": history.step, "losses": history.losses},
        "modules": {name: module.state_dict() for name, module in task.modules.items()},
        "optimizers": {name: optimizer.state_dict() for name, optimizer in task.optimizers.items()},
    }
    with writing(path) as temporary:
        torch.save(state, temporary)


def _resume(task, path, identity):
    if not path or not Path(path).is_file():
        return 0, History()
    if not zipfile.is_zipfile(path):  # what torch.save writes, and what a truncated file no longer is
        notice(f"{path}: unreadable checkpoint, training starts from the beginning")
        return 0, History()
    state = torch.load(path, map_location=device(), weights_only=True)
    if state["identity"] != identity:
        notice(f"{path}: checkpoint of another run, training starts from the beginning")
        return 0, History()
    for name, module in task.modules.items():
        module.load_state_dict(state["modules"][name])
    for name, optimizer in task.optimizers.items():
        optimizer.load_state_dict(state["optimizers"][name])
    notice(f"{path}: resumed after {state['step']} iterations")
    return state["step"], History(**state["history"])
