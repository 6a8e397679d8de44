"""Scores of an exported network, and the table of the ablation."""

import csv
from dataclasses import replace

import h5py
import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.posenet.evaluation.ablation import TITLES, write_ablation
from cospeech.posenet.evaluation.accuracy import evaluate
from cospeech.posenet.store import Store, write_store
from cospeech.posenet.training.stages import ROWS
from tests.posenet.conftest import POSE
from tests.posenet.stick_people import write_stick_people


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    return write_stick_people(tmp_path_factory.mktemp("people") / "test.h5", studio=10, wild=30, spread=1.0)


@pytest.fixture
def evaluation(constant_model, people):
    return evaluate(constant_model, [people], threads=1)


def test_scores_are_those_of_the_poses_that_the_network_answers(people, evaluation):
    truth = Store(people).joints3d
    for domain, chosen in {"studio": slice(0, 10), "wild": slice(10, 40), "all": slice(0, 40)}.items():
        errors = np.linalg.norm(truth[chosen] - 1000 * POSE, axis=2)
        row = evaluation.table[domain, "posenet", "unscaled"]
        assert row["PCK"] == pytest.approx(100 * (errors[:, :14] < 150).mean(), abs=1e-6)
        assert row["MPJPE"] == pytest.approx(errors[:, :17].mean(), abs=1e-3)
    mean_pose = evaluation.table["wild", "mean pose", "unscaled"]["MPJPE"]  # the exported one is at the pelvis
    assert mean_pose == pytest.approx(np.linalg.norm(truth[10:, :17], axis=2).mean(), abs=1e-3)
    assert evaluation["wild", "PCK"] == evaluation.table["wild", "posenet", "globally scaled"]["PCK"]
    assert evaluation.groups["wild"]["Total"] == pytest.approx(evaluation["wild", "PCK"])
    assert evaluation.pred.shape == (40, 21, 3)
    np.testing.assert_allclose(evaluation.pred[0], 1000 * POSE, atol=0.1)


def test_evaluation_file_can_be_read_without_this_package(evaluation, tmp_path):
    evaluation.write(tmp_path / "evaluation.h5")
    with h5py.File(tmp_path / "evaluation.h5") as file:
        assert file.attrs["schema"] == "cospeech.posenet.evaluation"
        assert file["table/values"].shape == (3 * 2 * 3, 3)
        rows = list(zip(*(file[f"table/{name}"].asstr()[:] for name in ("domain", "row", "protocol")), strict=True))
        value = file["table/values"][rows.index(("wild", "posenet", "globally scaled")), 0]
        assert value == evaluation["wild", "PCK"]
        assert file["groups/wild"].attrs["Wrist"] == evaluation.groups["wild"]["Wrist"]
        assert file["poses/pred"].shape == file["poses/truth"].shape == (40, 21, 3)
    assert len(list(evaluation.lines())) == 19


def test_hands_are_judged_at_a_hands_scale(constant_hand, tmp_path):
    hands = write_stick_people(tmp_path / "test.h5", studio=0, wild=12, part="hand", spread=0.1)
    evaluation = evaluate(constant_hand, [hands], threads=1)
    errors = np.linalg.norm(Store(hands).joints3d - 100 * (POSE - POSE[0]), axis=2)
    row = evaluation.table["wild", "posenet", "unscaled"]
    assert row["PCK"] == pytest.approx(100 * (errors < 50).mean(), abs=1e-6)
    assert row["AUC"] == pytest.approx(100 * np.mean([(errors < t).mean() for t in np.linspace(0, 50, 31)]), abs=0.5)
    assert evaluation.groups == {}


def test_people_of_another_part_or_without_truth_are_refused(people, constant_model, tmp_path):
    hands = write_stick_people(tmp_path / "hands.h5", studio=2, wild=2, part="hand")
    with pytest.raises(CospeechError, match=r"hands.h5: shows a hand, the network predicts a body"):
        evaluate(constant_model, [hands])
    flat = tmp_path / "flat.h5"
    batch = replace(Store(people)[:3], joints3d=np.zeros((3, 21, 3), np.float32), labelled3d=np.zeros(3, bool))
    write_store(flat, [batch], part="body", source="2D alone")
    with pytest.raises(CospeechError, match=r"flat.h5: nobody in it has 3D truth"):
        evaluate(constant_model, [flat])


def test_ablation_table_has_mean_and_deviation_over_seeds(evaluation, tmp_path):
    files = {row: [] for row in TITLES}
    for row in TITLES:
        for seed, value in enumerate((60.0, 62.0, 67.0)):
            evaluation.table["wild", "posenet", "globally scaled"]["PCK"] = value + 10 * (row == "both")
            files[row].append(tmp_path / f"{row}-{seed}.h5")
            evaluation.write(files[row][-1])
    write_ablation(tmp_path / "table.csv", files)
    with open(tmp_path / "table.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["row"] for row in rows] == ["baseline", "latent", "projection", "both"] == list(ROWS)
    assert (rows[0]["PCK"], rows[3]["PCK"], rows[0]["seeds"]) == ("63.00", "73.00", "3")
    assert float(rows[0]["PCK deviation"]) == pytest.approx(np.std([60, 62, 67], ddof=1), abs=0.005)
    write_ablation(tmp_path / "one.csv", {row: paths[:1] for row, paths in files.items()})
    assert "n/a" in (tmp_path / "one.csv").read_text()
    with pytest.raises(CospeechError, match="moon"):
        write_ablation(tmp_path / "moon.csv", files, domain="moon")
