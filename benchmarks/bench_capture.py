"""Capture's hot paths beside the obvious alternatives, as ratios in one run.

    python benchmarks/bench_capture.py film.mp4 [environment of MediaPipe]
    python benchmarks/bench_capture.py --memory film.mp4

The first decodes the film as trackers see it against a plain loop with OpenCV, and, given the environment, tracks it
against MediaPipe alone on pictures that are decoded already. The second reads the film over and over and prints how the
memory grows.
"""

import resource
import subprocess
import sys
import tempfile
from importlib.resources import as_file, files
from pathlib import Path

import cv2
from timing import fastest, timed

from cospeech.capture.film.decoding import open_film
from cospeech.capture.trackers.mediapipe import MediapipeTracker
from cospeech.capture.trackers.registry import run_trackers


def plain_loop(path, size):
    """Decode with OpenCV, shrink, and turn to RGB, one picture after the other."""
    capture = cv2.VideoCapture(str(path))
    while (read := capture.read())[0]:
        cv2.cvtColor(cv2.resize(read[1], size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2RGB)


def mediapipe_alone(film, environment):
    """Seconds of the same program, its start included, on pictures that are decoded already and lie in a file."""
    width, height = (str(side) for side in film.size())
    with (
        tempfile.TemporaryDirectory() as folder,
        as_file(files("cospeech.capture.trackers") / "mediapipe_runner.py") as program,
    ):
        raw = Path(folder) / "pictures"
        with open(raw, "wb") as file:
            for picture in film.pictures():
                file.write(b"\0" + picture.rgb.tobytes())
        command = [Path(environment) / "bin/python", "-I", program, width, height, Path(folder) / "records"]
        with open(raw, "rb") as file:
            return timed(lambda: subprocess.run(command, stdin=file, stderr=subprocess.DEVNULL, check=True))[0]


def speed(path, environment=None):
    film = open_film(path)
    for _ in film.pictures():
        break
    ours = fastest(lambda: sum(1 for _ in film.pictures()), 3)
    plain = fastest(lambda: plain_loop(path, film.size()), 3)
    print(f"decoding: {film.frames / ours:.0f} frames/s; OpenCV in a loop takes {plain / ours:.2f} times as long")
    if environment:
        alone = min(mediapipe_alone(film, environment) for _ in range(2))
        whole = fastest(lambda: run_trackers(film, MediapipeTracker(environment)), 2)
        print(f"mediapipe: {film.frames / whole:.1f} frames/s, {whole / alone:.2f} times MediaPipe alone")


def memory(path, times=20):
    for turn in range(times):
        count = sum(1 for _ in open_film(path).pictures())
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if turn in (0, times - 1):
            print(f"after {(turn + 1) * count} pictures: {peak:.0f} MB at most")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--memory"]:
        memory(sys.argv[2])
    else:
        speed(*sys.argv[1:])
