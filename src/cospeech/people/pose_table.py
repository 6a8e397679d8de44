"""The tables of what people do, read once."""

from importlib.resources import files

from cospeech.files import read_yaml

POSES = read_yaml(files("cospeech.people") / "poses.yaml")
