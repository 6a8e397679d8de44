"""The whole chain on a tiny demo speaker: killed, started again, finished, and then nothing left to do."""

import csv
import hashlib
import os
import shutil
import signal
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from cospeech.clip import Clip
from tests.conftest import make_clip
from tests.workflow.conftest import copy_project

RUN = ("--configfile", "config.yaml", "--cores", "1")


@pytest.fixture(scope="module")
def finished(snakemake, tmp_path_factory):
    """A whole run that was killed (SIGKILL, the workflow and its job) while it trained, and started again."""
    folder = copy_project(tmp_path_factory.mktemp("run") / "project")
    running = snakemake(folder, *RUN, start=True)
    deadline = time.monotonic() + 300
    while not (folder / "out/logs/train/tiny-regression.log").is_file() and time.monotonic() < deadline:
        assert running.poll() is None, "the run ended before it could be killed"
        time.sleep(0.1)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    assert not (folder / "out/report.html").exists()
    again = snakemake(folder, *RUN)
    assert again.returncode == 0, again.stdout
    return folder


def test_results_lie_where_the_design_says(finished):
    out = finished / "out"
    speaker = out / "tiny"
    expected = ["split.h5", "database.h5", "media/take01.wav", "clips/take01.h5", "clips/take02.h5"]
    expected += [f"models/regression/{name}" for name in ("weights.safetensors", "model.onnx", "history.h5")]
    expected += [f"evaluation/{row}.h5" for row in ("ground_truth", "mismatched", "mean_pose", "regression", "knn")]
    (test,) = (path.stem for path in (speaker / "synthesis/ground_truth").glob("*.h5"))
    for model in ("regression", "knn"):
        expected += [f"synthesis/{model}/{test}.{suffix}" for suffix in ("h5", "bvh", "glb", "mp4")]
        clip, truth = (Clip.read(speaker / f"synthesis/{m}/{test}.h5") for m in (model, "ground_truth"))
        assert clip.generator == model and clip.frames == truth.frames
        assert (speaker / f"synthesis/{model}" / clip.audio).is_file()
    assert [name for name in expected if not (speaker / name).is_file()] == []
    assert not (speaker / "models/knn").exists()
    for name in ("evaluation.h5", "summary.csv", "report.html"):
        assert (out / name).stat().st_size > 0


def test_second_run_has_nothing_to_do(snakemake, finished):
    done = snakemake(finished, *RUN)
    assert done.returncode == 0 and "Nothing to be done" in done.stdout, done.stdout


def test_a_killed_run_ends_in_the_same_bytes(snakemake, finished, tmp_path):
    folder = copy_project(tmp_path / "undisturbed")
    wanted = [path for path in (finished / "out").glob("tiny/synthesis/*/*.bvh")]
    wanted = [str(path.relative_to(finished)) for path in wanted]
    done = snakemake(folder, *RUN, *wanted)
    assert done.returncode == 0, done.stdout
    made = [path.relative_to(folder) for path in folder.glob("out/tiny/**/*") if path.is_file()]
    assert len(made) > 10
    digest = lambda path: hashlib.sha256(path.read_bytes()).hexdigest()
    assert [path for path in made if digest(folder / path) != digest(finished / path)] == []


def test_snakemakes_own_report_works(snakemake, finished):
    done = snakemake(finished, *RUN, "--report", "own.html")
    assert done.returncode == 0, done.stdout
    assert (finished / "own.html").stat().st_size > 100_000


def clips_project(folder, clip):
    """A project whose speaker is two clip files from elsewhere."""
    copy_project(folder)
    takes = [{"id": "a", "clip": "a.h5", "part": "train"}, {"id": "b", "clip": "b.h5", "part": "test"}]
    subject = {"name": "foreign", "source": {"kind": "clips", "takes": takes}}
    (folder / "subject.yaml").write_text(yaml.safe_dump(subject))
    for take in takes:
        clip.write(folder / take["clip"])
    return folder


def test_clips_from_elsewhere_are_a_source(snakemake, tmp_path):
    folder = clips_project(tmp_path / "project", make_clip(frames=100))
    done = snakemake(folder, *RUN, "split")
    assert done.returncode == 0, done.stdout
    clip = Clip.read(folder / "out/foreign/clips/a.h5")
    assert (clip.subject, clip.clip, clip.frames) == ("foreign", "a", 100)


def test_a_bad_file_is_one_line_in_terminal_and_log(snakemake, tmp_path):
    """It stops nobody else: the others' clips are made, and the table tells why it is none."""
    folder = clips_project(tmp_path / "project", make_clip(frames=100))
    with h5py.File(folder / "b.h5", "r+") as file:
        file["motion/positions"][7] = np.nan
    done = snakemake(folder, *RUN, "clips", "out/tables/takes.csv")
    assert done.returncode == 0 and "Traceback" not in done.stdout
    (line,) = [line for line in done.stdout.splitlines() if "refused: b.h5" in line]
    assert "NaN" in line and "frame 7" in line
    assert Path(folder / "out/logs/annotate/foreign-b.log").read_text() == f"{line}\n"
    rows = {row["take"]: row for row in csv.DictReader((folder / "out/tables/takes.csv").open(encoding="utf-8"))}
    assert "frame 7" in rows["b"]["refused"] and rows["b"]["valid [%]"] == "n/a"
    assert not rows["a"]["refused"] and rows["a"]["valid [%]"] == "100"
    shutil.copy(folder / "b.h5", folder / "a.h5")
    done = snakemake(folder, *RUN, "split")
    assert done.returncode != 0 and "Traceback" not in done.stdout
    (line,) = [line for line in done.stdout.splitlines() if "error: foreign: every take is refused" in line]
    assert "frame 7" in line
