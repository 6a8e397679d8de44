"""Recordings of a person talking in, a model of how that person gestures out."""

import os
import tempfile

__version__ = "0.2.0"

# Before anybody imports it: onnxruntime looks up a telemetry host and writes a device id under HOME otherwise.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"


def _writable(folder):
    """Whether a file can be written into a folder, which is made if need be: what numba tries itself."""
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _numba_cache():
    """A folder of this process alone for what numba compiles, where it could be kept neither beside our code nor in the
    user's cache: numba itself gives up then."""
    import atexit
    import shutil

    os.environ["NUMBA_CACHE_DIR"] = folder = tempfile.mkdtemp(prefix="cospeech-numba-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)


_PLACES = (
    os.path.join(os.path.dirname(os.path.abspath(__file__)), "matching", "search", "__pycache__"),
    os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache"), "numba"),
)
if "NUMBA_CACHE_DIR" not in os.environ and not any(map(_writable, _PLACES)):
    _numba_cache()
