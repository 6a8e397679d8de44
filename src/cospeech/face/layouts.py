"""Face models that a user brings, in the layouts in which they are usually given, as arguments of a `FaceModel`."""

from pathlib import Path

import h5py
import numpy as np

from cospeech.errors import CospeechError
from cospeech.face.expressions import LANDMARKS, LIPS
from cospeech.files import sha256

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6}  # metres
TALL = 0.19  # metres, about, of the faces that models show, to tell the unit by
AXES = "its axes must be x to the face's left, y up, z forward"
# {what is needed: the keys under which it may lie}, and FLAME's count of identity columns before the expression's
NAMES = {
    "mean": ("mean", "meanshape", "v_template", "shape/model/mean"),
    "identity": ("identity", "idBase", "shape/model/pcaBasis"),
    "expression": ("expression", "exBase", "expression/model/pcaBasis"),
    "triangles": ("triangles", "tri", "f", "shape/representer/cells"),
    "landmarks": ("landmarks", "keypoints"),
}
VARIANCES = {"identity": "shape/model/pcaVariance", "expression": "expression/model/pcaVariance"}
FLAME_IDENTITY = 300


def arguments(path, *, units=None, landmarks=None, licence=""):
    """What a foreign face model holds, as arguments of `FaceModel`.

    Reads `.npz`, MATLAB `.mat` (v5) and HDF5 `.h5`, by the names of its arrays (`NAMES`).
    units : of its vertices (m, dm, cm, mm, um); guessed from the face's height without. landmarks (68,) : vertices of
    iBUG's landmarks, where the file does not tell them. licence : a note of its terms. Nothing is unpickled. Raises
    CospeechError that names what is missing or does not fit.
    """
    path = Path(path)
    arrays = _arrays(path)
    found = {what: next((arrays[key] for key in keys if key in arrays), None) for what, keys in NAMES.items()}
    if "shapedirs" in arrays:  # FLAME: identity and expression in one array
        both = np.asarray(arrays["shapedirs"], float)
        found["identity"], found["expression"] = both[..., :FLAME_IDENTITY], both[..., FLAME_IDENTITY:]
    for what in ("mean", "identity", "expression", "triangles"):
        if found[what] is None:
            raise CospeechError(f"{path}: no {what} found; expected one of the arrays {', '.join(NAMES[what])}")
    mean = np.asarray(found["mean"], float).reshape(-1, 3)
    if "expression/model/mean" in arrays:
        mean = mean + np.asarray(arrays["expression/model/mean"], float).reshape(-1, 3)
    count = len(mean)
    scale = UNITS[_unit(mean, units, path)]
    bases = {what: _basis(found[what], count, arrays.get(VARIANCES[what]), what, path) * scale for what in VARIANCES}
    points = _landmarks(found["landmarks"] if landmarks is None else landmarks, "meanshape" in arrays, path)
    note = licence or "the terms of its owner hold for every file made from it; ask before giving any on"
    return {
        "name": path.stem,
        "mean": mean * scale,
        **bases,
        "triangles": _triangles(found["triangles"]),
        "landmarks": points,
        "lips": np.unique(points[LIPS][points[LIPS] >= 0]),
        "licence_note": f"face model {path.name} (sha256 {sha256(path)[:12]}): {note}",
    }


def read_landmarks(path):
    """(68,) vertices from a text file of whole numbers, counted from 0, separated by spaces, commas or lines."""
    try:
        return np.array([int(number) for number in Path(path).read_text().replace(",", " ").split()])
    except (OSError, ValueError) as error:
        raise CospeechError(f"{path}: not a list of vertices ({error})") from error


def _arrays(path):
    """{name: array} of all numeric arrays in the file."""
    if not path.is_file():
        raise CospeechError(f"{path}: no such face model; give an .npz, .mat or .h5 file, or leave it out")
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as file:
                return {name: file[name] for name in file.files}
        if path.suffix == ".mat":
            from scipy.io import loadmat

            return {name: array for name, array in loadmat(path).items() if not name.startswith("__")}
        with h5py.File(path, "r") as file:
            arrays = {}
            file.visititems(lambda name, item: arrays.update({name: item} if isinstance(item, h5py.Dataset) else {}))
            return {name: item[()] for name, item in arrays.items()}
    except (OSError, ValueError, EOFError) as error:
        raise CospeechError(f"{path}: not readable as a face model without unpickling ({error})") from error


def _unit(mean, units, path):
    if units is not None and units not in UNITS:
        raise CospeechError(f"{path}: units {units!r}; expected one of {', '.join(UNITS)}")
    tall = np.ptp(mean[:, 1])
    if not tall > 0:
        raise CospeechError(f"{path}: the mean face is flat; {AXES}")
    return units or min(UNITS, key=lambda unit: abs(np.log(tall * UNITS[unit] / TALL)))


def _basis(array, count, variance, what, path):
    """(V, 3, K) from that shape or (3 V, K); principal components times their standard deviations."""
    array = np.asarray(array, float)
    if array.shape[0] not in (count, 3 * count):
        raise CospeechError(f"{path}: {what} has shape {array.shape}, expected ({3 * count}, K) for {count} vertices")
    basis = array.reshape(count, 3, -1)
    return basis if variance is None else basis * np.sqrt(np.asarray(variance, float).ravel())


def _triangles(array):
    """(F, 3) counted from 0, from that shape or its transpose, counted from 0 or 1."""
    array = np.asarray(array).astype(np.int64)
    array = array.T if array.shape[0] == 3 and array.shape[1] != 3 else array.reshape(-1, 3)
    return (array - (array.min() == 1)).astype(np.int32)


def _landmarks(array, from_one, path):
    if array is None:
        return np.full(LANDMARKS, -1)
    array = np.asarray(array).ravel().astype(int) - bool(from_one)
    if len(array) != LANDMARKS:
        raise CospeechError(f"{path}: {len(array)} landmarks, expected iBUG's {LANDMARKS}")
    return array
