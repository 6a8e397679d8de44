"""A small run's results, the study of it, and answers as its page writes them."""

import json
from dataclasses import replace

import numpy as np
import pytest
import soundfile

from cospeech.study.answers import checksum
from cospeech.study.build import Design, build_study
from cospeech.study.stimuli import from_results
from tests.render.conftest import make_clip  # noqa: F401  (a fixture)

METHODS = ["ground_truth", "mismatched", "knn"]
RATE = 16000


@pytest.fixture
def results(tmp_path, make_clip):  # noqa: F811
    """results/anna of two test takes, 1.6 s each, whose left wrist rises by a take's and a method's own amount."""
    for number, take in enumerate(("take01", "take02")):
        for method in ("ground_truth", "knn"):
            clip = make_clip(24, face=method == "ground_truth")
            rise = 0.1 * number + (0.05 if method == "knn" else 0)
            clip.positions[:, 7] += np.array([0, rise, 0], np.float32)
            clip = replace(clip, clip=take, audio=f"../ground_truth/{take}.wav", generator=method)
            path = tmp_path / "results" / "anna" / "synthesis" / method / f"{take}.h5"
            clip.write(path)
            if method == "ground_truth":
                time = np.arange(round(1.6 * RATE)) / RATE
                soundfile.write(path.with_suffix(".wav"), 0.2 * np.sin(2 * np.pi * (200 + 100 * number) * time), RATE)
    (tmp_path / "results" / "anna" / "split.h5").touch()
    return tmp_path / "results"


@pytest.fixture
def stimuli(results):
    """Every method on two tracks of 0.6 s, one of each take."""
    return from_results(results, ["anna"], METHODS, seconds=0.6, excerpts=2)


@pytest.fixture
def make_study(tmp_path, stimuli):
    """Builds a study of these stimuli: -> (folder, content of its study.json)."""

    def make(name="study", **design):
        folder = tmp_path / name
        build_study(folder, stimuli, Design(**({"tracks": 2, "checks": 1, "points": 5} | design)))
        return folder, json.loads((folder / "study.json").read_text())

    return make


@pytest.fixture
def answer(tmp_path):
    """Writes a file of answers as the page does: -> its path."""

    def write(study, participant, value, *, changed=None, edit=None):
        file = answered(study, participant, value) | (changed or {})
        file["checksum"] = checksum(file)
        if edit:
            edit(file)
        path = tmp_path / "answers" / f"answers-{participant}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(file, ensure_ascii=False))
        return path

    return write


def answered(study, participant, value):
    """What the page collects; `value` is called with (condition, question), of pairs (first, second, question)."""
    times = {"play": 500, "ended": 40_000, "answered": 42_000}
    items = [
        {"kind": kind, "stimuli": [s["id"] for s in shown], "values": values, "ms": times, "views": 1, "hidden": 0}
        for kind, shown, values in _shown(study, value)
    ]
    right = "first" if study["kind"] == "pairs" else 2
    check = {
        "kind": "check",
        "stimuli": items[0]["stimuli"],
        "values": dict.fromkeys(study["questions"], right),
        "expected": right,
        "ms": times,
        "views": 1,
        "hidden": 0,
    }
    return {
        "schema": "cospeech.answers",
        "version": 1,
        "study": study["id"],
        "title": study["title"],
        "participant": participant,
        "started": "2026-01-01T10:00:00Z",
        "finished": "2026-01-01T10:20:00Z",
        "complete": True,
        "items": len(items) + study["checks"],
        "answers": items + [check] * study["checks"],
    }


def _shown(study, value):
    for track in dict.fromkeys(s["track"] for s in study["stimuli"]):
        there = [s for s in study["stimuli"] if s["track"] == track]
        if study["kind"] == "rating":
            for one in there:
                yield "rating", [one], {key: value(one["condition"], key) for key in study["questions"]}
            continue
        for i, first in enumerate(there):
            for second in there[i + 1 :]:
                chosen = {key: value(first["condition"], second["condition"], key) for key in study["questions"]}
                yield "pair", [first, second], chosen
