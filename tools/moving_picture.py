"""The README's moving picture: the virtual speaker's own motion and what the search makes of the same speech.

    python tools/moving_picture.py docs/images/speaking.webp

Ten takes of one minute are the database; the speech is that of an eleventh. The search, as `knn` does it by default,
makes body, hands and head; both wear the recorded face. Everything is this project's own: nobody's likeness is shown.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2

from cospeech.demo import read_take, write_take
from cospeech.errors import CospeechError
from cospeech.files import writing
from cospeech.gestures.generator import Speech
from cospeech.matching import KNN, Database
from cospeech.matching.knn import DEFAULTS
from cospeech.matching.search.similarity import train_similarity
from cospeech.render.video import render_video
from cospeech.synthesis import synthesize

SPEAKER, TAKES, SECONDS, FPS = "lively", 10, 60, 15
MOST_BYTES = 1_500_000


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="the picture to write, .webp")
    parser.add_argument("--start", type=float, default=7.0, help="second of the take at which it begins")
    parser.add_argument("--seconds", type=float, default=6.0, help="how long it lasts before it begins anew")
    parser.add_argument("--size", type=int, nargs=2, default=(720, 360), help="width and height in pixels")
    parser.add_argument("--quality", type=int, default=75, help="of WebP, 0 to 100")
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        recorded, generated = clips(Path(folder))
        first, last = round(arguments.start * FPS), round((arguments.start + arguments.seconds) * FPS)
        panels = [
            ("recorded", recorded.section(first, last)),
            ("generated from the sound", generated.section(first, last)),
        ]
        film = Path(folder) / "film.mp4"
        render_video(film, panels, size=tuple(arguments.size), fps=FPS)
        write_animation(arguments.out, pictures(film), FPS, arguments.quality)
    print(f"{arguments.out}: {arguments.out.stat().st_size / 1e6:.2f} MB")


def clips(folder, takes=TAKES, settings=None):
    """(recorded Clip, Clip generated for the same speech) of the take after those that the search may copy."""
    *known, recorded = [take(folder, number) for number in range(takes + 1)]
    database = Database.from_clips(known)
    knn = KNN(train_similarity(database, settings)[0].applied(database), **DEFAULTS)
    speech = Speech.load(folder / f"{recorded.clip}.wav", FPS, recorded.words)
    generated = synthesize(knn, speech, subject=SPEAKER, clip=recorded.clip, model="knn")
    return recorded, replace(generated, expression=recorded.expression, face_model=recorded.face_model)


def take(folder, number):
    name = f"take{number:02}"
    wav, truth = folder / f"{name}.wav", folder / f"{name}.h5"
    write_take(SPEAKER, number, seconds=SECONDS, seed=0, wav=wav, truth=truth)
    return read_take(truth, wav, fps=FPS, subject=SPEAKER, clip=name)


def pictures(film):
    """All frames of a film, (H, W, 3) uint8 BGR."""
    with av.open(str(film)) as container:
        return [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]


def write_animation(path, frames, fps, quality):
    """Write an endless animation; CospeechError if it is larger than a README should make anybody load."""
    animation = cv2.Animation()
    animation.frames, animation.durations = frames, [round(1000 / fps)] * len(frames)
    written, buffer = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not written or len(buffer) > MOST_BYTES:
        raise CospeechError(
            f"{path}: {len(buffer)} bytes, {MOST_BYTES} at most; ask for fewer --seconds or less --quality"
        )
    with writing(path) as temporary:
        temporary.write_bytes(bytes(buffer))


if __name__ == "__main__":
    try:
        main()
    except CospeechError as error:
        print(f"moving_picture: error: {error}", file=sys.stderr)
        sys.exit(2)
