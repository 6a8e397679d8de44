"""What a file of this project holds, in words (`cospeech info`)."""

import json
from pathlib import Path

import h5py
import numpy as np

from cospeech.errors import CospeechError
from cospeech.learning.weights import load_weights


def describe(path):
    """A text of several lines about an HDF5 or safetensors file; CospeechError when it is neither."""
    path = Path(path)
    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    if path.suffix == ".safetensors":
        return _describe_weights(path)
    try:
        with h5py.File(path, "r") as file:
            return "\n".join([f"{path}: {file.attrs.get('schema', 'HDF5 of another program')}", *_describe_group(file)])
    except OSError as error:
        raise CospeechError(f"{path}: neither HDF5 nor safetensors, or truncated") from error


def _describe_group(group, depth=1):
    indent = "  " * depth
    for key, value in sorted(group.attrs.items()):
        yield f"{indent}{key} = {value}"
    for name, item in sorted(group.items()):
        if isinstance(item, h5py.Group):
            yield f"{indent}{name}/"
            yield from _describe_group(item, depth + 1)
        else:
            yield f"{indent}{name}  {item.dtype} {item.shape}{_range(item)}"


def _range(dataset):
    """Smallest and largest number, for arrays small enough to read in a moment."""
    if dataset.dtype.kind not in "fiu" or not 0 < dataset.size < 10_000_000:
        return ""
    values = dataset[()]
    return f"  {np.min(values):.4g} .. {np.max(values):.4g}"


def _describe_weights(path):
    arrays, description = load_weights(path)
    count = sum(array.size for array in arrays.values())
    text = json.dumps(_shortened(description), indent=2)
    return "\n".join([f"{path}: {len(arrays)} arrays, {count:,} numbers", *text.splitlines()])


def _shortened(value, longest=12):
    """A JSON value in which long lists are told by their length."""
    if isinstance(value, dict):
        return {key: _shortened(part, longest) for key, part in value.items()}
    if isinstance(value, list):
        return [_shortened(part, longest) for part in value] if len(value) <= longest else f"{len(value)} values"
    return value
