"""Trained networks on disk: weights as safetensors with their description, and the same network as ONNX.

Generation runs on the ONNX file through onnxruntime, so that it starts without importing torch.
"""

import json
import logging
import os
import warnings

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import writing

TOLERANCE = 1e-4  # largest difference between ONNX and torch that an export may have, relative to the output's size


def save_weights(path, tensors, description):
    """Write {name: array or tensor} as safetensors; `description` (a JSON-able dict) goes into the file's header."""
    from safetensors.numpy import save

    arrays = {name: np.ascontiguousarray(np.asarray(tensor)) for name, tensor in tensors.items()}
    with writing(path) as temporary:
        temporary.write_bytes(save(arrays, {"cospeech": json.dumps(description, sort_keys=True)}))


def load_weights(path):
    """Return ({name: array}, description) of a file written by `save_weights`; CospeechError when it is none."""
    from safetensors import SafetensorError, safe_open

    if not os.path.isfile(path):
        raise CospeechError(f"{path}: no such file; train the model first")
    try:
        with safe_open(path, framework="numpy") as file:
            header = (file.metadata() or {}).get("cospeech")
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except SafetensorError as error:
        raise CospeechError(f"{path}: not a readable safetensors file ({error})") from error
    if header is None:
        raise CospeechError(f"{path}: these weights were not written by cospeech (no description in the header)")
    return arrays, json.loads(header)


def read_tensors(path):
    """{name: torch tensor} of a state_dict that others wrote: .safetensors, or .pth, of which only tensors are read.

    Raises CospeechError for a file that is neither.
    """
    from pickle import UnpicklingError  # what torch raises, reading tensors alone, when there is more in the file

    import torch
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        found = load_file(path) if str(path).endswith(".safetensors") else torch.load(path, "cpu", weights_only=True)
    except OSError as error:
        raise CospeechError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (SafetensorError, UnpicklingError, RuntimeError, EOFError) as error:
        raise CospeechError(f"{path}: not a readable .safetensors or .pth file of tensors") from error
    if not isinstance(found, dict):
        raise CospeechError(f"{path}: holds a {type(found).__name__}, expected a state_dict of tensors by name")
    return found


def load_torchvision(module, path, architecture, fitting, without=()):
    """Put weights in torchvision's layout (`read_tensors`) into a module that names its parameters alike.

    architecture : "resnet50", as an error names it. fitting : what a module must be for them to fit. without :
    beginnings of names that torchvision's network does not have. Raises CospeechError when the file is unreadable or of
    another network.
    """
    found = read_tensors(path)
    wanted = {name: tensor for name, tensor in module.state_dict().items() if not name.startswith(tuple(without))}
    for name, tensor in wanted.items():
        if name not in found and not name.endswith("num_batches_tracked"):
            raise CospeechError(f"{path}: has no {name!r}; expected {architecture}'s weights in torchvision's layout")
        if name in found and found[name].shape != tensor.shape:
            shapes = f"{tuple(found[name].shape)}, this network's {tuple(tensor.shape)}"
            raise CospeechError(f"{path}: {name} is {shapes}; ImageNet weights fit {fitting}")
    module.load_state_dict({name: found[name] for name in wanted if name in found}, strict=False)


def export_onnx(module, path, inputs, outputs, description, *, sequences=True):
    """Write a torch module as one ONNX file and check it against torch.

    Parameters
    ----------
    module : nn.Module in eval mode, called with the inputs in order.
    inputs : {name: example tensor (B, C, T)}; batch and time become free sizes; a batch of one stays one.
    outputs : names of the outputs.
    description : JSON-able dict, kept in the file's metadata under "cospeech"; its `multiple` is that of time.
    sequences : whether there is a time axis; False frees the batch alone (images).

    Raises CospeechError when onnxruntime's outputs differ from torch's by more than `TOLERANCE`.
    """
    import onnx
    import torch

    free = {0: torch.export.Dim("batch")} if len(next(iter(inputs.values()))) > 1 else {}
    if sequences:
        steps = torch.export.Dim("steps", min=1, max=1 << 20)
        free[2] = description["multiple"] * steps if description["multiple"] > 1 else steps
    shapes = tuple(free for _ in inputs)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter's remarks on its own API and on names of shared axes
        program = torch.onnx.export(
            module.eval(),
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_shapes=shapes,
            dynamo=True,
            verbose=False,
        )
    model = program.model_proto
    for node in (*model.graph.node, *model.graph.value_info, *(n for f in model.functions for n in f.node)):
        del node.metadata_props[:]  # the exporter's stack traces hold this machine's paths
    model.metadata_props.add(key="cospeech", value=json.dumps(description, sort_keys=True))
    with writing(path) as temporary:
        onnx.save(model, temporary)
        _compare(module, OnnxNetwork(temporary), inputs, path)


def _compare(module, network, inputs, path):
    import torch

    with torch.inference_mode():
        expected = module(*inputs.values())
    expected = expected if isinstance(expected, (tuple, list)) else (expected,)
    found = network(**{name: tensor.numpy() for name, tensor in inputs.items()})
    for name, a, b in zip(network.outputs, found, expected, strict=True):
        b = b.numpy()
        worst = np.abs(a - b).max() / max(1.0, np.abs(b).max())
        if not worst < TOLERANCE:
            raise CospeechError(f"{path}: ONNX output {name} differs from torch by {worst:.2g}")


class OnnxNetwork:
    """An ONNX file run by onnxruntime: `network(name=array, ...) -> [arrays]`."""

    def __init__(self, path, threads=None):
        import onnxruntime

        if not os.path.isfile(path):
            raise CospeechError(f"{path}: no such file; train the model first")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or os.cpu_count()
        options.log_severity_level = 3
        try:
            self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's own exception classes have no common parent but Exception
            raise CospeechError(f"{path}: not a readable ONNX network ({error})") from error
        self.outputs = [output.name for output in self.session.get_outputs()]
        metadata = self.session.get_modelmeta().custom_metadata_map
        self.description = json.loads(metadata.get("cospeech", "{}"))

    def __call__(self, **inputs):
        return self.session.run(None, {name: np.asarray(array, np.float32) for name, array in inputs.items()})

    def run_long(self, chunk=4096, **inputs):
        """Run a convolutional network over sequences of any length in memory that does not grow with them.

        name=(T, C) arrays -> {output name: (T, C')}. The sequence is cut into chunks that overlap by the description's
        `halo`, more frames than the network can see, on its pooling grid (`multiple`), so that the result is that of
        one whole run, without seams. Without a halo it runs at once. The end is padded with
        its last frame to that multiple.
        """
        multiple, halo = self.description["multiple"], self.description["halo"]
        frames = len(next(iter(inputs.values())))
        if halo is None:  # a network that remembers: it has to hear everything at once
            chunk, halo = max(frames, 1), 0
        total = frames + -frames % multiple
        padded = {name: np.pad(array, ((0, total - frames), (0, 0)), mode="edge") for name, array in inputs.items()}
        pieces = []
        for start in range(0, total, chunk):
            low, high = max(0, start - halo), min(total, start + chunk + halo)
            outputs = self(**{name: array[None, low:high].swapaxes(1, 2) for name, array in padded.items()})
            pieces.append([output[0].T[start - low : start - low + chunk] for output in outputs])
        joined = [np.concatenate(parts)[:frames] for parts in zip(*pieces, strict=True)]
        return dict(zip(self.outputs, joined, strict=True))
