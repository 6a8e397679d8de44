"""Motion capture through the workflow: what a file holds and not its name counts, and a bad take is refused alone."""

import csv

import numpy as np
import pytest
import yaml
from scipy.io import wavfile

from cospeech.clip import Clip
from tests.workflow.conftest import copy_project

RUN = ("--configfile", "config.yaml", "--cores", "1")
TAKES = {"a": "a.npz", "b": "b.bvh", "cut_off": "cut_off.npz", "words": "a.npz", "deaf": "a.npz"}


@pytest.fixture(scope="module")
def finished(snakemake, tmp_path_factory):
    """SMPL-X takes without a mapping; of one the file is cut off, of one the words are no words, of one the sound."""
    folder = copy_project(tmp_path_factory.mktemp("mocap") / "project")
    for number, name in enumerate(("a.npz", "b.npz", "cut_off.npz")):
        poses = np.zeros((300, 165))
        poses[:, 58] = 0.8 * np.sin(np.arange(300) / 30 * (number + 1))
        np.savez(folder / name, poses=poses, trans=np.zeros((300, 3)), mocap_frame_rate=30)
    (folder / "b.npz").rename(folder / "b.bvh")
    whole = (folder / "cut_off.npz").read_bytes()
    (folder / "cut_off.npz").write_bytes(whole[: len(whole) // 2])
    noise = np.random.default_rng(0).normal(scale=2000, size=160000).astype(np.int16)
    wavfile.write(folder / "take.wav", 16000, noise)
    (folder / "deaf.wav").write_bytes(b"RIFF")
    (folder / "bad.tsv").write_text("start\tend\tword\nsoon\tlater\thuge\n")
    takes = [{"id": take, "motion": motion, "audio": "take.wav", "part": "train"} for take, motion in TAKES.items()]
    takes[1]["part"], takes[3]["words"], takes[4]["audio"] = "test", "bad.tsv", "deaf.wav"
    subject = {"name": "ada", "source": {"kind": "mocap", "takes": takes}}
    (folder / "subject.yaml").write_text(yaml.safe_dump(subject))
    done = snakemake(folder, *RUN, "clips", "split", "out/tables/takes.csv")
    assert done.returncode == 0 and "Traceback" not in done.stdout, done.stdout
    return folder / "out"


def test_smplx_takes_become_clips_without_a_mapping(finished):
    for take in ("a", "b"):
        clip = Clip.read(finished / f"ada/clips/{take}.h5")
        assert clip.frames == 150 and clip.valid.all() and "refused" not in clip.extra
        assert (finished / f"ada/media/{take}.wav").is_file()
    wrists = clip.positions[:, 4] - clip.positions[:, 3]
    assert np.ptp(wrists[:, 2]) > 0.2  # the forearm swings


def test_bad_takes_are_refused_alone(finished):
    rows = {row["take"]: row for row in csv.DictReader((finished / "tables/takes.csv").open(encoding="utf-8"))}
    assert set(rows) == set(TAKES)
    assert all(not rows[take]["refused"] and rows[take]["valid [%]"] == "100" for take in ("a", "b"))
    for take, word in {"cut_off": "cut_off.npz", "words": "bad.tsv", "deaf": "deaf.wav"}.items():
        assert word in rows[take]["refused"], rows[take]
        clip = Clip.read(finished / f"ada/clips/{take}.h5")
        assert not clip.valid.any() and clip.frames == (15 if take == "deaf" else 150)
        assert f"note: ada/{take}: refused: " in (finished / f"logs/annotate/ada-{take}.log").read_text()
