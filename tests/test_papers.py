"""LICENSE, THIRD_PARTY.md, CITATION.cff and CHANGELOG.md agree with the code and with what is installed."""

import json
import re
from pathlib import Path

import yaml

from cospeech import __version__
from tests.test_dependencies import PROJECT, names
from tools import licences

ROOT = Path(__file__).parents[1]
THIRD_PARTY = (ROOT / "THIRD_PARTY.md").read_text()


def test_every_dependency_has_a_row_with_its_licence():
    own, pinned = THIRD_PARTY.split("## Everything that is pinned")
    rows = dict(re.findall(r"^\| `([\w-]+)` \| .+ \| (.+) \| .+ \|$", own, re.MULTILINE))
    asked = names(PROJECT["dependencies"] + [d for extra in PROJECT["optional-dependencies"].values() for d in extra])
    node = json.loads((ROOT / "tests/package.json").read_text())["devDependencies"]
    assert set(rows) == asked | set(node)
    installed = dict(re.findall(r"^\| ([\w-]+) \| (.+) \|$", pinned, re.MULTILINE))
    for name in asked:
        told = next(licence for package, licence in installed.items() if package.lower() == name)
        family = re.match(r"[A-Za-z]+", told)[0]  # MIT, BSD, Apache, LGPL...
        assert family in rows[name], f"{name}: {told}"


def test_the_pinned_packages_licences_are_those_of_their_metadata():
    assert THIRD_PARTY.endswith(licences.tables()), "run: python tools/licences.py"
    for name in licences.PINS:
        assert all(f"| {package} | " in THIRD_PARTY for package, _ in licences.pinned(name))


def test_copyleft_that_a_distributor_must_know_of_is_named():
    parts = THIRD_PARTY.split("## What you must do")[1].split("## What this project asks for")[0]
    assert all(word in parts for word in ("espeak-ng", "x264", "x265", "GPL-3.0", "LGPL-2.1", "MPL-2.0", "EPL-2.0"))


def test_version_and_licence_are_told_alike_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0" and citation["version"] == __version__
    assert citation["license"] == PROJECT["license"] == "MIT"
    assert (ROOT / "LICENSE").read_text().startswith("MIT License\n\nCopyright (c) 2026 the cospeech authors\n")
    assert re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == __version__


def test_the_three_publications_are_cited():
    references = yaml.safe_load((ROOT / "CITATION.cff").read_text())["references"]
    assert [(entry["authors"][0]["family-names"], entry["year"]) for entry in references] == [
        ("Habibie", 2021),
        ("Habibie", 2023),
        ("Liu", 2022),
    ]
