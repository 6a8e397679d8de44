"""`cospeech generate` with the networks of many speakers: which network is meant, and one line for each mistake."""

import numpy as np
import pytest

from cospeech.cli import main
from cospeech.learning.weights import save_weights


@pytest.fixture
def ensemble(tmp_path, monkeypatch):
    """A folder of results in which two networks have been trained for everyone."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.yaml").write_text("results_dir: out\n")
    for name in ("ha2g_0", "ha2g_1", "no_text_0"):
        (tmp_path / "out/everyone/models" / name).mkdir(parents=True)
        (tmp_path / "out/everyone/models" / name / "model.onnx").write_bytes(b"no network")
    (tmp_path / "out/everyone/corpus.h5").touch()
    (tmp_path / "talk.wav").touch()


def generate(capsys, *arguments):
    """Exit status and what stood on the standard error."""
    given = ("--config", "c.yaml", "--subject", "everyone", "--audio", "talk.wav", "--out", "a.bvh")
    status = main(["generate", *given, *arguments])
    return status, capsys.readouterr().err.strip()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--model", "trimodal"], "not trained for everyone; trained there: ha2g_0, ha2g_1, no_text_0"),
        (["--model", "ha2g"], "out/everyone/models/ha2g_0/model.onnx: not a readable ONNX network"),
        (["--model", "ha2g_1"], "out/everyone/models/ha2g_1/model.onnx: not a readable ONNX network"),
        (["--model", "no_text"], "out/everyone/models/no_text_0/model.onnx: not a readable ONNX network"),
        (["--model", "ha2g", "--k", "3"], "--k is about matches, which ha2g has none of"),
        (["--model", "ha2g", "--control", "reach=low"], "--control is about matches"),
    ],
)
def test_the_network_that_is_meant_and_what_it_cannot_do(ensemble, capsys, arguments, line):
    status, error = generate(capsys, *arguments)
    assert status == 2 and line in error and "\n" not in error


def test_single_speakers_have_no_style_to_mix(ensemble, capsys):
    status, error = generate(capsys, "--model", "knn", "--style", "calm", "--subject", "calm")
    assert status == 2 and error.endswith("--style mixes the speakers of an ensemble, and 'calm' is none")


def test_info_tells_long_lists_by_their_length(tmp_path, capsys):
    save_weights(tmp_path / "w.safetensors", {"a": np.zeros(3)}, {"mean": [0.0] * 126, "figures": {"calm": [1, 2]}})
    assert main(["info", str(tmp_path / "w.safetensors")]) in (0, None)
    told = capsys.readouterr().out
    assert '"mean": "126 values"' in told and len(told.splitlines()) < 15
