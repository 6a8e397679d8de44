"""A run that was killed starts again by the plain command.

After SIGKILL or a power cut Snakemake refuses to start (a lock that nobody holds, jobs that were not finished) until it
is given --unlock and --rerun-incomplete. Here every file is whole or absent, so it may simply go on.
"""

import fcntl
import json
from base64 import urlsafe_b64decode
from contextlib import suppress
from pathlib import Path

_held = []  # an open file, whose lock lasts as long as this process, however it ends


def forgive_killed_run(workflow):
    """Drop what a dead run left in .snakemake/: its lock, and its unfinished jobs with their outputs.

    Every run shares a lock that the system takes back when the process dies; who gets it alone knows that none lives.
    """
    if not workflow.is_main_process or workflow.output_settings.dryrun:
        return
    folder = Path(".snakemake")
    folder.mkdir(exist_ok=True)
    alive = open(folder / "alive", "w")  # noqa: SIM115 - it stays open
    _held.append(alive)
    with suppress(BlockingIOError):
        fcntl.flock(alive, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for lock in (folder / "locks").glob("*"):
            lock.unlink()
        for marker in (folder / "incomplete").rglob("*"):
            if marker.is_file():
                _forget(marker, folder / "incomplete")
    fcntl.flock(alive, fcntl.LOCK_SH)


def _forget(marker, folder):
    """Remove one output of an unfinished job, and Snakemake's marker of it; its name is the output's path in base64."""
    with suppress(json.JSONDecodeError):
        if json.loads(marker.read_text()).get("external_jobid"):
            return  # a cluster's job: it may live, and Snakemake finds it again by itself
    encoded = "".join(part.removeprefix("@") for part in marker.relative_to(folder).parts)
    Path(urlsafe_b64decode(encoded).decode()).unlink(missing_ok=True)
    marker.unlink()
