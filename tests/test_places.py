"""Places that cannot be written, pipes that close, a HOME and a cache that are not there: one line, or it works."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cospeech
from cospeech.cli import main
from cospeech.files import writing
from tests.capture.person import make_track
from tests.conftest import make_clip

SOURCE = Path(cospeech.__file__).parents[1]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("places")
    make_clip(frames=30).write(folder / "clip.h5")
    make_track(1.0).write(folder / "track.h5")
    (folder / "file").write_text("no folder")
    return folder


def python(*arguments, cwd=None, **environment):
    """A process that sees this library, without what pytest and the shell have set for it."""
    kept = {key: os.environ[key] for key in ("PATH", "LD_LIBRARY_PATH", "OMP_NUM_THREADS") if key in os.environ}
    env = kept | {"PYTHONPATH": str(SOURCE)} | environment
    return subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=cwd, env=env, text=True, capture_output=True, check=False
    )


COMMANDS = {
    "export": (["export", "clip.h5"], [".bvh", ".glb", ".csv", ".h5"]),
    "render": (["render", "clip.h5"], [".mp4"]),
    "still": (["render", "--still", "1.0", "clip.h5"], [".png"]),
    "annotate": (["annotate", "track.h5", "--out"], [".h5"]),
}
PLACES = {
    "below a file": lambda folder, suffix: folder / "file" / f"out{suffix}",
    "252 letters": lambda folder, suffix: folder / ("a" * (252 - len(suffix)) + suffix),
    "300 letters": lambda folder, suffix: folder / ("a" * 300 + suffix),
    "read-only": lambda folder, suffix: Path("/proc/nowhere") / f"out{suffix}",
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_place_that_cannot_be_written_is_one_line(files, command, place, capsys, monkeypatch):
    monkeypatch.chdir(files)
    asked, suffixes = COMMANDS[command]
    for suffix in suffixes:
        out = PLACES[place](files, suffix)
        assert main([*asked, str(out)]) == 2
        lines = [line for line in capsys.readouterr().err.splitlines() if "note:" not in line]
        assert len(lines) == 1 and lines[0].startswith(f"cospeech: error: {out}: cannot be written (")
    assert sorted(path.name for path in files.iterdir()) == ["clip.h5", "file", "track.h5"]


def test_what_was_there_stays_when_writing_fails(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(ZeroDivisionError), writing(tmp_path / "a.txt") as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_a_reader_that_goes_away_is_no_error(files):
    """`cospeech info x | head -1`, a hundred times what a pipe holds."""
    command = "from cospeech.commands import describe; describe.describe = lambda _: 'x\\n' * 1_000_000\n"
    command += "import sys; from cospeech.cli import main; sys.exit(main(['info', 'clip.h5']))"
    reader = subprocess.Popen(
        [sys.executable, "-c", command],
        cwd=files,
        env=os.environ | {"PYTHONPATH": str(SOURCE)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert reader.stdout.readline() == b"x\n"
    reader.stdout.close()
    assert (reader.stderr.read(), reader.wait()) == (b"", 0)


def test_without_a_cache_for_numba_a_film_is_rendered(files, tmp_path):
    """An installation whose folders cannot be written, and no HOME: what is compiled is kept for the process alone."""
    shutil.copytree(SOURCE / "cospeech", tmp_path / "site" / "cospeech", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (tmp_path / "site").rglob("*"):
        if folder.is_dir():
            (folder / "__pycache__").write_text("a file where the folder would be")
    environment = {"PYTHONPATH": str(tmp_path / "site"), "HOME": "/proc/nobody", "PYTHONDONTWRITEBYTECODE": "1"}
    done = python(
        "-m", "cospeech.cli", "render", "--still", "1.0", files / "clip.h5", tmp_path / "a.png", **environment
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_onnxruntime_is_told_before_it_is_imported():
    found = python("-c", "import cospeech, os; print(os.environ['ORT_DISABLE_TELEMETRY'])", ORT_DISABLE_TELEMETRY="0")
    assert found.stdout == "1\n"
    project = Path(__file__).parents[1]
    for folder in ("src", "workflow", "benchmarks", "tests", "tools"):
        for path in (project / folder).rglob("*.py"):
            lines = path.read_text(encoding="utf-8").splitlines() if "node_modules" not in path.parts else []
            ours = [i for i, line in enumerate(lines) if line.strip().startswith(("import cospeech", "from cospeech"))]
            theirs = [
                i for i, line in enumerate(lines) if line.strip().startswith(("import onnxruntime", "from onnxr"))
            ]
            assert not theirs or path.is_relative_to(project / "src") or (ours and ours[0] < theirs[0]), path


@pytest.mark.skipif(not shutil.which("strace"), reason="strace is not installed")
def test_a_network_at_work_connects_to_nothing_and_writes_nothing_home(tmp_path):
    onnx = pytest.importorskip("onnx")
    node = onnx.helper.make_node("Add", ["a", "a"], ["b"])
    values = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1]) for name in "ab"]
    graph = onnx.helper.make_graph([node], "twice", values[:1], values[1:])
    onnx.save(
        onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8),
        tmp_path / "m.onnx",
    )
    (tmp_path / "home").mkdir()
    program = "import time; from cospeech.learning.weights import OnnxNetwork\n"
    program += f"print(OnnxNetwork({str(tmp_path / 'm.onnx')!r}, 1)(a=[2.0])[0]); time.sleep(2)"
    traced = [shutil.which("strace"), "-f", "-qq", "-e", "trace=connect,sendto", "-o", str(tmp_path / "trace")]
    env = os.environ | {"PYTHONPATH": str(SOURCE), "HOME": str(tmp_path / "home")}
    done = subprocess.run(
        [*traced, sys.executable, "-c", program], env=env, capture_output=True, text=True, check=False
    )
    if "Operation not permitted" in done.stderr:
        pytest.skip("strace may not trace here")
    assert done.stdout == "[4.]\n", done.stderr
    calls = (tmp_path / "trace").read_text().splitlines()
    assert [line for line in calls if "AF_INET" in line or "sendto" in line] == []
    assert list((tmp_path / "home").rglob("*")) == []
