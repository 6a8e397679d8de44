"""The rows that are no models: they show what the numbers mean."""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.reference import speakers

GROUND_TRUTH, MISMATCHED, MEAN_POSE, SHUFFLED = "ground_truth", "mismatched", "mean_pose", "shuffled"
BASELINES = (GROUND_TRUTH, MISMATCHED, MEAN_POSE)  # of every table
HA2G_BASELINES = (GROUND_TRUTH, MISMATCHED, SHUFFLED, MEAN_POSE)  # of HA2G's


def baseline_takes(row, reference, way=1):
    """{name: Take} of a row.

    ground_truth : the test motion itself. mismatched : each test motion under the speech of the `way`-th next test clip
    of its speaker, by name (a speaker's only clip: its two halves exchanged). mean_pose : each speaker's mean over the
    training part, held. shuffled : the test motion with its frames in random order.
    """
    if row == GROUND_TRUTH:
        return reference.takes
    if row == MISMATCHED:
        return _mismatched(reference.takes, way)
    if row == MEAN_POSE:
        return {name: _held(take, *reference.mean_poses[take.speaker]) for name, take in reference.takes.items()}
    if row == SHUFFLED:
        return _shuffled(reference.takes, np.random.default_rng(reference.seed))
    raise CospeechError(f"baseline {row!r} is not known; known: {', '.join((*BASELINES, SHUFFLED))}")


def ways_to_mismatch(reference):
    """How many ways there are until a speaker's motion has been under every other speech of theirs."""
    takes = reference.takes.values()
    return max(1, max(sum(take.speaker == one for take in takes) for one in speakers(takes)) - 1)


def _mismatched(takes, way):
    made = {}
    for one in speakers(takes.values()):
        own = {name: take for name, take in takes.items() if take.speaker == one}
        if len(own) == 1:
            ((name, take),) = own.items()
            half = len(take.positions) // 2
            own = {f"{name} first half": take.cut(0, half), f"{name} second half": take.cut(half, 2 * half)}
        names = list(own)
        for i, name in enumerate(names):
            other = names[(i + 1 + (way - 1) % (len(names) - 1)) % len(names)]
            made[name] = own[other].with_speech_of(own[name])
    return made


def _held(take, positions, rotation):
    frames = len(take.positions)
    turn = None if rotation is None else np.broadcast_to(rotation, (frames, 3))
    return take.showing(np.broadcast_to(positions, (frames, *positions.shape)), turn)


def _shuffled(takes, rng):
    made = {}
    for name, take in takes.items():
        order = rng.permutation(len(take.positions))
        made[name] = take.showing(take.positions[order], None if take.rotation is None else take.rotation[order])
    return made
