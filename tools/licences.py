"""The licences of all pinned packages, from the metadata of what is installed, as the last tables of THIRD_PARTY.md.

`python tools/licences.py` writes the tables; `make pins` is followed by it. A test says when they are stale.
"""

import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "THIRD_PARTY.md"
MARK = "<!-- What follows is written by tools/licences.py. -->"
PINS = {
    "requirements.txt": "The main environment",
    "mediapipe-requirements.txt": "The environment of tracker mediapipe",
}
SPDX = {
    "3-Clause BSD License": "BSD-3-Clause",
    "Apache 2.0": "Apache-2.0",
    "Apache License, Version 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD 3-Clause License": "BSD-3-Clause",
    "BSD License": "BSD",
    "GNU General Public License (GPL)": "GPL",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "License :: Public Domain": "public domain",
}
# Whose metadata does not tell, or who are in no environment that the tests run in: from their files of licence.
TOLD = {
    "espeakng-loader": "none told; the espeak-ng in it is GPL-3.0-or-later",
    "absl-py": "Apache-2.0",
    "jax": "Apache-2.0",
    "jaxlib": "Apache-2.0",
    "mediapipe": "Apache-2.0",
    "opencv-contrib-python": "Apache-2.0",
    "opt_einsum": "MIT",
    "sentencepiece": "Apache-2.0",
}


def licence(package):
    """The licence of an installed package: its expression, else its short text, its classifiers, its file's heading."""
    if package in TOLD:
        return TOLD[package]
    installed = distribution(package)
    text = installed.metadata.get("License", "")
    if expression := installed.metadata.get("License-Expression") or (text if len(text) < 40 else ""):
        return SPDX.get(expression, expression)
    kinds = [kind for kind in installed.metadata.get_all("Classifier") or [] if kind.startswith("License")]
    if kinds:
        return " or ".join(sorted(SPDX[kind.removeprefix("License :: OSI Approved :: ")] for kind in kinds))
    heading = text or next(file.read_text() for file in installed.files if file.name.upper().startswith("LICENSE"))
    return SPDX[heading.strip().splitlines()[0].strip()]


def pinned(name):
    """[(package, version)] of a file of pins."""
    lines = (ROOT / "envs" / name).read_text().splitlines()
    return [tuple(line.split("==")) for line in lines if line and not line.startswith("#")]


def tables():
    """The text below MARK: a table for each environment."""
    parts = []
    for name, title in PINS.items():
        rows = [f"| {package} | {licence(package)} |" for package, _ in pinned(name)]
        parts += [f"### {title} (`envs/{name}`)", "", "| package | licence |", "| --- | --- |", *rows, ""]
    return "\n".join(parts)


def main():
    try:
        text = tables()
    except PackageNotFoundError as missing:
        sys.exit(f"{missing.name} is not installed: `make env` first")
    PAGE.write_text(f"{PAGE.read_text().split(MARK)[0]}{MARK}\n\n{text}")


if __name__ == "__main__":
    main()
