"""Data sets ready for training: one HDF5 (schema `cospeech.posenet.data`) of labelled crops, read at random.

    attributes    part, source, licence_note, size, margin, correction, scale, dropped (JSON {reason: count})
    /images       bytes u1 (B,), the crops as JPEG, one after another; ends i8 (N,), where each stops
    /mask         the same as PNG; only when some sample has a mask
    /joints2d f4 (N, K, 2)   /visible bool (N, K)   /joints3d f4 (N, J, 3)   /labelled3d bool (N,)
    /tags/<name>  codes i4 (N,), values utf-8
    /bone_lengths f4 (subjects, J) mm, the lengths that equation 3.6 draws from; /bone_subjects utf-8

JPEG and not raw pixels: a quarter of the disk or less, for a millisecond of one core a crop (bench_posenet_data.py).
"""

import json

import cv2
import h5py
import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.posenet.datasets.parts import PARTS
from cospeech.posenet.samples import Batch
from cospeech.posenet.threads import in_threads

SCHEMA = "cospeech.posenet.data"
QUALITY = 95  # of JPEG
CHUNK = 1 << 18  # bytes of encoded images that HDF5 keeps together
LABELS = ("joints2d", "visible", "joints3d", "labelled3d")
PIECE = 1 << 16  # poses held at once when bones are measured
KEEP = np.uint8(255)  # a mask of this everywhere: nothing of the image is background that may be replaced


def write_store(path, batches, *, part, source, margin=1.0, licence_note="", dropped=None, **attributes):
    """Write crops as they come; memory is bounded by one batch.

    Parameters
    ----------
    batches : iterator of `Batch`, all of one size. part : "body", "hand" or "face".
    margin : how many times wider than the network's crop these crops are, so that there is room to turn and shift them.
    dropped : {reason: count} of what was left out; read at the end, so the iterator may fill it while it runs.
    attributes : further attributes of the file (correction, scale...).

    Returns how many crops were written. Raises CospeechError when there are none or the batches do not fit together.
    """
    description = {"part": part, "source": source, "margin": float(margin), "licence_note": licence_note, **attributes}
    with writing_hdf5(path, SCHEMA, **description) as file:
        writer = _Writer(file, _part(part, path), path)
        for batch in batches:
            writer.append(batch)
        if not writer.count:
            left_out = ", ".join(f"{count} {reason}" for reason, count in (dropped or {}).items()) or "it is empty"
            raise CospeechError(f"{source}: no usable sample in it ({left_out})")
        writer.finish(_part(part, path).skeleton.parents)
        file.attrs["dropped"] = json.dumps(dict(dropped or {}), sort_keys=True)
    return writer.count


def _part(part, path):
    if part not in PARTS:
        raise CospeechError(f"{path}: part {part!r} is unknown; known: {', '.join(PARTS)}")
    return PARTS[part]


class _Writer:
    """Appends batches to an open file."""

    def __init__(self, file, part, path):
        self.file, self.part, self.path, self.count, self.size = file, part, path, 0, None
        self.tags = {}  # {name: {value: code}}
        self.labels = {}

    def append(self, batch):
        if not len(batch):
            return
        size = batch.images.shape[1]
        self.size = self.size or size
        counts = (len(self.part.heatmaps), len(self.part.skeleton))
        if batch.images.shape[1:] != (self.size, self.size, 3):
            raise CospeechError(f"{self.path}: crops of {batch.images.shape[1:]} after crops of side {self.size}")
        if (batch.joints2d.shape[1], batch.joints3d.shape[1]) != counts:
            raise CospeechError(f"{self.path}: expected {counts[0]} joints in 2D and {counts[1]} in 3D")
        if batch.mask is not None and "mask" not in self.file and self.count:
            self._extend_encoded("mask", [self._whole()] * self.count)
        pictures = [np.ascontiguousarray(image[..., ::-1]) for image in batch.images]
        self._extend_encoded("images", [_encode(picture, ".jpg", QUALITY) for picture in pictures])
        if batch.mask is not None:
            self._extend_encoded("mask", [_encode(mask, ".png") for mask in batch.mask])
        elif "mask" in self.file:
            self._extend_encoded("mask", [self._whole()] * len(batch))
        for name in LABELS:
            self._extend(name, getattr(batch, name))
        self._extend_tags(batch)
        self.count += len(batch)

    def _whole(self):
        return _encode(np.full((self.size, self.size), KEEP), ".png")

    def _extend_encoded(self, name, encoded):
        start = len(self.file[name]["bytes"]) if name in self.file else 0
        self._extend(f"{name}/bytes", np.concatenate(encoded), (CHUNK,))
        self._extend(f"{name}/ends", start + np.cumsum([len(code) for code in encoded]))

    def _extend(self, name, array, chunks=True):
        if name not in self.file:
            shape = (0, *array.shape[1:])
            kind = {np.dtype(np.float64): np.float32}.get(array.dtype, array.dtype)
            self.file.create_dataset(name, shape, kind, maxshape=(None, *shape[1:]), chunks=chunks, track_times=False)
        data = self.file[name]
        data.resize(len(data) + len(array), axis=0)
        data[len(data) - len(array) :] = array

    def _extend_tags(self, batch):
        for name in sorted(self.tags.keys() | batch.tags.keys()):
            if name not in self.tags:
                self.tags[name] = {"": 0}
                if self.count:
                    self._extend(f"tags/{name}/codes", np.zeros(self.count, np.int32))
            codes = self.tags[name]
            values = batch.tags.get(name, [""] * len(batch))
            numbers = [codes.setdefault(str(value), len(codes)) for value in values]
            self._extend(f"tags/{name}/codes", np.array(numbers, np.int32))

    def finish(self, parents):
        self.file.attrs["size"] = self.size
        for name, codes in self.tags.items():
            put(self.file, f"tags/{name}/values", np.array(list(codes), h5py.string_dtype()))
        subjects = _tag(self.file, "subject") if "subject" in self.tags else np.full(self.count, "")
        lengths = _bone_lengths(self.file, subjects, np.array(parents))
        put(self.file, "bone_lengths", np.array(list(lengths.values()), np.float32).reshape(-1, len(parents)))
        put(self.file, "bone_subjects", np.array(list(lengths), h5py.string_dtype()))


def _encode(image, suffix, quality=None):
    return cv2.imencode(suffix, image, [] if quality is None else [cv2.IMWRITE_JPEG_QUALITY, quality])[1]


def _bone_lengths(file, subjects, parents):
    """{subject: (J,) median length of each bone in mm, 0 for the root} of those with 3D labels."""
    labelled = file["labelled3d"][:]
    above = np.where(parents < 0, np.arange(len(parents)), parents)
    pieces = (file["joints3d"][start : start + PIECE] for start in range(0, len(labelled), PIECE))
    lengths = np.concatenate([np.linalg.norm(poses - poses[:, above], axis=-1) for poses in pieces])
    names = sorted(set(subjects[labelled].tolist()))
    return {name: np.median(lengths[labelled & (subjects == name)], axis=0) for name in names}


class Store:
    """A file of `write_store`, opened for reading.

    `len(store)`; `store[i]`, `store[slice]`, `store[array]` -> `Batch` of those crops in order. Images are read and
    decoded as they are asked for; labels are in memory: joints2d, visible, joints3d, labelled3d, tags, as in `Batch`.
    attrs : the file's attributes, `dropped` as a dict. part, size, margin : three of them.
    bone_lengths (subjects, J) : mm, of those who have 3D labels.
    """

    def __init__(self, path):
        self.path = str(path)
        with reading_hdf5(path, SCHEMA) as file:
            missing = [name for name in (*LABELS, "images/bytes", "images/ends", "bone_lengths") if name not in file]
            if missing:
                raise CospeechError(f"{path}: has no {missing[0]!r}; make it again with `cospeech posenet prepare`")
            self.attrs = dict(file.attrs) | {"dropped": json.loads(file.attrs["dropped"])}
            self.joints2d, self.visible, self.joints3d, self.labelled3d = (file[name][:] for name in LABELS)
            self._ends = {name: file[name]["ends"][:] for name in ("images", "mask") if name in file}
            self.bone_lengths = file["bone_lengths"][:]
            self.tags = {name: _tag(file, name) for name in file.get("tags", ())}
        self.part, self.size, self.margin = self.attrs["part"], int(self.attrs["size"]), float(self.attrs["margin"])
        self._file = h5py.File(path, "r")

    def __len__(self):
        return len(self.visible)

    def __getitem__(self, chosen):
        index = np.atleast_1d(np.arange(len(self))[chosen])
        images = np.empty((len(index), self.size, self.size, 3), np.uint8)
        mask = np.empty((len(index), self.size, self.size), np.uint8) if "mask" in self._ends else None

        def decode(rows):
            for row in rows:
                images[row] = self._decode("images", index[row], cv2.IMREAD_COLOR_RGB)
                if mask is not None:
                    mask[row] = self._decode("mask", index[row], cv2.IMREAD_GRAYSCALE)

        in_threads(decode, len(index))
        labels = {name: getattr(self, name)[index] for name in LABELS}
        return Batch(images, **labels, mask=mask, tags={name: values[index] for name, values in self.tags.items()})

    def _decode(self, name, i, flags):
        ends = self._ends[name]
        image = cv2.imdecode(self._file[name]["bytes"][ends[i - 1] if i else 0 : ends[i]], flags)
        if image is None:
            raise CospeechError(f"{self.path}: crop {i} does not decode; the file is damaged, make it again")
        return image


def _tag(file, name):
    values = file["tags"][name]["values"].asstr()[:] if "values" in file["tags"][name] else None
    return np.array(values.tolist())[file["tags"][name]["codes"][:]]
