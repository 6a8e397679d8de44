"""The tables of what people do, read once."""

from importlib.resources import files

import yaml

POSES = yaml.safe_load((files("cospeech.people") / "poses.yaml").read_text("utf-8"))
