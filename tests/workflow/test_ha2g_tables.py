"""HA2G's tables as the workflow plans them: which rows are trained, spoken and judged, and how often."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def planned(snakemake, tmp_path_factory):
    """Function of targets and configuration: {rule: jobs} of a dry run with HA2G's configuration and no results yet."""
    results = tmp_path_factory.mktemp("plan") / "results"

    def plan(*targets, ensemble=""):
        own = results.with_name("own.yaml")
        own.write_text(f"results_dir: {results}\nmodels: [regression, knn]\n{ensemble}")
        asked = ["--configfile", "config/ha2g.yaml", str(own)]
        done = snakemake(ROOT, "--dry-run", "--cores", "1", "--nolock", *asked, "--", *targets)
        assert done.returncode == 0, done.stdout
        table = done.stdout.split("Job stats:")[1].split("total")[0]
        return {name: int(count) for name, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)}

    return plan


def test_table_1_judges_every_network_of_all_speakers_and_the_models_of_single_ones(planned):
    jobs = planned("ha2g_table_1")
    assert jobs["train_shared"] == jobs["synthesize_shared"] == 5
    assert jobs["evaluate_ha2g"] == 1 + 5 + 2  # what needs no model, the networks, regression and knn
    assert (jobs["train_ha2g_feature_net"], jobs["ha2g_table"], jobs["ha2g_metrics"]) == (4, 1, 1)


def test_seeds_multiply_trainings_and_not_rows(planned):
    jobs = planned("ha2g_table_1", ensemble="ensemble: {models: [ha2g, trimodal], seeds: [3, 5, 8]}")
    assert jobs["train_shared"] == jobs["synthesize_shared"] == 2 * 3
    assert jobs["evaluate_ha2g"] == 1 + 2 + 2


def test_ablations_train_each_row_once_and_the_whole_network_once(planned):
    jobs = planned("ha2g_ablations")
    assert jobs["train_shared"] == 12 + 1 and jobs["evaluate_ha2g"] == 1 + 12 + 1
    assert jobs["ha2g_table"] == 2 and "train_model" not in jobs
