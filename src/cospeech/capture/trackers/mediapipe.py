"""The tracker `mediapipe`: MediaPipe in an environment of its own, fed through a pipe (mediapipe_runner.py)."""

import subprocess
import sys
import tempfile
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import writing
from cospeech.track import Points

VERSION = "0.10.21"  # the last whose wheel carries its models; later ones fetch them, or send usage figures
COMPLETE = "complete.txt"  # in an environment: what was asked of pip
STRETCH = 1000  # frames read at once
SKELETONS = {
    "body": "blazepose33",
    "left_hand": "coco_wholebody_hand21",
    "right_hand": "coco_wholebody_hand21",
    "face_landmarks": "facemesh478",
}
SPACES = {
    "body": {"space": "root", "root": "centre", "metric": True},  # the middle of the hips
    "left_hand": {"space": "wrist", "root": "hand_root", "metric": True},
    "right_hand": {"space": "wrist", "root": "hand_root", "metric": True},
    "face_landmarks": {"space": "crop", "metric": False},  # pixels of the picture, z about the head's centre
}


class MediapipeTracker:
    """Body, hands and face landmarks by MediaPipe's legacy solutions.

    environment: the folder of a virtual environment that `build_environment` made. Hands are turned to be relative to
    their wrists (MediaPipe gives metres about the hand's own centre) and told apart by the body's wrists.
    """

    name, version, parts = "mediapipe", VERSION, tuple(SKELETONS)
    model_sha256 = ""  # the models lie in the wheel, which the version names
    licence_note = "MediaPipe and its models: Apache-2.0"

    def __init__(self, environment):
        self.python = Path(environment) / "bin" / "python"
        if not (Path(environment) / COMPLETE).is_file():
            raise CospeechError(
                f"{environment}: no environment with MediaPipe in it; docs/capture.md says how to make it"
            )

    def track(self, film, pictures, seen):
        """{part: Points} of a `Film`; see `registry.Tracker`."""
        width, height = film.size()
        script = as_file(files("cospeech.capture.trackers") / "mediapipe_runner.py")
        with tempfile.TemporaryDirectory() as folder, script as program:
            records, errors = Path(folder) / "records", Path(folder) / "errors"
            # -I: nothing beside the program, and nothing of this environment, is imported there
            command = [self.python, "-I", program, str(width), str(height), records]
            with open(errors, "wb") as log:
                process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log)
                try:
                    frames, whole = _feed(process.stdin, pictures)
                    status = process.wait()
                finally:
                    process.kill()
                    process.wait()
            if status or not whole:
                raise CospeechError(f"{film.path}: MediaPipe failed ({_last_line(errors)})")
            return _parts(records, frames, film.width / width)


def _feed(pipe, pictures):
    """Write pictures into the pipe; returns their number, and False if the other end went away."""
    count = 0
    try:
        with pipe:
            for picture in pictures:
                pipe.write(bytes([picture.cut]))
                pipe.write(picture.rgb.data)
                count += 1
    except BrokenPipeError:
        return count, False
    return count, True


def _last_line(path):
    lines = [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
    return lines[-1].strip()[:200] if lines else "without a word"


def _parts(records, frames, scale):
    """{part: Points} of the runner's rows; pixels become those of the full picture by `scale`.

    They are read a stretch at a time: an hour of film is a gigabyte, and two of it would be too much.
    """
    parts = {part: Points.empty(skeleton, frames, **SPACES[part]) for part, skeleton in SKELETONS.items()}
    width = sum(1 + 6 * points.score.shape[1] for points in parts.values())
    with open(records, "rb") as file:
        for start in range(0, frames, STRETCH):
            rows = np.fromfile(file, np.float32, min(STRETCH, frames - start) * width).reshape(-1, width)
            _fill(parts, slice(start, start + len(rows)), rows, scale)
    return parts


def _fill(parts, frames, rows, scale):
    column = 0
    for part, points in parts.items():
        count = points.score.shape[1]
        block = rows[:, column + 1 : column + 1 + 6 * count].reshape(len(rows), count, 6)
        xyz = block[..., 2:5] * (scale if part == "face_landmarks" else 1)
        points.observed[frames], points.score[frames] = rows[:, column] > 0, block[..., 5]
        points.xy[frames] = block[..., :2] * scale
        points.xyz[frames] = xyz - xyz[:, :1] if points.space == "wrist" else xyz
        column += 1 + 6 * count


def build_environment(folder, requirements):
    """Make a virtual environment in `folder` with what `requirements` pins; a whole one or none.

    One that was made from the same pins is left as it is, so that nothing needs the network twice.

    MediaPipe 0.10.21 has wheels for Python 3.9 to 3.12: the running interpreter's version, else one of these on the
    path, is used. Raises CospeechError with pip's last line when it cannot be installed.
    """
    folder, pins = Path(folder), Path(requirements).read_text(encoding="utf-8")
    if (folder / COMPLETE).is_file() and (folder / COMPLETE).read_text(encoding="utf-8") == pins:
        return
    python = _suitable_python()
    # an environment cannot be renamed afterwards (its scripts hold its path), so a file marks it as complete
    (folder / COMPLETE).unlink(missing_ok=True)
    for command in (
        [python, "-m", "venv", "--clear", folder],
        [folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--requirement", requirements],
    ):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        if done.returncode:
            line = (done.stdout.strip().splitlines() or ["without a word"])[-1]
            raise CospeechError(f"{folder}: the environment for MediaPipe cannot be made ({line[:200]})")
    with writing(folder / COMPLETE) as temporary:
        temporary.write_text(pins, encoding="utf-8")


def _suitable_python():
    import shutil

    if sys.version_info[:2] <= (3, 12):
        return sys.executable
    found = next((path for minor in (12, 11, 10) if (path := shutil.which(f"python3.{minor}"))), None)
    if found is None:
        raise CospeechError(
            "MediaPipe 0.10.21 needs Python 3.12 or older; install one, e.g. python3.12, beside this one"
        )
    return found
