"""Clean-up: what a tracker saw becomes motion on the clip's clock, in the character's axes (thesis 4.3, IVA 2021 3.1).

Every step can be switched off in `Cleanup`, and reports what it did. The order: outlier gates and gaps at the video's
rate, within each shot; then the clip's rate, upright, facing forward; then one set of bone lengths and smoothing.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from cospeech.body.anatomy import REST_FOREARM, rest_hand
from cospeech.capture.cleanup.assemble import HANDS, PARTS
from cospeech.capture.cleanup.fill import EXCLUDED
from cospeech.capture.cleanup.gates import agreement_gate, bone_gate, joined_gate, robust_bones, speed_gate
from cospeech.capture.cleanup.stretch import SIDES, Face, clean_stretch
from cospeech.capture.cleanup.wrists import wrists_at_hands
from cospeech.errors import CospeechError
from cospeech.skeleton import BODY, UPPER55

RATE = 15.0  # Hz: the published annotation's, in which the published limits count frames


@dataclass(frozen=True)
class Cleanup:
    """Settings of the clean-up. 0 (or False) switches a step off. (P) published, (O) our own choice.

    Attributes
    ----------
    bone_tolerance : share by which a bone may differ from the speaker's length before its joint is dropped (O).
    speed_limit : m/s beyond which a jump there and back is an outlier (O).
    agreement : distance between a joint in 3D, projected, and in 2D, in sizes of its part (O).
    joined : distance between the roots of hand and arm in the picture, in shoulder widths (O).
    wrists : wrists lie, in the picture, where the roots of their hands were seen (O).
    fill_frames : believed frames at most this many frames of 15 Hz apart are joined by a cubic (P: 8).
    unify_bones : one set of bone lengths for the speaker.
    sigma : standard deviation of the Gaussian, in frames of 15 Hz (P: 1.5), on body, hands and head rotation.
    upright : the shot's mean trunk is turned to stand straight; hands and head that other networks saw by as much of it
        as the head's mean lean shares. forward : the smoothed heading is taken out. ahead : the head's mean direction
        over a shot is straight ahead, and counts as much as the heading where hands are seen apart (O).
    window, threshold : a frame is excluded where the mean confidence of the face, or of the two hands together, over a
        window of so many frames of 15 Hz around it falls below the threshold (P: the rule; O: its two numbers).
    least_face, least_body : pixels of the face's height and share of frames with a body, below which a take is refused
        (P: the rule; O: the numbers).
    """

    bone_tolerance: float = 0.5
    speed_limit: float = 8.0
    agreement: float = 0.8
    joined: float = 0.6
    wrists: bool = True
    fill_frames: int = 8
    unify_bones: bool = True
    sigma: float = 1.5
    upright: bool = True
    forward: bool = True
    ahead: bool = True
    window: int = 64
    threshold: float = 0.3
    least_face: float = 40.0
    least_body: float = 0.3


@dataclass
class Cleaned:
    """Motion on the clip's clock, T frames in the clip's axes.

    positions (T, 55, 3) metres. confidence (T, 55) and state (T, 55): OBSERVED, INTERPOLATED, EXCLUDED. face: `Face`
    on the same clock, or None, and face_state (T,). bones (55,) metres. valid (T,): what training may use. dropped:
    {gate: share of seen joints that it dropped}. tilt: degrees by which the take was turned upright, at most.
    """

    positions: np.ndarray
    confidence: np.ndarray
    state: np.ndarray
    face: Face | None
    face_state: np.ndarray | None
    bones: np.ndarray
    dropped: dict
    tilt: float
    valid: np.ndarray = field(init=False)


def clean(observed, fps, frames, *, face=None, cuts=(), bones=None, settings=None, rate=RATE, name="take"):
    """Clean one take.

    observed : `Observations` at `fps`. frames : T, the clip's frames at `rate`. face : `Face` at `fps`, or None.
    cuts : first frames of new shots, which nothing is filled or smoothed across. bones (55,) : the speaker's, from
    `speaker_bones` over all takes; without, this take's own. Returns `Cleaned`; raises CospeechError when no frame has
    a body that passes the gates.
    """
    settings = settings or Cleanup()
    believed, dropped = believe(observed, fps, bones, settings)
    if not believed[:, BODY].any():
        raise CospeechError(f"{name}: no believable body in any of its {len(observed)} frames")
    bones = completed(robust_bones([observed.positions], [believed]) if bones is None else bones)
    if settings.wrists:
        observed = replace(observed, positions=wrists_at_hands(observed, believed))
    typical = _typical(observed.positions, believed)
    shots, apart = [], settings.fill_frames * fps / RATE
    for where, start, count in _shots(cuts, len(observed), fps, frames, rate):
        part = replace(
            observed, **{key: getattr(observed, key)[where] for key in ("positions", "pixels", "score", "seen")}
        )
        shots.append(
            clean_stretch(
                part,
                believed[where],
                typical,
                bones,
                face and face.section(where),
                clock=(fps, rate, count, start),
                apart=apart,
                sigma=settings.sigma * rate / RATE,
                unify=settings.unify_bones,
                upright=settings.upright,
                forward=settings.forward,
                ahead=settings.ahead,
            )
        )
    join = lambda key: np.concatenate([getattr(shot, key) for shot in shots])
    cleaned = Cleaned(
        join("positions"),
        join("confidence"),
        join("state"),
        face and Face.joined([shot.face for shot in shots]),
        None if face is None else join("face_state"),
        bones,
        dropped,
        max(shot.tilt for shot in shots),
    )
    cleaned.valid = _valid(cleaned, settings, rate)
    firsts = np.cumsum([len(shot.positions) for shot in shots])[:-1]
    cleaned.valid[firsts[firsts < frames]] = False  # no window may straddle a cut
    return cleaned


def speaker_bones(takes, rates, settings=None):
    """(55,) metres: the one set of bone lengths of a speaker, from all their takes (`Observations` and their fps)."""
    settings = settings or Cleanup()
    believed = [believe(observed, fps, None, settings)[0] for observed, fps in zip(takes, rates, strict=True)]
    return completed(robust_bones([observed.positions for observed in takes], believed))


def believe(observed, fps, bones=None, settings=None):
    """The joints that pass the gates, (F, 55) bool, and {gate: share of the seen joints that it dropped}.

    bones (55,): the speaker's; without, the medians of what passed the gates before.
    """
    settings, seen, dropped = settings or Cleanup(), observed.seen.copy(), {}
    total = max(int(seen.sum()), 1)

    def drop(gate, wrong):
        dropped[gate] = float((seen & wrong).sum() / total)
        seen[wrong] = False

    wrong = np.zeros(seen.shape, bool)
    for part, joints in HANDS.items() if settings.joined else ():
        wrong[:, joints] = joined_gate(observed.pixels, seen, part, settings.joined)[:, None]
    drop("joined", wrong)
    wrong = np.zeros(seen.shape, bool)
    for part in PARTS.values() if settings.agreement else ():
        wrong[:, part] = agreement_gate(
            observed.positions[:, part], observed.pixels[:, part], seen[:, part], settings.agreement
        )
    drop("agreement", wrong)
    if settings.bone_tolerance:
        known = robust_bones([observed.positions], [seen]) if bones is None else bones
        drop("bone", bone_gate(observed.positions, seen, known, settings.bone_tolerance))
    if settings.speed_limit:
        drop("speed", speed_gate(observed.positions, seen, fps, settings.speed_limit))
    return seen, dropped


def completed(bones):
    """(55,) bones; those of hands that were never seen are taken from a resting hand that fits the forearm."""
    bones = bones.copy()
    for side, sign in SIDES.items():
        scale = bones[UPPER55.index[f"{side}_wrist"]] / REST_FOREARM or 1.0
        for finger, offsets in rest_hand(scale, sign).items():
            joints = UPPER55.joints(*(f"{side}_{finger}_{i}" for i in range(4)))
            bones[joints] = np.where(bones[joints] > 0, bones[joints], np.linalg.norm(offsets, axis=1))
    return bones


def _typical(positions, believed):
    """(55, 3) the take's median of each joint, for shots that never show it; NaN for joints that no shot shows."""
    shown = np.where(believed[..., None], positions, np.nan)
    known = believed.any(axis=0)
    pose = np.full(positions.shape[1:], np.nan)
    pose[known] = np.nanmedian(shown[:, known], axis=0)
    body = np.arange(len(UPPER55)) < BODY.stop
    pose[body & ~known] = np.median(positions[:, body & ~known], axis=0)  # the tracker's guess is all there is
    return pose


def _shots(cuts, length, fps, frames, rate):
    """(slice of the video's frames, seconds from its start to the first clip frame, number of clip frames) a shot."""
    edges = np.concatenate([[0], np.asarray(cuts, int), [length]])
    firsts = np.minimum(np.ceil(edges[:-1] * rate / fps - 1e-9).astype(int), frames)
    for a, b, first, last in zip(edges[:-1], edges[1:], firsts, [*firsts[1:], frames], strict=True):
        if last > first:
            yield slice(a, b), first / rate - a / fps, last - first


def _valid(cleaned, settings, rate):
    """(T,) bool: the windows of confidence, and no frame whose body is mostly unknown."""
    valid = (cleaned.state[:, BODY] != EXCLUDED).mean(axis=1) > 0.5
    hands = cleaned.confidence[:, BODY.stop :].mean(axis=1)
    for confidence in (hands, cleaned.face and cleaned.face.score) if settings.threshold else ():
        if confidence is not None:
            valid &= window_mean(confidence, round(settings.window * rate / RATE)) >= settings.threshold
    return valid


def window_mean(values, window):
    """Mean of (T,) over a window of so many frames around each frame; at the ends, the frames that there are."""
    total = np.concatenate([[0.0], np.cumsum(values, dtype=float)])
    first = np.clip(np.arange(len(values)) - window // 2, 0, None)
    last = np.clip(np.arange(len(values)) - window // 2 + window, None, len(values))
    return (total[last] - total[first]) / (last - first)
