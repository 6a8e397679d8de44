"""The database's frames in a row: which of its clips follow each other in a take, and which frames can be copied."""

import numpy as np

from cospeech.matching.database.descriptors import LOOKAHEAD, WINDOW


def stretches(database):
    """For each clip, begin and end of the continuous stretch it lies in, counted in frames of the whole database.

    -> two (M,) int arrays. Frame f of clip m is number m F + f.
    """
    frames = database.clip_frames
    follows = (np.diff(database.take) == 0) & np.isclose(np.diff(database.start) * database.fps, frames, atol=0.5)
    cuts = np.concatenate([[0], np.flatnonzero(~follows) + 1, [len(database)]])
    which = np.repeat(np.arange(len(cuts) - 1), np.diff(cuts))
    return cuts[which] * frames, cuts[which + 1] * frames


def usable_frames(database):
    """(M F,) bool: the frames known to be valid, those whose features are real and what they look ahead to."""
    usable = np.zeros(database.real.size, bool)
    _, ends = stretches(database)
    starts = np.flatnonzero(database.real)
    last = ends[starts // database.clip_frames] - 1
    for shift in range(LOOKAHEAD + 1):
        usable[np.minimum(starts + shift, last)] = True
    return usable


def following(database, clip, frame, count):
    """What truly followed a window that starts at `frame` of `clip`: (count,) clips and (count,) frames.

    Where the database ends, its last frame is repeated.
    """
    _, ends = stretches(database)
    number = clip * database.clip_frames + frame + WINDOW + np.arange(count)
    return np.divmod(np.minimum(number, ends[clip] - 1), database.clip_frames)
