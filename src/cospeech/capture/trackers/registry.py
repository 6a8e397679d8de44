"""Trackers under one protocol, put together by part: body from one, hands from another, into one track."""

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import numpy as np

from cospeech.capture.trackers.follow import frames_of_others
from cospeech.errors import CospeechError, notice
from cospeech.files import sha256
from cospeech.track import PARTS, Track

FACE = "face"  # coefficients of a face model, beside the parts that are points


class Tracker(Protocol):
    """What sees a person in a film.

    name, version : as they go into the track's attributes. parts : those of `track.PARTS` (and "face") that it sees.
    model_sha256, licence_note : of the model files that it runs; "" where there are none.
    """

    name: str
    version: str
    parts: tuple
    model_sha256: str
    licence_note: str

    def track(self, film, pictures: Iterable, seen: dict) -> dict:
        """{part: `Points` (or `FaceCoefficients` for "face")}, each with as many frames as there were pictures.

        `film` tells sizes, `pictures` yields its `Picture`s in order; `seen` holds what earlier trackers saw of the
        same film, by part: a hand tracker may look where the body's wrists are. Pixels are those of the full picture.
        """


def run_trackers(film, trackers, progress=iter):
    """Track a `Film` and return a `Track`.

    trackers: one Tracker, or {part: Tracker} in the order in which they shall run. `progress` wraps the pictures (a
    tqdm bar). Frames that show somebody else than the speaker (`follow.frames_of_others`) are not observed.
    """
    chosen = trackers if isinstance(trackers, dict) else dict.fromkeys(trackers.parts, trackers)
    seen, cuts = {}, np.zeros(0, np.int64)
    for tracker in dict.fromkeys(chosen.values()):
        wanted = [part for part, own in chosen.items() if own is tracker]
        if missing := [part for part in wanted if part not in tracker.parts]:
            raise CospeechError(f"tracker {tracker.name} does not see {missing[0]}; it sees {', '.join(tracker.parts)}")
        pictures = _Watched(progress(film.pictures()))
        found = tracker.track(film, pictures, dict(seen))
        seen |= {part: found[part] for part in wanted if part in found}
        cuts = np.array(pictures.cuts, np.int64) if pictures.count else cuts
    frames = min((len(part.score) for part in seen.values()), default=0)
    if not frames:
        raise CospeechError(f"{film.path}: the trackers saw none of {', '.join(chosen)}")
    others = frames_of_others(film, seen["body"], cuts) if "body" in seen else np.zeros(frames, bool)
    for part in seen.values():
        _blank(part, others, frames)
    _tell(film, seen)
    return _track(film, seen, frames, cuts[cuts < frames], tuple(dict.fromkeys(chosen.values())))


class _Watched:
    """The pictures, and at which of them shots began."""

    def __init__(self, pictures):
        self.pictures, self.cuts, self.count = pictures, [], 0

    def __iter__(self):
        for picture in self.pictures:
            self.count += 1
            if picture.cut:
                self.cuts.append(picture.index)
            yield picture


def _blank(part, others, frames):
    """Cut a part to `frames` frames, in place, and empty those in which it is not the speaker's or was not seen."""
    for name, array in vars(part).items():
        if isinstance(array, np.ndarray):
            setattr(part, name, array[:frames])
    seen = getattr(part, "observed", part.score > 0 if part.score.ndim == 1 else None) & ~others[:frames]
    for array in vars(part).values():
        if isinstance(array, np.ndarray):
            array[~seen] = 0


def _tell(film, seen):
    shares = {part: float(np.mean(getattr(points, "observed", points.score > 0))) for part, points in seen.items()}
    if not any(shares.values()):
        raise CospeechError(f"{film.path}: no person was found in any frame")
    if absent := [part for part, share in shares.items() if not share]:
        notice(f"{film.path}: never seen: {', '.join(absent)}")


def _track(film, seen, frames, cuts, trackers):
    join = lambda name: "; ".join(dict.fromkeys(v for t in trackers if (v := getattr(t, name))))
    return Track(
        float(film.fps),
        frames,
        film.width,
        film.height,
        **{part: seen.get(part) for part in (*PARTS, FACE)},
        source=Path(film.path).name,
        source_sha256=sha256(film.path),
        start=float(film.start),
        backend=join("name"),
        backend_version=join("version"),
        model_sha256=join("model_sha256"),
        licence_note=join("licence_note"),
        cuts=cuts,
    )
