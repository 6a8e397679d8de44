"""Tables: what the summary says of given evaluations."""

import csv

import h5py
import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.evaluation.columns import METRICS
from cospeech.evaluation.result import Evaluation, write_many
from cospeech.evaluation.tables import cell, read_evaluations, summarise, write_csv

JERK, FGD = (list(METRICS).index(name) for name in ("jerk", "fgd"))


def evaluation(subject, row, jerk, fgd=1.0, seed=0):
    """Two clips with the given jerks; every other metric but FGD does not apply."""
    values = np.full((2, len(METRICS)), np.nan)
    values[:, JERK] = jerk
    mean, deviation = values.mean(axis=0), values.std(axis=0)
    mean[FGD] = fgd
    return Evaluation(subject, row, seed, ["a", "b"], np.array([100, 90]), values, mean, deviation, {"fps": 15.0})


@pytest.fixture
def files(tmp_path):
    """Two subjects' files in an order of no use."""
    rows = [
        evaluation("lively", "resync", (1, 3)),
        evaluation("calm", "knn", (2, 4), fgd=2.0),
        evaluation("calm", "ground_truth", (5, 5), fgd=0.0),
        evaluation("lively", "mean_pose", (0, 0)),
    ]
    paths = [tmp_path / f"{i}.h5" for i in range(len(rows))]
    for row, path in zip(rows, paths, strict=True):
        row.write(path)
    return paths


def test_rows_stand_by_subject_with_baselines_first(files):
    found = [(line.subject, line.row) for line in summarise(read_evaluations(files))]
    assert found == [("lively", "mean_pose"), ("lively", "resync"), ("calm", "ground_truth"), ("calm", "knn")]


def test_csv_has_mean_and_deviation_with_units_and_says_what_does_not_apply(files, tmp_path):
    write_csv(tmp_path / "summary.csv", read_evaluations(files))
    with open(tmp_path / "summary.csv", newline="") as file:
        rows = {(row["subject"], row["row"]): row for row in csv.DictReader(file)}
    knn = rows["calm", "knn"]
    assert (knn["jerk [m/s^3]"], knn["jerk deviation [m/s^3]"], knn["clips"], knn["runs"]) == ("3", "1", "2", "1")
    assert (knn["fgd"], knn["fgd deviation"], knn["synchrony [r]"]) == ("2", "n/a", "n/a")


def test_runs_of_several_seeds_become_one_line_with_their_deviation():
    (line,) = summarise([evaluation("calm", "resync", (j, j + 2), fgd=j, seed=j) for j in (1, 2, 3)])
    assert (line.runs, line.clips, line.mean["jerk"], line.mean["fgd"]) == (3, 2, 3.0, 2.0)
    assert line.deviation["jerk"] == line.deviation["fgd"] == pytest.approx(1.0)  # of the sample: 2 / (3 - 1)


def test_merged_file_holds_every_row_and_refuses_two_of_a_kind(files, tmp_path):
    found = read_evaluations(files)
    write_many(tmp_path / "evaluation.h5", found)
    with h5py.File(tmp_path / "evaluation.h5") as file:
        assert file["calm/knn/0/mean"][JERK] == 3
        assert file["calm/knn/0"].attrs["fps"] == 15.0
        assert [name.decode() for name in file["lively/resync/0/metric"]] == list(METRICS)
    with pytest.raises(CospeechError, match="two evaluations of calm/knn/0"):
        write_many(tmp_path / "evaluation.h5", [*found, evaluation("calm", "knn", (1, 1))])


def test_cells_for_people():
    (line,) = summarise([evaluation("calm", "knn", (2, 4), fgd=0.01234)])
    assert cell(line, "jerk") == "3.00 ± 1.00"
    assert cell(line, "fgd") == "0.0123"
    assert cell(line, "synchrony") == "n/a"


def test_no_files_and_other_files_are_refused(tmp_path):
    with pytest.raises(CospeechError, match="no evaluation file"):
        read_evaluations([])
    (tmp_path / "x.h5").write_text("not HDF5")
    with pytest.raises(CospeechError, match=r"x\.h5"):
        read_evaluations([tmp_path / "x.h5"])
