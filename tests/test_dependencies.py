"""What pyproject.toml asks for is used, and nothing else is imported."""

import ast
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
IMPORTED_AS = {
    "espeakng-loader": "espeakng_loader",
    "opencv-contrib-python-headless": "cv2",
    "pyyaml": "yaml",
    "scikit-learn": "sklearn",
    "yt-dlp": "yt_dlp",
}
# Dependencies that no file imports, and where their use is to be seen.
USED_OTHERWISE = {
    "onnxscript": ("src/cospeech/learning/weights.py", "torch.onnx.export"),  # which needs it
    "snakemake": ("Makefile", "snakemake --cores"),
    "ruff": ("Makefile", "ruff check"),
    "snakefmt": ("Makefile", "snakefmt --line-length"),
}


def names(requirements):
    return {re.match(r"[\w-]+", text)[0].lower() for text in requirements}


def imported(*folders):
    """Top-level modules that the Python files and rules of these folders import, or import if they are there."""
    found = set()
    for path in [path for folder in folders for path in (ROOT / folder).rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(node.module.split(".")[0])
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "pytest.importorskip":
                found.add(node.args[0].value)
    return found


def test_every_dependency_is_used():
    shipped, all_code = imported("src", "workflow"), imported("src", "workflow", "tests", "benchmarks", "tools")
    extras = PROJECT["optional-dependencies"]
    for requirements, modules in (
        (PROJECT["dependencies"], shipped),
        ([d for extra in extras.values() for d in extra], all_code),
    ):
        for name in names(requirements):
            if name in USED_OTHERWISE:
                file, words = USED_OTHERWISE[name]
                assert words in (ROOT / file).read_text(), f"{name} is not used in {file}"
            else:
                assert IMPORTED_AS.get(name, name) in modules, f"nothing imports {name}"


def test_nothing_else_is_imported():
    own = {path.stem for path in (ROOT / "workflow").rglob("*.py")} | {"__main__", "cospeech", "snakemake"}
    asked = names(PROJECT["dependencies"] + PROJECT["optional-dependencies"]["video"])
    asked |= names(PROJECT["optional-dependencies"]["recognition"]) | {"mediapipe"}  # which has its own environment
    known = {IMPORTED_AS.get(name, name) for name in asked} | own | set(sys.stdlib_module_names)
    assert imported("src", "workflow") <= known
