"""The tables of chapter 4: which networks each of them trains, and MoGlow's control variants as models."""

import re

import pytest


def jobs(output):
    """{rule: count} of a dry run's table."""
    table = output.split("Job stats:")[1].split("\n\n")[0]
    return {name: int(count) for name, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)}


@pytest.fixture
def planned(snakemake, project):
    """Jobs of a dry run of targets with these lines added to the tiny configuration."""

    def run(*targets, more="", models=None):
        config = (project / "config.yaml").read_text()
        if models:
            config = re.sub(r"models: .*", f"models: [{', '.join(models)}]", config)
        (project / "config.yaml").write_text(config + more)
        done = snakemake(project, "--configfile", "config.yaml", "--dry-run", "--cores", "1", "--", *targets)
        assert done.returncode == 0, done.stdout
        return jobs(done.stdout)

    return run


def test_every_table_trains_its_rows_with_every_seed(planned):
    found = planned("chapter4", more="chapter4: {seeds: [3, 4]}\n")
    expected = {"train_seeded": 9 * 2, "train_sync_classifier": 3 * 2, "compare_seeded": 3, "compare_table": 3}
    assert found.items() >= (expected | {"lip_error": 1, "lip_table": 1, "sync_table": 1}).items()


def test_one_table_needs_its_own_rows_alone(planned):
    found = planned("out/tables/ablation.csv", more="chapter4: {seeds: [0]}\n")
    assert (found["train_seeded"], found["train_sync_classifier"], found["compare_seeded"]) == (4, 1, 1)
    assert "lip_table" not in found


def test_control_variants_join_table_5_3_and_random_needs_no_training(planned):
    variants = ["moglow_height", "moglow_speed", "moglow_symmetry"]
    found = planned("control_tables", models=["knn", "random", *variants])
    assert found["train_model"] == 3 and found["control_error"] == 1
    assert "train_model" not in planned("control_tables", models=["knn", "random"])
