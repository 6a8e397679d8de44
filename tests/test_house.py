"""The rules of the house that a machine can check: imports run downwards, and the library stands on its own."""

import ast
from pathlib import Path

import pytest

import cospeech
from tools.house import ORDER, STRANGERS

SOURCE = Path(cospeech.__file__).parent
MODULES = sorted(SOURCE.rglob("*.py"))


def room(path):
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def imported(path):
    """Rooms that a module imports, at its top or inside functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{a.name}" for a in node.names] if node.module == "cospeech" else [node.module]
        yield from (name.split(".")[1] for name in names if name.startswith("cospeech.") and "__" not in name)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_imports_run_downwards(path):
    own = room(path)
    if own == "__init__":
        assert not list(imported(path))
        return
    for other in imported(path):
        assert ORDER.index(other) <= ORDER.index(own), f"{own} imports {other}, which stands below it"
        assert {own, other} not in STRANGERS


@pytest.mark.parametrize(
    "path", [m for m in MODULES if room(m) not in ("commands", "cli")], ids=lambda path: str(path.relative_to(SOURCE))
)
def test_library_knows_nothing_of_the_workflow(path):
    assert "snakemake" not in path.read_text().lower()


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_nothing_that_a_user_brings_is_unpickled_or_evaluated(path):
    calls = [ast.unparse(node) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    for call in calls:
        name = call.split("(")[0]
        assert name not in ("eval", "exec", "pickle.load", "pickle.loads", "yaml.load", "os.system"), call
        assert not (name.endswith("torch.load") or name == "torch.load") or "weights_only=True" in call, call
        assert "allow_pickle=True" not in call and "shell=True" not in call, call
