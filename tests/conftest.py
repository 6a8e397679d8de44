"""Shared fixtures: the real recordings, and small synthetic clips."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def recordings():
    """Folder of real recordings, named by COSPEECH_RECORDINGS; tests that need it skip without."""
    folder = os.environ.get("COSPEECH_RECORDINGS")
    if not folder:
        pytest.skip("COSPEECH_RECORDINGS is not set: no real recordings to test with")
    return Path(folder)
