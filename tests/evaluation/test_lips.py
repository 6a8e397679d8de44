"""Lip error: distances worked out from the face model's bases, and the rows of Table 4.3."""

import csv
import warnings
from dataclasses import replace

import numpy as np
import pytest

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.evaluation.metrics.lips import LipErrors, judge_lips, lip_distances, lip_error, write_lips
from cospeech.face.expressions import COSPEECH64
from cospeech.face.model import FaceModel, embedded
from tests.conftest import make_clip


def talking(seed, frames=64):
    """A clip with a face of the embedded model whose jaw follows the speech features."""
    clip = make_clip(seed, frames)
    expression = np.zeros((frames, 64), np.float32)
    expression[:, COSPEECH64.index("jaw_open")] = 0.5 + 0.4 * np.tanh(clip.features[:, 0])
    return replace(clip, expression=expression, face_model="cospeech64")


def tetrahedron():
    """Four vertices; the first expression moves vertex 1 by 3 mm to the left, the second vertex 2 by 4 mm up."""
    expression = np.zeros((4, 3, 2))
    expression[1, 0, 0], expression[2, 1, 1] = 0.003, 0.004
    return FaceModel(
        "tetra",
        np.eye(4, 3),
        np.zeros((4, 3, 1)),
        expression,
        np.array([[0, 1, 2]]),
        np.full(68, -1),
        lips=np.array([1, 2]),
    )


def test_distance_by_hand():
    face, still = tetrahedron(), np.zeros((3, 2))
    moved = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 0.5]])
    np.testing.assert_allclose(lip_distances(moved, still, face), [1.5, 3.5, 1.0])
    np.testing.assert_allclose(lip_distances(moved, moved, face), 0)


def test_only_the_lips_count_and_the_head_may_turn():
    clip, face = talking(0), embedded()
    brows = clip.expression.copy()
    brows[:, COSPEECH64.index("brow_inner_up")] = 1
    assert lip_error(replace(clip, expression=brows, rotation=clip.rotation + 1), clip, face) == pytest.approx(
        0, abs=1e-6
    )
    shut = clip.expression.copy()
    shut[:, COSPEECH64.index("jaw_open")] = 0
    vertices = np.linalg.norm(face.lip_vertices(clip.expression) - face.lip_vertices(shut), axis=-1)
    assert lip_error(replace(clip, expression=shut), clip, face) == pytest.approx(1000 * vertices.mean())
    assert vertices.mean() > 0.001


def test_frames_without_a_face_do_not_count():
    clip = talking(0)
    made = replace(clip, expression=clip.expression + 0)
    made.expression[:32] += 0.5
    hidden = replace(clip, face_confidence=(np.arange(64) >= 32).astype("f4"))
    assert lip_error(made, clip, embedded()) > 1 and lip_error(made, hidden, embedded()) == 0
    invalid = replace(clip, valid=np.arange(64) >= 32)
    assert lip_error(made, invalid, embedded()) == 0


def test_no_face_and_other_faces_are_one_line_each():
    clip, face = talking(0), embedded()
    with pytest.raises(CospeechError, match=r"toy/take00: no face in the recording"):
        lip_error(clip, replace(clip, expression=None), face)
    assert np.isnan(lip_error(replace(clip, expression=None), clip, face))
    with pytest.raises(CospeechError, match=r"'toy' with 4 coefficients, the recording has 'cospeech64' with 64"):
        lip_error(make_clip(0, 64), clip, face)
    wrong = replace(clip, expression=clip.expression[:, :5])
    with pytest.raises(CospeechError, match=r"5 expression coefficients, it has 64"):
        lip_error(wrong, wrong, face)


@pytest.fixture(scope="module")
def judged():
    truth = {f"take{seed:02d}": talking(seed) for seed in (7, 8, 9)}
    half = {n: replace(c, expression=(c.expression + c.expression.mean(0)) / 2) for n, c in truth.items()}
    blind = {n: replace(c, expression=None) for n, c in truth.items()}
    return judge_lips(truth, {"half": half, "knn": blind}, [talking(seed, 256) for seed in range(3)])


def test_rows_are_in_the_order_that_they_must_be(judged):
    means = {row: judged.mean(row) for row in judged.errors}
    assert 0 < means["half"] < means["mean_pose"] < means["random"] and np.isnan(means["knn"])
    assert means["mismatched"] == pytest.approx(means["random"], rel=0.25)  # both are faces of other speech
    # Two independent draws lie 2 sigma^2 apart on average, a draw and the mean sigma^2: about sqrt(2) for one number.
    assert 1.1 < means["random"] / means["mean_pose"] < 1.5


def test_file_and_table(judged, tmp_path):
    judged.write(tmp_path / "lips.h5")
    again = LipErrors.read(tmp_path / "lips.h5")
    assert list(again.errors) == list(judged.errors) and again.clips == judged.clips
    write_lips(tmp_path / "table.csv", [again])
    with open(tmp_path / "table.csv", newline="") as file:
        lines = {line["row"]: line for line in csv.DictReader(file)}
    assert lines["random"]["share of random"] == "1" and lines["knn"]["lip error [mm]"] == "n/a"
    assert float(lines["half"]["lip error [mm]"]) == pytest.approx(judged.mean("half"), rel=0.01)


def test_deviation_is_that_of_the_sample_of_clips():
    several = LipErrors("ada", ["a", "b", "c"], np.array([10, 10, 20]), {"knn": np.array([1.0, 2.0, 6.0])})
    assert several.mean("knn") == 3.75 and several.deviation("knn") == pytest.approx(7**0.5)  # 4 + 1 + 9 over 2
    assert np.isnan(LipErrors("ada", ["a"], np.array([10]), {"knn": np.array([1.0])}).deviation("knn"))


def test_subjects_without_a_known_face_have_no_rows_and_a_notice():
    faceless = replace(talking(0), expression=None)
    with pytest.warns(CospeechNotice, match=r"toy: no lip error, for want of a face: none in the test part"):
        assert judge_lips({"a": faceless}, {}, [faceless]).errors == {}
    with pytest.warns(CospeechNotice, match=r"model 'toy', not 'cospeech64'"):
        assert judge_lips({"a": make_clip(0)}, {}, [make_clip(1)]).clips == []
    with warnings.catch_warnings(action="error"):  # one take: nothing to mismatch with, and everything else goes on
        assert "mismatched" not in judge_lips({"a": talking(0)}, {}, [talking(1, 128)]).errors
