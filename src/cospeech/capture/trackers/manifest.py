"""Manifests: what one needs to know to run somebody's ONNX file, as a YAML file beside it (docs/capture.md)."""

from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from cospeech.capture.trackers import codecs
from cospeech.errors import CospeechError
from cospeech.files import read_yaml, sha256
from cospeech.skeleton import Skeleton
from cospeech.track import PARTS

CODECS = (*codecs.POINTS, "pose", "coefficients")
KEYS = ("name", "model", "licence_note", "input", "codec", "parts")
PARTS_OF = {"body": ("body",), "hand": ("left_hand", "right_hand"), "face": ("face_landmarks",)}  # of our networks
# Mean scores from which they are believed. Of the hands in view that the network is tested on, 99 of 100 reach 0.6; a
# crop that shows none mostly stays below. A body's and a face's hardly ever matter.
LEAST_OF = {"body": 0.1, "hand": 0.6, "face": 0.1}
SKELETONS_OF = {"body": "mpi_inf_3dhp21", "hand": "hand21", "face": "face68"}


@dataclass(frozen=True)
class Manifest:
    """One network.

    Attributes
    ----------
    name, licence_note : as they go into the track. model : its ONNX file. sha256 : of that file, "" if not stated.
    size : (width, height) of the crop. layout : "NCHW" or "NHWC". channels : "RGB" or "BGR". scale : what 0..255 is
        multiplied by, before `mean` is subtracted and `std` divided out, channel by channel.
    codec : {"kind": one of CODECS, ...}, see `codecs`; outputs are named, or numbered from 0.
    parts : {part of the track: {"skeleton": name, "first": its first point among the network's}}; for coefficients
        {"face": {"model": name}}.
    margin : how much wider than the box a crop is. least : score from which a point counts as found. mirrored : whether
        the network knows right hands only, so that left ones are shown to it in a mirror.
    camera : {"focal": [fx, fy], "depth": metres}, with which points with depth are taken into space.
    """

    name: str
    model: Path
    size: tuple
    codec: dict
    parts: dict
    licence_note: str = ""
    sha256: str = ""
    layout: str = "NCHW"
    channels: str = "RGB"
    scale: float = 1.0
    mean: tuple = (0.0, 0.0, 0.0)
    std: tuple = (1.0, 1.0, 1.0)
    margin: float = 1.25
    least: float = 0.3
    mirrored: bool = False
    camera: dict = field(default_factory=dict)


def read_manifest(path, model=None):
    """The `Manifest` of a YAML file, or of the one shipped under that name ("rtmw3d", "deep3dfacerecon").

    `model` overrules the ONNX file that it names. Raises CospeechError that names file and key.
    """
    path = Path(path)
    if path.suffix not in (".yaml", ".yml"):
        shipped = files("cospeech.capture.trackers") / "manifests"
        known = sorted(Path(f.name).stem for f in shipped.iterdir() if f.name.endswith(".yaml"))
        if str(path) not in known:
            raise CospeechError(f"{path}: neither a manifest (.yaml) nor one of {', '.join(known)}")
        content, folder = read_yaml(shipped / f"{path}.yaml"), Path()
    else:
        content, folder = read_yaml(path), path.parent
    if not isinstance(content, dict):
        raise CospeechError(f"{path}: expected keys and values")
    try:
        manifest = _ours(content, folder) if content.get("schema") == "cospeech.posenet" else _any(content, folder)
    except (KeyError, TypeError, ValueError) as error:
        raise CospeechError(f"{path}: no complete manifest, missing or odd: {error}") from error
    return _checked(path, manifest if model is None else _replaced(manifest, Path(model)))


def _replaced(manifest, model):
    from dataclasses import replace

    return replace(manifest, model=model)


def _any(content, folder):
    if missing := [key for key in KEYS if key not in content]:
        raise KeyError(missing[0])
    known = {"layout", "channels", "scale", "mean", "std"}
    image = {key: tuple(v) if isinstance(v, list) else v for key, v in content["input"].items() if key in known}
    crop = content.get("crop", {})
    return Manifest(
        content["name"],
        folder / content["model"],
        _size(content["input"]["size"]),
        content["codec"],
        content["parts"],
        content["licence_note"],
        content.get("sha256", ""),
        **image,
        margin=crop.get("margin", 1.25),
        least=crop.get("least_score", 0.3),
        mirrored=crop.get("mirrored", False),
        camera=content.get("camera", {}),
    )


def _ours(content, folder):
    """The manifest that the export of our own pose networks writes."""
    part, image, skeleton = content["part"], content["input"], content["skeleton"]
    table = Skeleton.load(SKELETONS_OF[part])
    if tuple(skeleton["joints"]) != table.names:
        raise ValueError(f"joints (they are not those of {table.name})")
    codec = {"kind": "pose", "points": "points", "pose": "pose", "maps": "heatmaps", "root": skeleton["root"]}
    codec["mapped"] = table.joints(*skeleton["heatmap_joints"])
    return Manifest(
        f"posenet {part}",
        folder / content["model"],
        _size(image["size"]),
        codec,
        {name: {"skeleton": table.name, "first": 0} for name in PARTS_OF[part]},
        content["licence_note"],
        content["sha256"],
        image["layout"],
        image["channels"],
        (image["range"][1] - image["range"][0]) / 255,
        margin=image["crop"]["margin"],
        least=LEAST_OF[part],
        mirrored=part == "hand",
    )


def _size(size):
    width, height = (int(side) for side in size)
    return width, height


def _checked(path, manifest):
    kind = manifest.codec.get("kind")
    if kind not in CODECS:
        raise CospeechError(f"{path}: codec kind {kind!r} is not one of {', '.join(CODECS)}")
    known = ("face",) if kind == "coefficients" else PARTS
    if unknown := [part for part in manifest.parts if part not in known]:
        raise CospeechError(f"{path}: part {unknown[0]!r} is not one of {', '.join(known)} (codec {kind})")
    if manifest.layout not in ("NCHW", "NHWC") or manifest.channels not in ("RGB", "BGR"):
        raise CospeechError(f"{path}: input: layout {manifest.layout}, channels {manifest.channels} are unknown")
    if not manifest.model.is_file():
        raise CospeechError(f"{path}: model {manifest.model}: no such file; put the ONNX file there, or name it")
    if manifest.sha256 and manifest.sha256 != sha256(manifest.model):
        raise CospeechError(f"{path}: {manifest.model} is another file than the manifest was written for (sha256)")
    return manifest
