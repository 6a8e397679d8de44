"""Films through the whole chain: takes that cannot be used are told, left out, and stop nobody else."""

import csv
import shutil

import numpy as np
import pytest

from cospeech.clip import Clip
from cospeech.evaluation.result import Evaluation
from cospeech.split import Split
from tests.capture.films import textured, write_film
from tests.capture.person import make_track
from tests.workflow.conftest import copy_project

SECONDS, FPS = 10.0, 15
TAKES = {"good": "train", "asked": "test", "cut_off": "train", "nobody": "test"}
SUBJECT = """name: ada
source:
  kind: video
  takes:
    - {id: gone, video: nowhere.mp4}
"""


@pytest.fixture(scope="module")
def finished(snakemake, tmp_path_factory):
    """A subject with two good takes, one whose file breaks off before its index, one without anybody in it, and one
    whose film is not there at all."""
    folder = copy_project(tmp_path_factory.mktemp("refused") / "project")
    (folder / "tracks").mkdir()
    lines = [f"    - {{id: {take}, video: {take}.mp4, part: {part}}}\n" for take, part in TAKES.items()]
    (folder / "subject.yaml").write_text(SUBJECT + "".join(lines) + "tracker: tracks\nfolder: tracks\n")
    film = write_film(folder / "good.mp4", textured(0, 1) * round(SECONDS * FPS), FPS, sounds=1)
    for number, take in enumerate(TAKES):
        if take != "good":
            shutil.copy(film, folder / f"{take}.mp4")
        track = make_track(SECONDS, FPS, noise=0.002, seed=number)
        track.width, track.height = 128, 96
        if take == "nobody":
            track.body.observed[:] = False
        track.write(folder / "tracks" / f"{take}.h5")
    whole = film.read_bytes()
    (folder / "cut_off.mp4").write_bytes(whole[: len(whole) * 6 // 10])
    config = (folder / "config.yaml").read_text().replace("[regression, knn]", "[knn]")
    (folder / "config.yaml").write_text(config)
    done = snakemake(folder, "--configfile", "config.yaml", "--cores", "1")
    assert done.returncode == 0, done.stdout
    return folder / "out"


def test_the_table_tells_why(finished):
    with open(finished / "tables/takes.csv", encoding="utf-8", newline="") as file:
        rows = {row["take"]: row for row in csv.DictReader(file)}
    assert set(rows) == {*TAKES, "gone"}
    assert not rows["good"]["refused"] and float(rows["good"]["body seen [%]"]) > 95
    for take, word in {"cut_off": "truncated", "nobody": "no person", "gone": "no such file"}.items():
        assert word in rows[take]["refused"] and rows[take]["valid [%]"] == "n/a"
    report = (finished / "report.html").read_text(encoding="utf-8")
    assert all(word in report for word in ("truncated", "no person", "no such file"))


def test_refused_takes_train_nothing_and_judge_nothing(finished):
    split = Split.read(finished / "ada/split.h5")
    named = {part: [take for take, _, _ in split.of(part)] for part in ("train", "val", "test")}
    assert named == {"train": ["good"], "val": [], "test": ["asked"]}
    for row in ("ground_truth", "knn"):
        assert Evaluation.read(finished / f"ada/evaluation/{row}.h5").clips == ["asked"]


def test_a_stand_in_vouches_for_nothing(finished):
    clip = Clip.read(finished / "ada/clips/nobody.h5")
    assert "no person" in clip.extra["refused"] and abs(clip.frames - SECONDS * FPS) <= 1
    assert not clip.valid.any() and not clip.confidence.any()
    good = Clip.read(finished / "ada/clips/good.h5")
    elbow, wrist = (clip.positions[0, i] for i in (3, 4))
    true = np.linalg.norm(good.positions[0, 4] - good.positions[0, 3])
    assert np.linalg.norm(wrist - elbow) == pytest.approx(true, abs=1e-3)  # it has the speaker's bones
