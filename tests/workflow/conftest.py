"""Running the workflow as a user does: the plain command, in a folder of one's own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "workflow"))


@pytest.fixture(scope="session")
def snakemake():
    """Run `snakemake` with these arguments in a folder; returns the finished process, output as text in `.stdout`."""

    def run(folder, *arguments, start=False):
        command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), *arguments]
        options = {"cwd": folder, "text": True, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        options |= {"env": os.environ | {"OMP_NUM_THREADS": "1"}}
        if start:
            return subprocess.Popen(command, start_new_session=True, **options | {"stdout": subprocess.DEVNULL})
        return subprocess.run(command, check=False, **options)

    return run


@pytest.fixture
def project(tmp_path):
    """A folder with the tiny configuration."""
    return copy_project(tmp_path / "project")


def copy_project(folder):
    return shutil.copytree(Path(__file__).parent / "tiny", folder)
