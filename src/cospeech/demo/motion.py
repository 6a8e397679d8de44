"""The virtual speaker's motion: gestures, posture, head and shoulders over a whole take, as joint positions."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from cospeech.demo.body import ARM, pose_body
from cospeech.demo.gesture import choose_gestures, rest_schedule
from cospeech.demo.lexicon import ANGLES, CHANNELS, POSITION, SHAPE
from cospeech.demo.phases import ArmTrack, lay_out

SIDES = ("right", "left")
NEGATIONS = frozenset(["no", "not", "never", "nothing", "nobody", "none", "neither", "cannot"])
NOD = 0.08  # s, standard deviation of a nod's course
LEAN, LEANING = 0.14, 0.8  # the same for a dip of the trunk, and the share of accents that have one
BEAT, BEAT_LIFT = 0.055, 0.13  # s: deviation of a small beat's course, and how much its lift is earlier
FLEX = ANGLES.start + 1
FINGERS_LATE = 0.03  # s by which the fingers follow the wrist
SMOOTHING = 0.02  # s, standard deviation: joins between movements are no corners
TREMOR = 0.004  # slow wandering of the wrist, arm lengths
FIDGET = 0.03  # the same of the hand shape
SHRUGS = {"shrug": 14.0, "huge": 6.0}  # degrees by which a gesture raises both shoulders


@dataclass
class Performance:
    """positions (N, 55, 3) metres, rotation (N, 3) of the head, and the gestures behind them."""

    positions: np.ndarray
    rotation: np.ndarray
    gestures: list


def perform(speech, prosody, parameters, frames, fps, rng):
    """Move the speaker's body to a Speech: Performance of `frames` frames at `fps`."""
    duration, stature = frames / fps, parameters["stature"]
    gestures = choose_gestures(speech, prosody, parameters, rng)
    rests = rest_schedule(speech, parameters, rng)
    arms = {}
    for side in SIDES:
        track = ArmTrack(side, parameters, ARM * stature, rests, rng)
        lay_out(gestures, side, track, duration)
        arms[side] = _channels(track, frames, fps, rng)
    _superimpose_beats(arms, prosody, style=parameters["gestures"], fps=fps, rng=rng)
    torso = _torso(arms, prosody, parameters, fps, rng)
    head = _head(speech, prosody, parameters, frames, fps, rng)
    positions, rotation = pose_body(arms, torso, head, _shrugs(gestures, frames, fps), stature)
    return Performance(positions, rotation, gestures)


def interpolate(times, values, via, at):
    """Minimum-jerk course through key poses: (K,), (K, C), (K,) bool, (N,) -> (N, C).

    The hand rests in each key (velocity and acceleration 0) except in `via` keys, which it passes at the velocity of
    the line between their neighbours, with acceleration 0: the quintic of those boundary values.
    """
    velocity = np.zeros_like(values)
    inner = np.flatnonzero(via)
    velocity[inner] = (values[inner + 1] - values[inner - 1]) / (times[inner + 1] - times[inner - 1])[:, None]
    k = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    span = (times[k + 1] - times[k])[:, None]
    s = np.clip((at - times[k])[:, None] / span, 0, 1)
    rise = s**3 * (10 - 15 * s + 6 * s**2)
    leave = s - s**3 * (6 - 8 * s + 3 * s**2)
    arrive = -(s**3) * (4 - 7 * s + 3 * s**2)
    return values[k] + rise * (values[k + 1] - values[k]) + span * (leave * velocity[k] + arrive * velocity[k + 1])


def _channels(track, frames, fps, rng):
    """(N, 15) one arm's channels: interpolated keys, fingers a little late, slow wandering, no corners."""
    times, values, via = track.keys()
    at = np.arange(frames) / fps
    channels = interpolate(times, values, via, at)
    channels[:, SHAPE] = interpolate(times, values, np.zeros_like(via), at - FINGERS_LATE)[:, SHAPE]
    channels[:, POSITION] += smooth_noise(frames, 3, 0.35, fps, rng) * TREMOR
    restless = FIDGET * smooth_noise(frames, CHANNELS - SHAPE.start, 0.5, fps, rng)
    channels[:, SHAPE] = np.clip(channels[:, SHAPE] + restless, 0, 1)
    return gaussian_filter1d(channels, SMOOTHING * fps, axis=0, mode="nearest")


def _superimpose_beats(arms, prosody, style, fps, rng):
    """Small beats of both hands on accents, on top of whatever the arms do: up before the vowel, down on it. A raised
    arm beats fully, a resting one little."""
    frames = len(prosody.loudness)
    chosen = _chosen(prosody, style["beating"], rng)
    lift = _pulses(prosody, chosen, frames, fps, BEAT, early=BEAT_LIFT)
    course = 0.8 * lift - _pulses(prosody, chosen, frames, fps, BEAT)
    for channels in arms.values():
        raised = np.clip((channels[:, 1] + 0.75) / 0.25, 0.15, 1.0)
        channels[:, 1] += style["beat"] * raised * course
        channels[:, FLEX] -= 120 * style["beat"] * raised * course


def smooth_noise(frames, channels, seconds, fps, rng):
    """(N, C) smooth noise of unit deviation and about the given correlation time."""
    step = max(int(seconds * fps / 4), 1)  # drawn coarsely, so that slow noise costs as little as fast
    coarse = gaussian_filter1d(rng.normal(size=(frames // step + 12, channels)), 4.0, axis=0, mode="wrap")
    coarse *= np.sqrt(2 * np.sqrt(np.pi) * 4.0)
    at = np.arange(frames) / step
    return np.stack([np.interp(at, np.arange(len(coarse)), column) for column in coarse.T], axis=1)


def _torso(arms, prosody, parameters, fps, rng):
    """(N, 3) degrees: slow sway, a lean into loud speech, and a turn after the hands."""
    style, frames = parameters["torso"], len(prosody.loudness)
    sway = smooth_noise(frames, 3, 2.2, fps, rng) * style["sway"] * [1.2, 0.8, 0.8]
    forward = arms["right"][:, 2] + arms["left"][:, 2] - 1.1
    aside = arms["left"][:, 0] * (arms["left"][:, 1] + 0.75) - arms["right"][:, 0] * (arms["right"][:, 1] + 0.75)
    leant = style["lean"] * _pulses(prosody, _chosen(prosody, LEANING, rng), frames, fps, LEAN)
    moved = np.stack([8 * aside, 2 * forward + leant, -2 * aside], axis=1)
    follow = gaussian_filter1d(moved * [style["follow"], 1.0, style["follow"] / 2], 0.15 * fps, axis=0, mode="nearest")
    return sway + follow + [0.0, 1.5, 0.0]


def _chosen(prosody, chance, rng):
    """(W,) bool: a share of the stressed words."""
    return prosody.stressed & (rng.random(len(prosody.accent)) < chance)


def _pulses(prosody, chosen, frames, fps, width, early=0.0):
    """(N,) a smooth pulse on each chosen word's accent (or `early` seconds before), as high as the accent (0.25..1)."""
    impulses = np.zeros(frames)
    at = np.clip(np.round((prosody.accent_time[chosen] - early) * fps).astype(int), 0, frames - 1)
    np.maximum.at(impulses, at, 0.25 + 0.75 * prosody.accent[chosen])
    return gaussian_filter1d(impulses, width * fps, mode="constant") * width * fps * np.sqrt(2 * np.pi)


def _head(speech, prosody, parameters, frames, fps, rng):
    """(N, 3) degrees against the chest: gaze turns between clauses, nods on accents, shakes on negations, wandering."""
    style = parameters["head"]
    course = _gaze(speech, style, frames, fps, rng)
    course[:, 1] += style["nod"] * _pulses(prosody, _chosen(prosody, style["nodding"], rng), frames, fps, NOD)
    at = np.arange(frames) / fps
    for word, text in enumerate(speech.words.text):
        if text.lower() in NEGATIONS and rng.random() < 0.6:
            since = at[(at > speech.words.start[word] - 0.1) & (at < speech.words.start[word] + 0.8)]
            s = (since - speech.words.start[word] + 0.1) / 0.9
            course[np.searchsorted(at, since), 0] += style["shake"] * np.sin(4 * np.pi * s) * np.sin(np.pi * s) ** 2
    course += smooth_noise(frames, 3, 0.8, fps, rng) * [1.0, 0.7, 0.7]
    return gaussian_filter1d(course, 0.05 * fps, axis=0, mode="nearest")


def _gaze(speech, style, frames, fps, rng):
    """(N, 3) degrees: where the speaker looks, changed at some beginnings of clauses, by minimum-jerk turns."""
    begins = speech.words.start[np.append(True, speech.words.start[1:] - speech.words.end[:-1] > 0.12)]
    begins = begins[rng.random(len(begins)) < 0.6]
    goals = rng.normal(0, 1, (len(begins), 3)) * [style["turn"], 2.5, style["tilt"]] * 0.6
    times, values = [0.0], [np.zeros(3)]
    for begin, goal in zip(begins, goals, strict=True):
        start = max(begin - 0.2, times[-1] + 0.05)
        arrive = start + 0.35 + 0.02 * abs(goal[0] - values[-1][0])
        times += [start, arrive]
        values += [values[-1], goal]
    times.append(times[-1] + 1.0)
    values.append(values[-1])
    return interpolate(np.array(times), np.array(values), np.zeros(len(times), bool), np.arange(frames) / fps)


def _shrugs(gestures, frames, fps):
    """(N, 2) degrees by which the right and the left shoulder are raised."""
    raised = np.zeros((frames, 2))
    for gesture in gestures:
        if gesture.form in SHRUGS:
            first, last = gesture.stroke * fps, max(gesture.retract, gesture.hold) * fps
            raised[int(first) : int(last)] = SHRUGS[gesture.form] * gesture.size
    return gaussian_filter1d(raised, 0.14 * fps, axis=0, mode="nearest")
