"""Lip error (thesis Table 4.3): how far a generated face's lips are from the recorded ones, in millimetres.

Both expressions are put on one face model in neutral head pose; the error is the mean 3D distance of the lips' vertices
(the publication's list of vertices is not known: ours are the face model's `lips`).
"""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.evaluation.columns import LIP_ERROR, csv_headings
from cospeech.evaluation.generated import generate_clips
from cospeech.face.model import embedded
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.formats.result_table import mean_and_deviation, number, write_table
from cospeech.gestures.baselines import MeanPose, RandomTake, mismatched

SCHEMA = "cospeech.lips"
RANDOM = "random"
DRAWS = 10  # of random faces


@dataclass
class LipErrors:
    """Of one subject (schema `cospeech.lips`, version 1): clips, frames (C,), errors {row: (C,) mm, NaN: no face}."""

    subject: str
    clips: list
    frames: np.ndarray
    errors: dict

    def mean(self, row):
        """Over all frames of all clips, mm; NaN where the row has no face."""
        return float(np.average(self.errors[row], weights=self.frames)) if len(self.clips) else float("nan")

    def deviation(self, row):
        """Of the sample of clips, mm; NaN for fewer than two."""
        return float(mean_and_deviation(self.errors[row])[1]) if self.clips else float("nan")

    def write(self, path):
        """Write results/<subject>/evaluation/lips.h5."""
        with writing_hdf5(path, SCHEMA, subject=self.subject, units="mm") as file:
            file["clip"] = [name.encode() for name in self.clips]
            put(file, "frames", self.frames)
            rows = file.create_group("error", track_order=True)
            for row, errors in self.errors.items():
                put(rows, row, errors)

    @classmethod
    def read(cls, path):
        """Read what `write` wrote."""
        with reading_hdf5(path, SCHEMA) as file:
            errors = {row: data[()] for row, data in file["error"].items()}
            return cls(file.attrs["subject"], [c.decode() for c in file["clip"]], file["frames"][()], errors)


def lip_distances(expression, truth, face):
    """(T, E), (T, E) coefficients of a `FaceModel` -> (T,) mean distance of its lips' vertices in mm."""
    apart = face.lip_vertices(expression) - face.lip_vertices(truth)
    return 1000 * np.linalg.norm(apart, axis=-1).mean(axis=-1)


def lip_error(made, truth, face):
    """Mean over the frames of `truth` that are valid and show a face, in mm; NaN if `made` has no face.

    made, truth : Clip or Motion of the same frames, truth a Clip. Raises CospeechError when truth has no face, and for
    expressions of another face model.
    """
    where = f"{truth.subject}/{truth.clip}"
    if truth.expression is None:
        raise CospeechError(f"{where}: no face in the recording, so a lip error cannot be told; give takes with a face")
    if made.expression is None:
        return float("nan")
    widths = made.expression.shape[1], truth.expression.shape[1]
    if made.face_model != truth.face_model or widths[0] != widths[1]:
        raise CospeechError(
            f"{where}: a face of model {made.face_model!r} with {widths[0]} coefficients, the recording has "
            f"{truth.face_model!r} with {widths[1]}; train on takes of one face model"
        )
    frames = min(len(made.expression), len(truth.expression))
    seen = _seen(truth)[:frames]
    return float(lip_distances(made.expression[:frames][seen], truth.expression[:frames][seen], face).mean())


def _seen(clip):
    """(T,) bool: frames that are valid and show a face."""
    return clip.valid if clip.face_confidence is None else clip.valid & (clip.face_confidence > 0)


def judge_lips(truth, made, train, face=None, seed=0):
    """Lip errors of a subject's models and baselines: -> LipErrors.

    Parameters
    ----------
    truth : {clip id: Clip}, the test part. made : {row: {clip id: Clip}}, what models made of its speech.
    train : list of Clip, the training part, for the rows `mean_pose` (its mean face, held) and `random` (a recorded
        face of other speech, mean of ten draws). `mismatched` is each test clip's face under the next one's speech.
    face : FaceModel of all of them; None is the embedded one.
    seed : of the first draw.

    A subject without faces, or with faces of a model that is not `face`, has no clips and a notice says so.
    """
    subject, face = train[0].subject, face or embedded()
    shown = {name: clip for name, clip in sorted(truth.items()) if clip.expression is not None and _seen(clip).any()}
    models = {clip.face_model for clip in shown.values()}
    if not shown or models != {face.name}:
        why = f"model {models.pop()!r}, not {face.name!r}" if models else "none in the test part"
        notice(f"{subject}: no lip error, for want of a face: {why}")
        return LipErrors(subject, [], np.zeros(0, int), {})
    mean, random = MeanPose(train), RandomTake(train)
    errors = {"mean_pose": _errors(generate_clips(mean, shown, "mean_pose"), shown, face)}
    if len(shown) > 1:
        errors["mismatched"] = _errors(mismatched(shown), shown, face)
    draws = [_errors(generate_clips(random, shown, RANDOM, seed + i), shown, face) for i in range(DRAWS)]
    errors[RANDOM] = np.mean(draws, axis=0)
    errors |= {row: _errors(clips, shown, face) for row, clips in made.items()}
    return LipErrors(subject, list(shown), np.array([_seen(c).sum() for c in shown.values()]), errors)


def _errors(made, truth, face):
    return np.array([lip_error(made[name], clip, face) for name, clip in truth.items()])


def write_lips(path, judged):
    """Table 4.3 (IVA 2021 Table 3), as CSV from a list of LipErrors: one line a subject and row.

    `share of random` is the error over that of the row `random`.
    """
    lines = []
    for one in judged:
        for row in one.errors:
            numbers = one.mean(row), one.deviation(row), one.mean(row) / one.mean(RANDOM)
            lines.append([one.subject, row, *(number(x, 3) for x in numbers), len(one.clips)])
    write_table(path, ["subject", "row", *csv_headings(LIP_ERROR), "share of random", "clips"], lines)
