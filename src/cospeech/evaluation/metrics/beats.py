"""Beat consistency of HA2G (section 4.3, appendix E) on its own bone vectors: every included angle, fingers too.

`gesture_metrics.motion_beats` looks at the body alone and scores one clip; here a whole test part is scored as the
publication does, and nothing is left out in silence: clips without an onset and clips without a beat are counted, and
the score is given with the latter and without them.
"""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics.gesture_metrics import beats_of, chance_coverage, change_rate, onset_coverage, rests
from cospeech.gestures.ha2g.dataset.levels import included_angles

PUBLISHED = {"TED": 0.03, "Expressive": 0.001}  # HA2G's code; what DiffGesture's uses for TED Expressive
SIGMA = 0.1  # seconds (HA2G eq. 11)
QUANTILE = 0.25  # of the training part's rises: the shallowest quarter of its rests is ripple (docs/ha2g_metrics.md)


def angle_changes(vectors, table):
    """|change| from the frame before of every included angle: (T, V, 3) -> (T - 1, P), in units of pi (HA2G eq. 10)."""
    return np.abs(np.diff(included_angles(np.asarray(vectors, np.float64), table), axis=0))


def mean_angle_change(changes):
    """MAAC (P,) of a list of (T - 1, P): mean over all frames of the data (HA2G eq. 10)."""
    return np.concatenate(changes).mean(axis=0)


def beat_threshold(changes, maac, quantile=QUANTILE):
    """The threshold of motion beats that a body of data asks for: a quantile of the rises beside its local minima.

    The published thresholds belong to two data sets and their trackers' noise. `changes`: list of (T - 1, P), the
    training part. CospeechError when it has no local minimum.
    """
    rises = np.concatenate([rests(change_rate(one, maac))[1] for one in changes])
    if not rises.size:
        raise CospeechError("beat threshold: the training part never comes to rest; give longer takes")
    return float(np.quantile(rises, quantile))


@dataclass(frozen=True)
class BeatConsistency:
    """The score of a test part.

    with_still : mean over the onsets of all clips; clips whose motion has no beat score 0 there. without_still : the
    same without such clips. excess : `with_still` less what it is when the onsets are rotated in time, of clips of 3 s
    or more. clips, silent (without an onset: no score), still (without a beat), onsets, beats : how many there are.
    """

    with_still: float
    without_still: float
    excess: float
    clips: int
    silent: int
    still: int
    onsets: int
    beats: int


def beat_consistency(changes, onsets, maac, *, threshold, sigma=SIGMA, fps=15.0):
    """BC of a test part (HA2G eq. 11): mean over onsets of exp(-d^2 / (2 sigma^2)), d to the nearest beat of the clip.

    Parameters
    ----------
    changes : list of (T - 1, P), the angle changes of each clip. onsets : list of (K,) ascending seconds, of each clip.
    maac : (P,) of the training part. threshold : of beats, in units of the change rate. sigma : seconds.

    Returns a BeatConsistency; NaN where nothing is left to score. Every onset counts the same, as in released code.
    """
    beats = [beats_of(one, fps, threshold, maac) for one in changes]
    heard = [i for i, times in enumerate(onsets) if len(times)]
    moving = [i for i in heard if len(beats[i])]
    weights = np.array([len(times) for times in onsets], float)
    scores = np.array([onset_coverage(b, t, sigma) for b, t in zip(beats, onsets, strict=True)])
    durations = [(len(one) + 1) / fps for one in changes]
    chance = np.array([chance_coverage(b, t, d, sigma) for b, t, d in zip(beats, onsets, durations, strict=True)])
    long = [i for i in heard if np.isfinite(chance[i])]
    mean = lambda values, which: float(np.average(values[which], weights=weights[which])) if which else np.nan
    return BeatConsistency(
        mean(scores, heard),
        mean(scores, moving),
        mean(scores - chance, long),
        len(beats),
        len(beats) - len(heard),
        sum(not len(b) for b in beats),
        int(weights.sum()),
        sum(map(len, beats)),
    )


def released_beats(changes, maac, *, threshold=PUBLISHED["TED"], fps=15.0):
    """Beats of one window as released code finds them, (T - 1, P) -> (N,) seconds.

    Strict minima alone, from the third frame on; a change belongs to its later frame, half a frame late.
    """
    rate = np.concatenate([[0.0], change_rate(changes, maac)])
    t = np.arange(2, len(rate) - 1)
    before, after = rate[t - 1] - rate[t], rate[t + 1] - rate[t]
    return t[(before > 0) & (after > 0) & (np.maximum(before, after) >= threshold)] / fps


def released_beat_consistency(changes, onsets, maac, *, threshold=PUBLISHED["TED"], sigma=SIGMA, fps=15.0):
    """BC as released HA2G code has it: over windows of 34 frames with onsets of their own; those without beats skipped.

    Motion that is mostly still is judged by the few windows in which it moves. Parameters as in `beat_consistency`, of
    windows; windows without an onset, over which released code divides by zero, are left out. NaN if none is left.
    """
    beats = [released_beats(one, maac, threshold=threshold, fps=fps) for one in changes]
    scored = [(b, times) for b, times in zip(beats, onsets, strict=True) if len(b) and len(times)]
    if not scored:
        return float("nan")
    return float(np.average([onset_coverage(b, t, sigma) for b, t in scored], weights=[len(t) for _, t in scored]))
