"""The rules of the pose network: which jobs its targets and its configuration ask for."""

import re
import shutil
import sys
from dataclasses import asdict

import pytest
import yaml

from tests.workflow.conftest import ROOT, snakemake  # noqa: F401 (a fixture)

sys.path.insert(0, str(ROOT / "workflow"))
from configuration import check, read_configuration, read_yaml

from cospeech.errors import CospeechError
from cospeech.learning.settings import settings_of
from cospeech.posenet.training.stages import Settings


@pytest.fixture
def project(tmp_path):
    return shutil.copytree(ROOT / "tests/workflow/tiny", tmp_path / "project")


def test_targets_ask_for_every_part_and_for_every_row_of_the_ablation(snakemake, project):  # noqa: F811
    wanted = {"posenet": {"parts": ["body", "hand"], "seeds": [0, 1, 2]}}
    (project / "my.yaml").write_text(yaml.safe_dump(read_yaml(project / "config.yaml") | wanted))
    targets = ("posenet", "posenet_ablation")
    done = snakemake(project, *targets, "--configfile", "my.yaml", "--dry-run", "--cores", "2")
    assert done.returncode == 0, done.stdout
    counts = {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", done.stdout, re.MULTILINE)}
    stages = ("make_people", "train_posenet", "export_posenet", "evaluate_posenet")
    assert [counts[rule] for rule in stages] == [2, 2, 2, 2]
    assert counts["train_posenet_row"] == 12 and counts["table_3_6"] == 1


@pytest.mark.parametrize(
    ("posenet", "words"),
    [
        ({"parts": ["foot"]}, ["posenet.parts[0]", "foot", "face"]),
        ({"imagenet": "gone.pth"}, ["posenet.imagenet", "gone.pth", "no such file"]),
        ({"data": {"body": {"train": ["gone.h5"]}}}, ["posenet.data.body.train", "gone.h5", "no such file"]),
        ({"prats": []}, ["posenet", "prats", "parts"]),
    ],
)
def test_mistakes_in_the_configuration_name_key_and_file(project, monkeypatch, posenet, words):
    monkeypatch.chdir(project)
    with pytest.raises(CospeechError) as error:
        read_configuration(read_yaml("config.yaml") | {"posenet": posenet}, "config.yaml", ROOT)
    assert all(word in str(error.value) for word in words), error.value


def test_budgets_know_the_trainings_keys_and_the_published_values():
    schema = read_yaml(ROOT / "workflow/schemas/budget.schema.yaml")["$defs"]["posenet"]["properties"]
    assert set(schema) == set(asdict(Settings()))
    assert settings_of(Settings(), read_yaml(ROOT / "config/budgets/paper.yaml")["posenet"], "posenet") == Settings()
    for budget in ("demo", "paper"):
        check(read_yaml(ROOT / f"config/budgets/{budget}.yaml"), "budget", budget)
