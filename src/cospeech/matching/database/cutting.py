"""How a matching database is made: takes are cut into clips, and their features computed, normalised and kept.

Features are computed on each whole take before it is cut, so that a clip's last frames look ahead into what truly
followed. Frames past a take's last whole clip serve that look-ahead only.
"""

from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from cospeech.body.physique import Build
from cospeech.clip import FEATURES, Words
from cospeech.errors import CospeechError, notice
from cospeech.matching.database.descriptors import (
    AUDIO_STEPS,
    LOOKAHEAD,
    POSE_STEPS,
    STATIC,
    WINDOW,
    joints_of,
    real_lookahead,
    with_lookahead,
)
from cospeech.skeleton import UPPER55


@dataclass
class Parts:
    """What a database is computed from; of S stretches with M clips of F frames in all.

    positions (M, F, 55, 3), rotation (M, F, 3) or None, real (M, F) bool : as in `Database`.
    speech (M, F, 14) f4 : the searched speech features as they came.
    joints_after (S, 14, 24), speech_after (S, 14, 14) f4 : the 14 frames after each stretch's last clip.
    clips (S,) i4 : each stretch's number of clips. bones (S, 55) f4, palms (S, 2, 5, 3) f4 : its `Build`.
    take (M,) i4 into `takes`, start (M,) seconds.
    words, word_take : what was said, and in which take.
    """

    positions: np.ndarray
    rotation: np.ndarray | None
    real: np.ndarray
    speech: np.ndarray
    joints_after: np.ndarray
    speech_after: np.ndarray
    clips: np.ndarray
    bones: np.ndarray
    palms: np.ndarray
    take: np.ndarray
    takes: list
    start: np.ndarray
    words: Words
    word_take: np.ndarray

    def features(self):
        """Per stretch with clips: number, raw pose (n, F, 96) and audio (n, F, 112) features, real frames (n, F)."""
        at = np.concatenate([[0], np.cumsum(self.clips)])
        for i, (begin, end) in enumerate(pairwise(at)):
            if begin == end:
                continue
            joints = joints_of(self.positions[begin:end].reshape(-1, *self.positions.shape[2:]))
            speech = self.speech[begin:end].reshape(-1, STATIC)
            pose = with_lookahead(np.concatenate([joints, self.joints_after[i]]), POSE_STEPS)[: len(joints)]
            audio = with_lookahead(np.concatenate([speech, self.speech_after[i]]), AUDIO_STEPS)[: len(speech)]
            shape = self.real[begin:end].shape
            yield i, pose.reshape(*shape, -1), audio.reshape(*shape, -1), self.real[begin:end]


def parts_of(take, positions, features, valid, rotation, start, words, clip_frames, fps):
    """The `Parts` of one stretch."""
    whole = len(positions) // clip_frames
    kept = whole * clip_frames
    cut = lambda array: array[:kept].reshape(whole, clip_frames, *array.shape[1:])
    build = Build.measure(positions[valid] if valid.any() else positions)
    after = np.minimum(np.arange(kept, kept + LOOKAHEAD), len(positions) - 1)
    return Parts(
        cut(positions).astype(np.float32),
        None if rotation is None else cut(rotation).astype(np.float32),
        cut(real_lookahead(valid)),
        cut(features[:, :STATIC]).astype(np.float32),
        joints_of(positions[after])[None].astype(np.float32),
        features[after, :STATIC][None].astype(np.float32),
        np.array([whole], np.int32),
        build.bone_lengths[None].astype(np.float32),
        build.palms[None].astype(np.float32),
        np.zeros(whole, np.int32),
        [take],
        start + np.arange(whole) * clip_frames / fps,
        Words(words.start + start, words.end + start, list(words.text)),
        np.zeros(len(words), np.int32),
    )


def joined_parts(parts):
    """A list of `Parts`, not empty, as one."""
    takes = list(dict.fromkeys(name for part in parts for name in part.takes))
    number = {name: i for i, name in enumerate(takes)}
    joined = {}
    for name in (f.name for f in fields(Parts)):
        all_ = [getattr(part, name) for part in parts]
        if name == "takes":
            joined[name] = takes
        elif name in ("take", "word_take"):
            renamed = [np.array([number[t] for t in p.takes], np.int32)[a] for p, a in zip(parts, all_, strict=True)]
            joined[name] = np.concatenate(renamed)
        elif name == "words":
            start, end = (np.concatenate([getattr(w, n) for w in all_]) for n in ("start", "end"))
            joined[name] = Words(start, end, [text for w in all_ for text in w.text])
        else:
            joined[name] = None if any(one is None for one in all_) else np.concatenate(all_)
    return Parts(**joined)


def check(take, positions, features, valid, rotation):
    """CospeechError, naming the take, unless the arrays of one stretch agree in length and are finite."""
    frames = len(positions)
    arrays = {"positions": (positions, (frames, len(UPPER55), 3)), "features": (features, (frames, FEATURES))}
    arrays["valid"] = (valid, (frames,))
    if rotation is not None:
        arrays["rotation"] = (rotation, (frames, 3))
    for name, (array, shape) in arrays.items():
        if np.shape(array) != shape:
            raise CospeechError(f"database: take {take!r}: {name} has shape {np.shape(array)}, expected {shape}")
        if not np.isfinite(array).all():
            frame = int(np.argwhere(~np.isfinite(array))[0][0])
            raise CospeechError(f"database: take {take!r}: {name} holds NaN or infinity, first in frame {frame}")


def check_lengths(takes, lengths, clip_frames):
    """CospeechError unless a stretch is long enough for a clip; a notice of those that are not."""
    if clip_frames < WINDOW:
        raise CospeechError(f"database: clips of {clip_frames} frames cannot hold a window of {WINDOW}")
    short = [take for take, frames in zip(takes, lengths, strict=True) if frames < clip_frames]
    if len(short) == len(takes):
        longest = max(lengths, default=0)
        raise CospeechError(
            f"database: no training clip long enough: the longest has {longest} frames, one needs {clip_frames}"
        )
    if short:
        notice(f"database: left out, shorter than one clip of {clip_frames} frames: {', '.join(sorted(set(short)))}")
