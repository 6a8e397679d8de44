"""The virtual speaker's face: coefficients of cospeech64 that follow phonemes, loudness, accents and gaze.

Coarticulation after Cohen & Massaro (1993): each phoneme pulls the mouth towards its viseme with a dominance that rises
before it and falls after it; the mouth is where the weighted mean of all pulls lies.
"""

from functools import cache
from importlib.resources import files

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import csr_array

from cospeech.demo.motion import smooth_noise
from cospeech.face.expressions import COSPEECH64
from cospeech.files import read_yaml

ANTICIPATION = 0.03  # s by which the mouth leads the sound
SPREAD = 0.045  # s of dominance outside the phoneme, standard deviation
REACH = 0.20  # s beyond which a phoneme pulls no more
BLINK = (0.07, 0.16)  # s, closing and opening
BROWS = 0.22  # s, standard deviation of a raise


def animate_face(speech, prosody, rotation, parameters, fps, rng):
    """(N, 64) expression coefficients, 0..1, for a Speech, its Prosody and the head's rotation (N, 3)."""
    frames, style = len(prosody.loudness), parameters["face"]
    weights = _mouth(speech.phonemes, prosody, frames, fps) * style["mouth"]
    add = lambda value, *names: np.add.at(weights.T, [COSPEECH64.index(n) for n in names], value)
    smile = np.clip(style["smile"] * (1 + 0.7 * smooth_noise(frames, 1, 3.0, fps, rng)[:, 0]), 0, 0.5)
    add(smile, "mouth_smile_left", "mouth_smile_right")
    add(0.6 * smile, "cheek_squint_left", "cheek_squint_right", "lid_lower_up_left", "lid_lower_up_right")
    raised = _raises(speech, prosody, style["brows"], frames, fps, rng)
    add(raised, "brow_inner_up", "brow_outer_up_left", "brow_outer_up_right")
    add(0.4 * raised, "eye_wide_left", "eye_wide_right")
    furrow = np.clip(0.12 * smooth_noise(frames, 1, 2.0, fps, rng)[:, 0], 0, 1)
    add(furrow, "brow_furrow", "brow_down_left", "brow_down_right")
    blink = _blinks(speech, style["blink"], frames, fps, rng)
    add(blink, "eye_blink_left", "eye_blink_right")
    _gaze(add, rotation, frames, fps, rng)
    return np.clip(weights, 0, 1)


@cache
def _visemes():
    """{phoneme: (strength, (64,) target of its first half, (64,) target of its second half)}; "" is a pause."""
    table = read_yaml(files("cospeech.demo") / "visemes.yaml")
    targets = {name: _target(entry) for name, entry in table["visemes"].items()}
    home = {phoneme: name for name, phonemes in table["phonemes"].items() for phoneme in phonemes}
    glides = table["glides"]
    strength = {name: entry["strength"] for name, entry in table["visemes"].items()}
    entries = {p: (strength[name], targets[name], targets[glides.get(p, name)]) for p, name in home.items()}
    return entries | {"": (strength["rest"], targets["rest"], targets["rest"])}


def _target(entry):
    target = np.zeros(len(COSPEECH64))
    for name, value in entry.items():
        sides = [name] if name in COSPEECH64 else [f"{name}_left", f"{name}_right"]
        if name != "strength":
            target[[COSPEECH64.index(n) for n in sides]] = value
    return target


def _viseme(phoneme):
    """The table's entry for the longest beginning of a phoneme that it knows; else the neutral vowel's."""
    table = _visemes()
    for length in range(len(phoneme), 0, -1):
        if phoneme[:length] in table:
            return table[phoneme[:length]]
    return table["ə" if phoneme else ""]


def _mouth(phonemes, prosody, frames, fps):
    """(N, 64) the phonemes' visemes blended by dominance; jaw and lips open further in loud speech."""
    entries = [_viseme(p) for p in phonemes.ipa]
    half = (phonemes.start + phonemes.end) / 2
    start = np.concatenate([phonemes.start, half]) - ANTICIPATION
    end = np.concatenate([half, phonemes.end]) - ANTICIPATION
    strength = np.array([e[0] for e in entries] * 2)
    targets = np.array([e[1] for e in entries] + [e[2] for e in entries])
    width = int(np.ceil((2 * REACH + (end - start).max(initial=0)) * fps)) + 1
    frame = np.floor((start - REACH) * fps).astype(int)[:, None] + np.arange(width)
    at = frame / fps
    away = np.maximum(np.maximum(start[:, None] - at, at - end[:, None]), 0)
    dominance = strength[:, None] * np.exp(-0.5 * (away / SPREAD) ** 2) * (away < REACH)
    inside = (frame >= 0) & (frame < frames)
    owner = np.broadcast_to(np.arange(len(start))[:, None], frame.shape)
    pull = csr_array((dominance[inside], (frame[inside], owner[inside])), shape=(frames, len(start)))
    mouth = (pull @ targets) / (pull.sum(axis=1) + 0.05)[:, None]  # 0.05: in silence the mouth falls back to rest
    level = np.clip((gaussian_filter1d(prosody.loudness, 0.06 * fps) + 45) / 30, 0, 1.2)
    opening = [i for i, n in enumerate(COSPEECH64) if n.startswith(("jaw_open", "mouth_lower_down", "mouth_upper_up"))]
    mouth[:, opening] *= (0.35 + 0.65 * level)[:, None]
    return gaussian_filter1d(mouth, 0.012 * fps, axis=0, mode="nearest")


def _raises(speech, prosody, share, frames, fps, rng):
    """(N,) brows raised on a share of the accents, the more the stronger the accent."""
    chosen = prosody.stressed & (rng.random(len(prosody.accent)) < share * prosody.accent)
    peaks = np.zeros(frames)
    at = np.clip(np.round(prosody.accent_time[chosen] * fps).astype(int), 0, frames - 1)
    np.maximum.at(peaks, at, 0.25 + 0.45 * prosody.accent[chosen])
    width = BROWS / 2 * fps
    return np.clip(gaussian_filter1d(peaks, width) * width * np.sqrt(2 * np.pi), 0, 0.9)


def _blinks(speech, interval, frames, fps, rng):
    """(N,) eyelids: a gamma renewal process, and half of the sentences' ends."""
    duration = frames / fps
    waits = rng.gamma(3.0, interval / 3.0, int(2 * duration / interval) + 20)
    ends = speech.words.end[np.append(np.diff(speech.sentence) > 0, True)]
    times = np.sort(np.concatenate([np.cumsum(waits), ends[rng.random(len(ends)) < 0.5]]))
    times = times[np.diff(times, prepend=-1) > 0.4]
    since = np.arange(frames)[:, None] / fps
    last = np.clip(np.searchsorted(times, since[:, 0] + BLINK[0]) - 1, 0, None)
    away = since[:, 0] - times[last]  # blinks are fully closed at their time
    return np.where(away < 0, np.clip(1 + away / BLINK[0], 0, 1), np.clip(1 - away / BLINK[1], 0, 1)) ** 1.5


def _gaze(add, rotation, frames, fps, rng):
    """Eyes: they run ahead of the head's turns, and wander in small jumps."""
    hold = rng.normal(0, 0.05, (int(frames / fps / 0.7) + 2, 2))[(np.arange(frames) / fps / 0.7).astype(int)]
    rolled = np.roll(rotation, -int(0.12 * fps), axis=0)
    aside = gaussian_filter1d(2.0 * (rolled - rotation)[:, 1] + hold[:, 0], 0.02 * fps, mode="nearest")
    down = gaussian_filter1d(1.0 * (rolled - rotation)[:, 0] + hold[:, 1], 0.02 * fps, mode="nearest")
    add(np.clip(aside, 0, 1), "eye_look_out_left", "eye_look_in_right")
    add(np.clip(-aside, 0, 1), "eye_look_in_left", "eye_look_out_right")
    add(np.clip(down, 0, 1), "eye_look_down_left", "eye_look_down_right")
    add(np.clip(-down, 0, 1), "eye_look_up_left", "eye_look_up_right")
