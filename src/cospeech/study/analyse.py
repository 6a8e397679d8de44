"""From a study and its answers to tables, plots and a page."""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

import numpy as np

from cospeech.clip import put_strings
from cospeech.errors import CospeechError, notice
from cospeech.files import put, writing_hdf5
from cospeech.formats.result_table import write_table
from cospeech.study.answers import read_answers, read_study
from cospeech.study.statistics import Comparison, Line, Strength, compare, strengths, summarise, tests

SCHEMA = "cospeech.study_results"
POINTS = {"first": 1.0, "same": 0.5, "second": 0.0}  # of the first clip of a pair


@dataclass
class Results:
    """What a study has found: its description, one row an answer, what was left out, and the tables.

    answers : [(participant, condition, track, question, value)]; of pairs [(participant, first, second, track,
    question, choice)].
    """

    study: dict
    participants: list
    answers: list
    left: list
    table: list
    comparisons: list
    notes: list = field(default_factory=list)

    @property
    def pairs(self):
        return self.study["kind"] == "pairs"


def analyse(folder, paths, failures=0, seed=0):
    """Results of the study in `folder` and the files (or folders) of answers `paths`.

    failures : attention checks a participant may fail. seed : of the bootstrap.

    What cannot be counted gets a notice each; CospeechError if nothing is left.
    """
    study = read_study(folder)
    counted, left = read_answers(study, paths, failures)
    for one in left:
        notice(f"{one.path}: left out: {one.reason}")
    if not counted:
        raise CospeechError(f"{folder}: no answers to analyse; {len(left)} files were left out")
    judge = _judge_pairs if study["kind"] == "pairs" else _judge_ratings
    return judge(study, counted, left, seed)


def _judge_ratings(study, counted, left, seed):
    known = {one["id"]: one for one in study["stimuli"]}
    rows = [
        (a.participant, known[item["stimuli"][0]]["condition"], known[item["stimuli"][0]]["track"], key, value)
        for a in counted
        for item in a.items
        if item["kind"] == "rating"
        for key, value in item["values"].items()
    ]
    table, comparisons = [], []
    for question in study["questions"]:
        given = {condition: {} for condition in study["conditions"]}
        for participant, condition, _, key, value in rows:
            if key == question:
                given[condition].setdefault(participant, []).append(value)
        table += summarise(given, question, study["conditions"])
        means = {c: {p: float(np.mean(v)) for p, v in people.items()} for c, people in given.items()}
        comparisons += compare(means, question, study["conditions"])
    return Results(study, [a.participant for a in counted], rows, left, table, comparisons)


def _judge_pairs(study, counted, left, seed):
    known = {one["id"]: one for one in study["stimuli"]}
    rows = []
    for a in counted:
        for item in (item for item in a.items if item["kind"] == "pair"):
            first, second = (known[one] for one in item["stimuli"])
            rows += [
                (a.participant, first["condition"], second["condition"], first["track"], key, value)
                for key, value in item["values"].items()
            ]
    results = Results(study, [a.participant for a in counted], rows, left, [], [])
    names = study["conditions"]
    place = {name: i for i, name in enumerate(names)}
    people = {a.participant: i for i, a in enumerate(counted)}
    for question in study["questions"]:
        duels = np.zeros((len(counted), len(names), len(names)))
        for participant, first, second, _, key, value in rows:
            if key == question:
                duels[people[participant], place[first], place[second]] += POINTS[value]
                duels[people[participant], place[second], place[first]] += 1 - POINTS[value]
        found, finite = strengths(duels, question, names, seed)
        results.table += found
        if not finite:
            results.notes.append(
                f"{question}: a method has won, or lost, against all others, so that its strength has no finite "
                "estimate; a draw was added between every two methods"
            )
        shares = duels - np.swapaxes(duels, 1, 2)
        results.comparisons += tests(
            [(a, b, shares[:, i, j]) for i, a in enumerate(names) for j, b in enumerate(names) if i < j], question
        )
    return results


# ------------------------------------------------------------------------------------------------------------- files


def write_results(folder, results):
    """Write answers.csv, table.csv, comparisons.csv, left_out.csv, study.h5, one PNG a question and results.html.

    `table.csv` is the counterpart of what people said in the thesis (Tables 4.1, 4.2, 5.2 and 5.4), in IVA 2021
    (Tables 1 and 2) and in HA2G (Table 2).
    """
    from cospeech.study.page import write_page
    from cospeech.study.plots import plot_question

    folder, pairs = Path(folder), results.pairs
    head = (
        ["participant", "first", "second", "track", "question", "choice"]
        if pairs
        else ["participant", "condition", "track", "question", "value"]
    )
    kind = Strength if pairs else Line
    write_table(folder / "answers.csv", head, results.answers)
    write_table(folder / "table.csv", [f.name for f in fields(kind)], [asdict(r).values() for r in results.table])
    write_table(
        folder / "comparisons.csv",
        [f.name for f in fields(Comparison)],
        [asdict(row).values() for row in results.comparisons],
    )
    write_table(
        folder / "left_out.csv",
        ["file", "participant", "reason"],
        [(one.path, one.participant, one.reason) for one in results.left],
    )
    study = results.study
    with writing_hdf5(
        folder / "study.h5",
        SCHEMA,
        study=study["id"],
        title=study["title"],
        kind=study["kind"],
        participants=len(results.participants),
    ) as file:
        _put_table(file.create_group("answers"), head, results.answers)
        for name, row, rows in (("table", kind, results.table), ("comparisons", Comparison, results.comparisons)):
            _put_table(file.create_group(name), [f.name for f in fields(row)], [asdict(r).values() for r in rows])
        _put_table(
            file.create_group("left_out"),
            ["file", "participant", "reason"],
            [(one.path, one.participant, one.reason) for one in results.left],
        )
    plots = []
    for question in study["questions"]:
        plot_question(folder / f"{question}.png", results, question)
        plots.append(folder / f"{question}.png")
    write_page(folder / "results.html", results, plots)


def _put_table(group, head, rows):
    """Columns of a table as datasets: texts as UTF-8, numbers as they are."""
    columns = list(zip(*rows, strict=True)) or [()] * len(head)
    for name, column in zip(head, columns, strict=True):
        if all(isinstance(value, str) for value in column):
            put_strings(group, name, column)
        else:
            put(group, name, np.array(column))
