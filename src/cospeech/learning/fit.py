"""From a training to files: weights, the same as ONNX, and training curves. Every generator's network is kept so."""

import json
from hashlib import sha256
from pathlib import Path

from cospeech.learning.training import finish, train
from cospeech.learning.weights import export_onnx, save_weights


def fit(task, folder, *, seed, data=b"", label="training", checkpoint=None):
    """Train a `Task` and write weights.safetensors, model.onnx and history.h5 into `folder`.

    Parameters
    ----------
    task : a Task with `settings.steps`, a JSON-able `description` of the network, and `export()` -> (module in eval
        mode, {input: example}, output names). `remembered`, if it has it, is further description that generating needs;
        `sequences` False says that the network's inputs have no time axis of any length.
    data : bytes that differ where the training data do. label : str in front of the progress bar.
    checkpoint : path for resuming, outside `folder`; removed at the end.
    """
    description = task.description | getattr(task, "remembered", {})
    identity = sha256(json.dumps(description, sort_keys=True, default=str).encode() + data).hexdigest()
    history = train(task, task.settings.steps, seed=seed, checkpoint=checkpoint, identity=identity, label=label)
    module, example, outputs = task.export()
    folder = Path(folder)
    save_weights(folder / "weights.safetensors", module.state_dict(), task.description)
    sequences = getattr(task, "sequences", True)
    export_onnx(module, folder / "model.onnx", example, outputs, description, sequences=sequences)
    history.write(folder / "history.h5")
    finish(checkpoint)
