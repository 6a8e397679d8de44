"""Where generated frames are from: `Match` -> `cospeech.clip.Trace`, which is kept in the clip."""

import numpy as np

from cospeech.clip import Trace
from cospeech.matching.control.controlled import ControlledMatch, clips_of
from cospeech.matching.database.descriptors import WINDOW

NUMBERS = ("clip", "frame", "pose_rank", "audio_rank", "pose_distance", "audio_distance")


def trace_of(match, **settings):
    """The Trace of a `Match`'s T frames; `settings` (k, seed...) are kept with it.

    Columns: `take` (texts), `time` (s in the take), `clip` and `frame` of the database, `pose_rank`, `audio_rank`,
    `pose_distance`, `audio_distance`, `candidates` (clips left by the controls, or gestures of a keyword), `control`
    and `widened` (texts: what the frame follows, and the step it took to find any). -1 where there is none.
    """
    window, offset = np.divmod(np.arange(match.frames), WINDOW)
    columns = {name: getattr(match, name)[window] for name in NUMBERS}
    columns["frame"] = np.where(columns["clip"] < 0, -1, columns["frame"] + offset)
    over = columns["frame"] >= match.database.clip_frames  # a keyword's gesture may go on in the next clip
    columns["clip"], columns["frame"] = columns["clip"] + over, columns["frame"] - over * match.database.clip_frames
    columns["time"] = match.time[window] + offset / match.database.fps
    texts = {"take": match.take, "control": [""] * len(match.clip), "widened": [""] * len(match.clip)}
    columns["candidates"] = np.full(match.frames, clips_of(match.database.eligible))
    if isinstance(match, ControlledMatch):
        columns["candidates"] = match.candidates[window]
        texts |= {"control": [", ".join(controls) for controls in match.controls], "widened": match.widened}
    labels = {name: list(dict.fromkeys(text for text in all_ if text)) for name, all_ in texts.items()}
    for name, all_ in texts.items():
        columns[name] = np.array([labels[name].index(text) if text else -1 for text in all_], np.int32)[window]
    return Trace(columns, labels, settings)
