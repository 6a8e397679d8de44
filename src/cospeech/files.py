"""Files that are whole or absent: everything the project writes goes through here."""

import hashlib
import os
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from cospeech.errors import CospeechError


@contextmanager
def writing(path):
    """Yield a temporary path beside `path`; rename it to `path` when the block ends without an exception.

    A kill, a full disk or an exception leaves the old file (or none) in place, never half of a new one. The temporary
    name keeps the suffix, because writers of video and audio choose their container by it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise CospeechError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def writing_hdf5(path, schema, version=1, **attributes):
    """`writing` for HDF5: yields an open `h5py.File` that carries `schema`, `schema_version` and `attributes`."""
    with writing(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs.update(schema=schema, schema_version=version, **attributes)
        yield file


@contextmanager
def reading_hdf5(path, schema, version=1):
    """Yield `path` opened for reading after checking that it is HDF5 of this schema and version."""
    path = Path(path)
    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise CospeechError(f"{path}: not a readable HDF5 file (truncated, or another format)") from error
    with file:
        found, found_version = file.attrs.get("schema"), file.attrs.get("schema_version")
        if found != schema:
            raise CospeechError(f"{path}: attribute 'schema' is {found!r}, expected {schema!r}")
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
