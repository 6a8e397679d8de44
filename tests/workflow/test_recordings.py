"""Real motion capture through the whole chain, with a tiny budget, and the command line on what came out."""

import subprocess
import sys
from pathlib import Path

import av
import pytest

from cospeech.clip import Clip
from cospeech.formats.bvh import read_bvh
from tests.workflow.conftest import copy_project

MODELS = ["regression", "gesture_gan", "knn", "resync"]
RUN = ("--configfile", "config.yaml", "--cores", "1")
SPEECH_SECONDS = 11.0  # of the recording that is given to `cospeech generate`


@pytest.fixture(scope="module")
def trained(snakemake, recordings, tmp_path_factory):
    folder = copy_project(tmp_path_factory.mktemp("zeggs") / "project")
    template = Path(__file__).with_name("zeggs.yaml").read_text()
    (folder / "subject.yaml").write_text(template.replace("{recordings}", str(recordings.resolve())))
    config = (folder / "config.yaml").read_text().replace("[regression, knn]", f"[{', '.join(MODELS)}]")
    (folder / "config.yaml").write_text(config)
    done = snakemake(folder, *RUN)
    assert done.returncode == 0, done.stdout
    return folder


def test_real_recordings_end_in_models_bvh_and_report(trained):
    speaker = trained / "out/zeggs"
    train, test = (Clip.read(speaker / f"clips/speech067_{part}.h5") for part in ("train", "test"))
    assert train.frames == 750 and test.frames == round((68.833 - 50) * 15)
    for model in MODELS:
        animation = read_bvh(speaker / f"synthesis/{model}/speech067_test.bvh")
        assert len(animation) == test.frames and animation.fps == pytest.approx(15, rel=1e-4)
    assert (trained / "out/report.html").stat().st_size > 0


@pytest.mark.parametrize("suffix", ["bvh", "mp4"])
def test_generate_for_any_speech_file(trained, recordings, suffix):
    out = trained / f"talk.{suffix}"
    command = [sys.executable, "-m", "cospeech.cli", "generate", "--subject", "zeggs", "--model", "resync"]
    command += ["--audio", str(recordings / "speech/jfk/jfk.flac"), "--out", str(out), "--config", "config.yaml"]
    subprocess.run(command, cwd=trained, check=True)
    if suffix == "bvh":
        assert len(read_bvh(out)) == round(SPEECH_SECONDS * 15)
    else:
        with av.open(str(out)) as film:
            lengths = [float(stream.duration * stream.time_base) for stream in film.streams]
        assert lengths == pytest.approx([SPEECH_SECONDS] * 2, abs=1 / 24)
