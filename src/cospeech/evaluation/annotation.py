"""What capture makes of the virtual speaker's films, against the truth: how far its joints are off, and what is lost
for gestures that are learnt from films instead of from the truth."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError, notice
from cospeech.evaluation import columns
from cospeech.face.expressions import COSPEECH64
from cospeech.face.model import embedded
from cospeech.formats.result_table import number, write_table
from cospeech.skeleton import BODY, LEFT_HAND, RIGHT_HAND, UPPER55

JOINTS = {
    "head": ("head", "head_top"),
    "neck and spine": ("neck", "spine"),
    "shoulders": ("left_shoulder", "right_shoulder"),
    "elbows": ("left_elbow", "right_elbow"),
    "wrists": ("left_wrist", "right_wrist"),
    "hips": ("left_hip", "right_hip"),
    "body": tuple(n for n in UPPER55.names[BODY] if n != "pelvis"),
}
# Components of the expression by how their names begin.
EXPRESSIONS = {"expression": ("",), "expression: mouth": ("jaw", "mouth"), "expression: jaw_open": ("jaw_open",)}
MOVED = 0.02  # standard deviation over time from which an expression component counts as moved
VISIBLE = 1e-3  # metres by which such a component moves some landmark
MODEL = "knn"  # the generator that learns from both: its motion is the recorded one, so what is lost can be seen in it
ROWS = ("ground_truth", "mean_pose", "annotation", f"{MODEL}_from_truth", f"{MODEL}_from_films")
METRICS = (
    columns.FGD,
    columns.MOTION_VARIANCE,
    columns.BEAT_EXCESS,
    columns.SYNCHRONY,
    columns.WRIST_SPEED_LEFT,
    columns.WRIST_SPEED_RIGHT,
    columns.WRIST_HEIGHT_LEFT,
    columns.WRIST_HEIGHT_RIGHT,
    columns.SPEED_HELLINGER,
    columns.JERK,
)
HEADINGS = ("subject", "part", "unit", "median", "mean", "90th percentile", "excluded [%]")


@dataclass(frozen=True)
class Error:
    """One part's error over all frames in which it is not excluded, in `unit`; `excluded`: the share of the others."""

    part: str
    unit: str
    median: float
    mean: float
    high: float
    excluded: float


def annotation_errors(clips, truth):
    """[`Error`] of annotated clips against the true ones: {take: Clip} both, on the same clock, faces of cospeech64.

    Body joints relative to the pelvis, hands relative to their wrist (mm); the head's rotation (degrees); expression:
    the correlation over time of every component that moves and that landmarks can show, one number each, and of those
    of the mouth alone. Lower is better, but for expressions.
    Raises CospeechError if a take has no truth of its length.
    """
    for name, clip in clips.items():
        if name not in truth or truth[name].frames != clip.frames:
            raise CospeechError(f"{clip.subject}/{name}: {clip.frames} frames, which its truth does not have")
    pairs = [(clip, truth[name]) for name, clip in clips.items()]
    found = [_joints(pairs, part, UPPER55.joints(*names)) for part, names in JOINTS.items()]
    hands = {"right hand": [RIGHT_HAND], "left hand": [LEFT_HAND], "hands": [RIGHT_HAND, LEFT_HAND]}
    found += [_hands(pairs, part, where) for part, where in hands.items()]
    if all(clip.rotation is not None for clip in clips.values()):
        found.append(_head(pairs))
    if all(clip.expression is not None and clip.face_model == truth[name].face_model for name, clip in clips.items()):
        found += [_expression(pairs, part, begin) for part, begin in EXPRESSIONS.items()]
    return found


def _error(part, unit, values, known):
    """The `Error` of values (N,) of which only those `known` count."""
    values = values[known]
    numbers = (np.median(values), values.mean(), np.percentile(values, 90)) if len(values) else [np.nan] * 3
    return Error(part, unit, *map(float, numbers), float(1 - np.mean(known)))


def _joints(pairs, part, joints):
    away = [np.linalg.norm(clip.positions[:, joints] - true.positions[:, joints], axis=-1) for clip, true in pairs]
    known = [clip.confidence[:, joints] > 0 for clip, _ in pairs]
    return _error(part, "mm", 1000 * np.concatenate(away).ravel(), np.concatenate(known).ravel())


def _hands(pairs, part, hands):
    away, known = [], []
    for hand in hands:
        fingers = slice(hand.start + 1, hand.stop)  # without the wrist, which is right by definition
        for clip, true in pairs:
            own, real = (c.positions[:, fingers] - c.positions[:, hand.start, None] for c in (clip, true))
            away.append(np.linalg.norm(own - real, axis=-1).ravel())
            known.append((clip.confidence[:, fingers] > 0).ravel())
    return _error(part, "mm", 1000 * np.concatenate(away), np.concatenate(known))


def _head(pairs):
    turns = [(Rotation.from_rotvec(c.rotation).inv() * Rotation.from_rotvec(t.rotation)).magnitude() for c, t in pairs]
    known = np.concatenate([clip.face_confidence > 0 for clip, _ in pairs])
    return _error("head rotation", "degrees", np.degrees(np.concatenate(turns)), known)


def _expression(pairs, part, begin):
    """Correlations of the components that move and that landmarks show, of those whose names begin so; one that the
    annotation never moves has 0."""
    known = np.concatenate([clip.face_confidence > 0 for clip, _ in pairs])
    own, real = (np.concatenate([pair[i].expression for pair in pairs])[known] for i in (0, 1))
    own_part = np.array([name.startswith(begin) for name in COSPEECH64])
    moved = np.flatnonzero((real.std(axis=0) > MOVED) & _shown() & own_part) if known.any() else []
    values = np.array([np.corrcoef(own[:, i], real[:, i])[0, 1] if own[:, i].std() else 0.0 for i in moved])
    error = _error(part, "correlation", values, np.ones(len(values), bool))
    return replace(error, excluded=float(1 - known.mean()))


@cache
def _shown():
    """(E,) bool: the components of cospeech64 that move a landmark; tongue, cheeks and gaze do not."""
    model = embedded()
    return np.linalg.norm(model.expression[model.landmarks], axis=1).max(axis=0) > VISIBLE


def write_errors(path, errors):
    """The table of {subject: [Error]} as CSV, one line a subject and part; shares in percent, "n/a" where unknown."""
    lines = (
        [subject, e.part, e.unit, *(number(x, 3) for x in (e.median, e.mean, e.high, 100 * e.excluded))]
        for subject, found in errors.items()
        for e in found
    )
    write_table(path, HEADINGS, lines)


def judge_learning(annotated, truth, split, audio, feature_net, seed=0):
    """Gestures from films and from the truth, both judged on the true test takes: [Evaluation], the rows `ROWS`.

    annotated, truth : {take: Clip}. split : {"train": [take], "test": [take]}. audio : {take: (samples, rate)} of the
    test takes. feature_net : (FeatureNet) trained on the true training takes. `annotation` is the annotated test takes
    judged as if a model had made them: what no model that learns from films can be expected to exceed. Without a valid
    stretch to learn from a notice says so, and the row is left out.
    """
    from cospeech.evaluation.evaluate import evaluate_baseline, evaluate_model
    from cospeech.evaluation.generated import generate_clips
    from cospeech.evaluation.reference import Reference
    from cospeech.matching import KNN, Database

    test = {name: truth[name] for name in split["test"]}
    reference = Reference.build(test, [truth[name] for name in split["train"]], feature_net, audio, seed=seed)
    reference.subject = next(iter(annotated.values())).subject
    rows = {"annotation": {name: annotated[name] for name in test}}
    for row, clips in zip(ROWS[3:], (truth, annotated), strict=True):
        try:
            model = KNN(Database.from_clips([clips[name] for name in split["train"]]))
        except CospeechError as error:
            notice(f"{reference.subject}: no row {row}: {error}")
            continue
        rows[row] = generate_clips(model, test, row, seed, smoothing=0.0)
    baselines = [evaluate_baseline(row, reference) for row in ROWS[:2]]
    return baselines + [evaluate_model(row, made, reference) for row, made in rows.items()]
