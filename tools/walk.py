"""What one run of `cospeech generate` calls, from the command to the written file."""

import sys
import tempfile
import threading
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def walk(audio, subject, model, results):
    """Count the functions and files of src/cospeech that run, what imports run not counted; returns the exit status.

    Lambdas and comprehensions belong to the function that they stand in.
    """
    sys.path.insert(0, str(ROOT / "src"))
    from cospeech.cli import main

    called = set()
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "config.yaml"
        config.write_text(f"results_dir: {Path(results).resolve()}\n")
        options = ["--config", str(config), "--out", f"{folder}/talk.h5", "--subject", subject, "--model", model]
        profile = profiler(str(ROOT / "src" / "cospeech"), called)
        threading.setprofile(profile)
        sys.setprofile(profile)
        try:
            status = main(["generate", "--audio", str(audio), *options])
        finally:
            sys.setprofile(None)
            threading.setprofile(None)
    print(f"functions {len(called)}, files {len({file for file, _ in called})}")
    return status


def profiler(folder, called):
    """A function for sys.setprofile that puts (file, function) of what runs below `folder` into `called`."""
    importing = 0

    def profile(frame, event, _):
        nonlocal importing
        code = frame.f_code
        if code.co_name == "<module>":
            importing += (event == "call") - (event == "return")
        elif event == "call" and not importing and code.co_filename.startswith(folder) and code.co_name[0] != "<":
            called.add((code.co_filename, code.co_qualname))

    return profile
