"""Tables of a study: against scipy, closed forms, and the numbers one gets by hand; who is left out, and why."""

import argparse
import csv
import json
from itertools import pairwise

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from cospeech.commands import study as command
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.study.analyse import analyse, write_results
from cospeech.study.answers import CODE, checksum, read_answers, read_file
from cospeech.study.statistics import bradley_terry, compare, connected, holm, signed_rank, strengths, summarise
from tests.study.conftest import answered


def test_means_and_deviations_by_hand():
    ratings = {"a": {"p": [5, 4], "q": [3, 4]}, "b": {"p": [1, 2], "q": [2, 2]}}
    a, b = summarise(ratings, "naturalness", ["a", "b"])
    assert (a.mean, a.ratings, a.participants) == (4.0, 4, 2) and a.deviation == pytest.approx((2 / 3) ** 0.5)
    assert b.mean == 1.75 and b.deviation == pytest.approx(0.5)
    # means of participants 4.5 and 3.5: their deviation is 0.7071, t(0.975, 1) = 12.7062
    assert (a.low, a.high) == pytest.approx((4 - 12.7062 * 0.5, 4 + 12.7062 * 0.5), abs=1e-3)
    single = summarise({"a": {"p": [3]}}, "q", ["a"])[0]
    assert single.mean == 3 and all(np.isnan((single.deviation, single.low, single.high)))


def test_comparisons_are_scipys_with_holms_correction():
    rng = np.random.default_rng(3)
    scores = {
        name: {f"p{i}": 3 + shift + rng.integers(-2, 3) / 3 for i in range(20)}
        for name, shift in (("a", 1.0), ("b", 0.0), ("c", 0.5))
    }
    found = compare(scores, "q", ["a", "b", "c"])
    assert [(row.a, row.b) for row in found] == [("a", "b"), ("a", "c"), ("b", "c")]
    for row in found:
        x, y = (np.array([scores[name][f"p{i}"] for i in range(20)]) for name in (row.a, row.b))
        expected = stats.wilcoxon(np.rint(6 * (x - y)))  # in sixths: equal differences are equal
        assert (row.statistic, row.p) == pytest.approx((expected.statistic, expected.pvalue))
        assert row.difference == pytest.approx((x - y).mean()) and row.participants == 20
    smallest = min(found, key=lambda row: row.p)
    assert smallest.p_holm == pytest.approx(3 * smallest.p) and smallest.p_holm < 0.01


def test_holm_as_in_the_textbook():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.5, 0.9]), [1.0, 1.0])
    assert holm([0.2]) == [0.2]


def test_no_difference_is_no_evidence_and_six_of_six_is_exact():
    assert signed_rank([0.0, 0.0, 0.0]) == (0.0, 1.0)
    assert signed_rank([1, 2, 3, 4, 5, 6]) == (0.0, pytest.approx(2 / 2**6))
    assert signed_rank([0.1 + 0.2 - 0.3, 0.0])[1] == 1.0  # rounding of means is no difference


def test_strengths_of_two_are_the_log_odds():
    for wins, losses in ((3, 1), (10, 10), (1, 7)):
        found = bradley_terry(np.array([[0, wins], [losses, 0]]))
        assert found[0] - found[1] == pytest.approx(np.log(wins / losses), abs=1e-8)


def test_strengths_are_recovered_from_their_own_expected_wins():
    truth = np.array([1.2, 0.3, -0.4, -1.1])
    chance = 1 / (1 + np.exp(truth[None] - truth[:, None]))
    np.testing.assert_allclose(bradley_terry(40 * chance * (1 - np.eye(4))), truth - truth.mean(), atol=1e-7)


@given(st.lists(st.integers(1, 30), min_size=12, max_size=12))
def test_strengths_have_the_largest_likelihood(counts):
    wins = np.zeros((4, 4))
    wins[~np.eye(4, dtype=bool)] = counts

    def cost(s):
        return (wins * np.log1p(np.exp(s[None] - s[:, None]))).sum()

    best = optimize.minimize(cost, np.zeros(4), tol=1e-12)
    assert cost(bradley_terry(wins)) <= best.fun + 1e-7


def test_who_never_loses_has_no_finite_strength_and_it_is_said():
    wins = np.array([[0, 2, 3], [0, 0, 2], [0, 1, 0]])
    assert not connected(wins) and np.isnan(bradley_terry(wins)).all()
    cycle = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    assert connected(cycle)
    np.testing.assert_allclose(bradley_terry(np.stack([wins, cycle]))[1], 0, atol=1e-9)
    found, finite = strengths(np.stack([wins, wins]), "q", ["a", "b", "c"], resamples=50)
    assert not finite and found[0].strength > found[1].strength > found[2].strength
    assert all(np.isfinite((row.strength, row.low, row.high)).all() for row in found)


def test_intervals_of_strengths_hold_the_truth_about_as_often_as_they_say():
    truth, rng = np.array([0.5, 0.0, -0.5]), np.random.default_rng(0)
    chance = 1 / (1 + np.exp(truth[None] - truth[:, None]))
    inside = 0
    for trial in range(60):
        first = np.triu(rng.random((40, 3, 3)) < chance, 1)
        duels = first + np.swapaxes(np.triu(~first, 1), 1, 2)
        row = strengths(duels, "q", ["a", "b", "c"], seed=trial, resamples=200)[0][0]
        inside += row.low <= 0.5 <= row.high
    assert 50 <= inside <= 60


STARS = {"ground_truth": 5, "mismatched": 3, "knn": 4}


def test_files_become_the_table_and_the_excluded_are_listed(make_study, answer, tmp_path):
    folder, study = make_study(points=7)
    for i in range(8):
        answer(study, f"p{i}", lambda c, q, i=i: STARS[c] + (i % 2) * (q == "synchrony"))
    answers = answered(study, "sleepy", lambda c, q: 1)["answers"]
    answers[-1] = answers[-1] | {"values": {"naturalness": 2, "synchrony": 5}}  # asked for 2 in every question
    answer(study, "sleepy", lambda c, q: 1, changed={"answers": answers})
    with pytest.warns(CospeechNotice, match="sleepy.json: left out: failed 1 of 1 attention checks"):
        found = analyse(folder, [tmp_path / "answers"])
    assert found.participants == [f"p{i}" for i in range(8)] and len(found.left) == 1
    lines = {(row.condition, row.question): row for row in found.table}
    assert lines["knn", "naturalness"].mean == 4 and lines["knn", "naturalness"].deviation == 0
    assert lines["knn", "synchrony"].mean == 4.5
    assert lines["knn", "synchrony"].deviation == pytest.approx(np.std([4, 5] * 8, ddof=1))
    first = found.comparisons[0]
    assert (first.a, first.b, first.difference, first.participants) == ("ground_truth", "mismatched", 2.0, 8)
    assert first.p == pytest.approx(stats.wilcoxon([2.0] * 8).pvalue)
    assert len(analyse(folder, [tmp_path / "answers"], failures=1).participants) == 9


def test_all_that_is_written(make_study, answer, tmp_path):
    folder, study = make_study(title="<i>Title</i> $5", questions={"fit": "Does it <b>fit</b>, $x$?"})
    paths = [answer(study, f"p{i}", lambda c, q, i=i: min(STARS[c] + i % 2, 5)) for i in range(6)]
    broken = tmp_path / "<broken>.json"
    broken.write_text("{")
    with pytest.warns(CospeechNotice, match="is not whole JSON"):
        results = analyse(folder, [*paths, broken])
    write_results(tmp_path / "out", results)
    write_results(tmp_path / "again", results)
    names = ["answers.csv", "comparisons.csv", "fit.png", "left_out.csv", "results.html", "study.h5", "table.csv"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    for name in names:
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    table = list(csv.DictReader((tmp_path / "out/table.csv").open()))
    assert [(row["condition"], row["mean"]) for row in table] == [
        ("ground_truth", "5"),
        ("mismatched", "3.5"),
        ("knn", "4.5"),
    ]
    assert len(list(csv.DictReader((tmp_path / "out/answers.csv").open()))) == 6 * 6
    with h5py.File(tmp_path / "out/study.h5") as file:
        assert file.attrs["schema"] == "cospeech.study_results" and file.attrs["study"] == study["id"]
        assert file["table/mean"][:].tolist() == [5, 3.5, 4.5]
        assert list(file["comparisons/b"].asstr()) == ["mismatched", "knn", "knn"]
        assert "whole JSON" in file["left_out/reason"].asstr()[0]
    page = (tmp_path / "out/results.html").read_text()
    assert "4.50 ± 0.52" in page and "&lt;i&gt;Title&lt;/i&gt; $5" in page and "&lt;broken&gt;.json" in page
    assert not any(tag in page for tag in ("<i>", "<b>", "<broken>", "<script"))


def test_pairs_become_strengths_and_shares(make_study, answer, tmp_path):
    folder, study = make_study(kind="pairs", ties=True)
    order = ["ground_truth", "knn", "mismatched"]

    def prefers(i):
        def choose(first, second, question):
            if question == "naturalness" and {first, second} == {"knn", "mismatched"}:
                return "same"
            better = order.index(first) < order.index(second)
            return "first" if better != (i % 4 == 0) else "second"

        return choose

    found = analyse(folder, [answer(study, f"p{i}", prefers(i)) for i in range(12)])
    rows = {(row.condition, row.question): row for row in found.table}
    assert rows["knn", "naturalness"].comparisons == 12 * 2 * 2
    assert rows["knn", "naturalness"].wins == 12 * 2 * 0.5 + 3 * 2  # draws, and the three who see it the other way
    assert rows["ground_truth", "synchrony"].wins == 9 * 2 * 2
    for question in study["questions"]:
        ranks = [rows[name, question].strength for name in order]
        assert all(a >= b - 1e-9 for a, b in pairwise(ranks)) and not found.notes
    same = next(
        row for row in found.comparisons if row.question == "naturalness" and "ground_truth" not in (row.a, row.b)
    )
    assert (same.difference, same.p) == (0.0, 1.0)
    write_results(tmp_path / "out", found)
    assert "Log strength after Bradley and Terry" in (tmp_path / "out/results.html").read_text()


def _edited(file):
    file["answers"][0]["values"]["naturalness"] = 1


def test_each_bad_file_gets_one_line_and_the_others_count(make_study, answer, tmp_path):
    _, study = make_study()
    rate = lambda c, q: STARS[c]
    whole = json.loads(answer(study, "good", rate).read_text())["answers"]
    hasty = [one | {"ms": {"play": 100, "ended": 110, "answered": 200}} for one in whole]
    foreign = [one | {"stimuli": ["../../secret"]} for one in whole]
    bad = {
        "other": answer(study, "other", rate, changed={"study": "0123456789ab"}),
        "half": answer(study, "half", rate, changed={"answers": whole[:4], "complete": False}),
        "short": answer(study, "short", rate, changed={"answers": whole[:4]}),
        "edited": answer(study, "edited", rate, edit=_edited),
        "nosum": answer(study, "nosum", rate, edit=lambda file: file.pop("checksum")),
        "scale": answer(study, "scale", lambda c, q: 6),
        "text": answer(study, "text", lambda c, q: "5"),
        "true": answer(study, "true", lambda c, q: True),
        "hasty": answer(study, "hasty", rate, changed={"answers": hasty}),
        "foreign": answer(study, "foreign", rate, changed={"answers": foreign}),
        "code": answer(study, "code", rate, changed={"participant": "a/../b"}),
        "repeated": answer(study, "repeated", rate, changed={"answers": [whole[0]] * 6 + whole[6:]}),
        "list": answer(study, "list", rate, changed={"answers": [3] * 7}),
        "schema": answer(study, "schema", rate, changed={"schema": "else"}),
    }
    lines = {
        "other": "answers of study '0123456789ab'; this is",
        "half": "half-filled, 4 of 7",
        "short": "half-filled",
        "edited": "edited after it was saved",
        "nosum": "edited",
        "scale": "is 6, off the scale",
        "text": "off the scale",
        "true": "off the scale",
        "hasty": "answered before its 0.6 s were played",
        "foreign": "a clip that this study does not have",
        "code": "no participant",
        "list": "no known kind",
        "repeated": "not those of one participant",
        "schema": "no file of answers",
    }
    for name, content in {"deep": "[" * 100_000, "latin": "\udcff", "array": "[1]"}.items():
        bad[name] = tmp_path / f"{name}.json"
        bad[name].write_text(content, errors="surrogateescape")
        lines[name] = "expected keys" if name == "array" else "not whole JSON"
    bad["gone"], lines["gone"] = tmp_path / "gone.json", "No such file"
    again = tmp_path / "again.json"
    again.write_text((tmp_path / "answers/answers-good.json").read_text())
    counted, left = read_answers(study, [*bad.values(), again, tmp_path / "answers/answers-good.json"])
    assert [one.participant for one in counted] == ["good"]
    reasons = {one.path: one.reason for one in left}
    assert len(reasons) == len(bad) + 1
    for name, path in bad.items():
        assert lines[name] in reasons[str(path)] and "\n" not in reasons[str(path)], name
    assert any("participant good has answered before" in reason for reason in reasons.values())


SCALARS = st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=5)
JSON = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner))


def test_whatever_is_put_into_a_file_is_refused_in_one_line(make_study, tmp_path):
    _, study = make_study()
    whole, path = answered(study, "p", lambda c, q: 3), tmp_path / "file.json"

    @settings(max_examples=40, deadline=None)
    @given(st.sampled_from(["study", "participant", "answers", 0, "kind", "stimuli", "values", "ms", "expected"]), JSON)
    def check(place, value):
        file = json.loads(json.dumps(whole))
        if place == 0 or place not in file:
            file["answers"][-1] = value if place == 0 else file["answers"][-1] | {place: value}
        else:
            file[place] = value
        path.write_text(json.dumps(file | {"checksum": checksum(file)}))
        try:
            read_file(study, path)
        except CospeechError as error:
            assert "\n" not in str(error) and str(error).startswith(f"{path}: ")
        else:
            assert value in (3, 2, "p", True) or CODE.fullmatch(str(value)) or value == whole.get(place)

    check()


def test_nothing_to_analyse_and_broken_studies_are_said(make_study, answer, tmp_path):
    folder, study = make_study()
    path = answer(study, "p", lambda c, q: 3, changed={"study": "x"})
    with pytest.warns(CospeechNotice), pytest.raises(CospeechError, match="no answers to analyse; 1 files"):
        analyse(folder, [path])
    for content, line in (
        ("{}", "no study of version 1"),
        ("", "not whole JSON"),
        (json.dumps({"schema": "cospeech.study", "version": 1}), "has no checks"),
    ):
        (folder / "study.json").write_text(content)
        with pytest.raises(CospeechError, match=line):
            analyse(folder, [path])
    with pytest.raises(CospeechError, match="cannot be read"):
        analyse(tmp_path / "nowhere", [path])


def test_the_command_writes_beside_the_study(make_study, answer, tmp_path, capsys):
    folder, study = make_study()
    answer(study, "p", lambda c, q: STARS[c])
    parser = argparse.ArgumentParser()
    command.add(parser.add_subparsers())
    options = parser.parse_args(["study", "analyse", str(folder), str(tmp_path / "answers")])
    options.run(options)
    assert (
        tmp_path / "study_results" / "results.html"
    ).is_file() and "1 participants, 0 left out" in capsys.readouterr().out
