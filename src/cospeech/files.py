"""Files that are whole or absent: all that is written goes through here, YAML with limits, arrays without pickles."""

import hashlib
import math
import os
import re
import zipfile
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np
import yaml

from cospeech.errors import CospeechError

YAML_BYTES, YAML_VALUES, YAML_DEPTH, YAML_DIGITS = 4_000_000, 300_000, 50, 18  # the most that a file of settings needs


@contextmanager
def writing(path):
    """Yield a temporary path beside `path`; rename it to `path` when the block ends without an exception.

    A kill, a full disk or an exception leaves the old file (or none) in place, never half of a new one. The temporary
    name keeps the suffix, because writers of video and audio choose their container by it.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise CospeechError(f"{path}: cannot be written ({reason})") from error
    finally:
        with suppress(OSError):  # a name too long, or a folder that is none: there is nothing to remove
            temporary.unlink()


@contextmanager
def writing_hdf5(path, schema, version=1, **attributes):
    """`writing` for HDF5: yields an open `h5py.File` that carries `schema`, `schema_version` and `attributes`."""
    with writing(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs.update(schema=schema, schema_version=version, **attributes)
        yield file


@contextmanager
def reading_hdf5(path, schema, version=1):
    """Yield `path` opened for reading after checking that it is HDF5 of this schema (or one of several) and version."""
    path = Path(path)
    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise CospeechError(f"{path}: not a readable HDF5 file (truncated, or another format)") from error
    with file:
        found, found_version = file.attrs.get("schema"), file.attrs.get("schema_version")
        known = (schema,) if isinstance(schema, str) else schema
        if found not in known:
            raise CospeechError(f"{path}: attribute 'schema' is {found!r}, expected {' or '.join(map(repr, known))}")
        if found_version != version:
            raise CospeechError(
                f"{path}: schema_version is {found_version}, this cospeech reads version {version}; make the file again"
            )
        yield file


def put(group, name, array):
    """Store an array, compressed (gzip + shuffle) as the schemas ask; empty ones are stored plainly."""
    array = np.asarray(array)
    options = {"compression": "gzip", "shuffle": True} if array.ndim and array.size else {}
    return group.create_dataset(name, data=array, track_times=False, **options)


def sha256(path):
    """Hexadecimal SHA-256 of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_yaml(path, invalid="not valid YAML"):
    """What a YAML file holds: dicts, lists, text, numbers, true and false.

    path : a file, or one of a package (`importlib.resources`). invalid : the words for a file that is no YAML.
    Raises CospeechError, one line with path and line, for what cannot be read, is too large (YAML_BYTES, YAML_VALUES
    with aliases written out, YAML_DEPTH, YAML_DIGITS), for a key that is there twice, and for values that YAML reads
    as something else than was meant: 013 (11), 1:30 (90), 2021-03-04 (a date), .nan.
    """
    try:
        with (path if hasattr(path, "open") else Path(path)).open("rb") as file:
            content = file.read(YAML_BYTES + 1)
    except OSError as error:
        raise CospeechError(f"{path}: cannot be read ({error.strerror})") from error
    if len(content) > YAML_BYTES:
        raise CospeechError(f"{path}: larger than {YAML_BYTES / 1e6:g} MB; that is no file of settings")
    try:
        return _Loader(content.decode("utf-8")).get_single_data()
    except (yaml.YAMLError, ValueError, LookupError) as error:  # the latter of explicit tags, as in !!int x
        remedy = "; put a path with backslashes in 'single quotes'" if "escape" in str(error) else ""
        raise CospeechError(f"{path}: {invalid} ({' '.join(str(error).split())}){remedy}") from error
    except _Refused as error:
        raise CospeechError(f"{path}: {error}") from error


class _Refused(Exception):
    def __init__(self, node, text):
        super().__init__(f"line {node.start_mark.line + 1}: {text}")


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with the limits and refusals of `read_yaml`."""

    def __init__(self, stream):
        super().__init__(stream)
        self.depth, self.values, self.sizes = 0, 0, {}  # sizes: of every node, with all that is in it

    def compose_node(self, parent, index):
        event, before = self.peek_event(), self.values
        self.depth += 1
        if self.depth > YAML_DEPTH:
            raise _Refused(event, f"nested more than {YAML_DEPTH} deep")
        node = super().compose_node(parent, index)
        self.depth -= 1
        # An alias counts like what it stands for; within that itself it would have no end.
        alias = isinstance(event, yaml.AliasEvent)
        self.values += self.sizes.get(id(node), YAML_VALUES + 1) if alias else 1
        if self.values > YAML_VALUES:
            raise _Refused(event, f"more than {YAML_VALUES} values, with aliases (*name) written out")
        if not alias:
            self.sizes[id(node)] = self.values - before
        return node

    def compose_mapping_node(self, anchor):
        node, first = super().compose_mapping_node(anchor), {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and (known := first.setdefault((key.tag, key.value), key)) is not key:
                there = f"it is in line {known.start_mark.line + 1} already"
                raise _Refused(key, f"key {key.value!r} is there twice, {there}; keep one")
        return node

    def construct_yaml_int(self, node):
        text = node.value.lstrip("+-")
        if len(text) > YAML_DIGITS:
            raise _Refused(node, f"a number of {len(text)} digits; {YAML_DIGITS} are the most")
        if ":" in text or re.match("0[0-9]", text):
            read = f"{node.value} would be read as {super().construct_yaml_int(node)}"
            remedy = "write seconds" if ":" in text else "a number has no 0 before it"
            raise _Refused(node, f"{read}; {remedy}, and a name goes in quotes: '{node.value}'")
        return super().construct_yaml_int(node)

    def construct_yaml_float(self, node):
        value = super().construct_yaml_float(node)
        if ":" in node.value:
            raise _Refused(node, f"{node.value} would be read as {value:g}; write seconds, or put it in quotes")
        if not math.isfinite(value):
            raise _Refused(node, f"{node.value} is no number to calculate with")
        return value

    def construct_yaml_timestamp(self, node):
        raise _Refused(node, f"{node.value} would be read as a date; put it in quotes: '{node.value}'")


for _kind in ("int", "float", "timestamp"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", getattr(_Loader, f"construct_yaml_{_kind}"))


def load_arrays(path):
    """{name: array} of an .npz file; one clear line for what would have to be unpickled."""
    if not zipfile.is_zipfile(path):
        raise CospeechError(f"{path}: not a readable .npz file (truncated, or another format)")
    try:
        with np.load(path, allow_pickle=False) as content:
            return {name: array for name in content.files if (array := _plain(content, name)) is not None}
    except (OSError, ValueError) as error:
        if "pickle" in str(error):
            raise CospeechError(
                f"{path}: holds pickled objects, which could run any code; save it as arrays"
            ) from error
        raise CospeechError(f"{path}: not a readable .npz file (truncated, or another format)") from error


def _plain(content, name):
    """One array of an .npz file; objects (file lists, say) are left out unless they are all there is."""
    try:
        return content[name]
    except ValueError as error:
        if "pickle" in str(error) and len(content.files) > 1:
            return None
        raise
