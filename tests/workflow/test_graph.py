"""What a run would do: the jobs of a dry run, targets, and what makes a rule run again."""

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from digest import library_code, library_files

from tests.test_yaml import LAUGHS
from tests.workflow.conftest import ROOT


def jobs(output):
    """{rule: count} of a dry run's table."""
    table = output.split("Job stats:")[1].split("\n\n")[0]
    return {name: int(count) for name, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)}


def test_default_run_covers_every_stage_of_both_speakers(snakemake):
    done = snakemake(ROOT, "--dry-run", "--cores", "2", "--forceall", "--nolock")
    assert done.returncode == 0, done.stdout
    assert jobs(done.stdout) == {
        "demo_take": 40,
        "annotate_demo": 40,
        "split_clips": 2,
        "build_database": 2,
        "train_model": 6,
        "train_feature_net": 2,
        "cut_truth": 6,
        "synthesize": 30,
        "export": 36,
        "render": 36,
        "evaluate": 2,
        "train_audio_rank": 2,
        "control_error": 2,
        "control_variants": 2,
        "write_control_tables": 1,
        "lip_error": 2,
        "lip_table": 1,
        "make_people": 3,
        "train_posenet": 3,
        "export_posenet": 3,
        "evaluate_posenet": 3,
        "film_take": 8,
        "take_sound": 8,
        "track_posenet": 8,
        "speaker_bones": 2,
        "annotate_video": 8,
        "judge_annotation": 1,
        "list_takes": 1,
        "summarize": 1,
        "measure_motion": 2,
        "motion_table": 1,
        "write_report": 1,
        "all": 1,
        "total": 266,
    }


@pytest.mark.parametrize(
    ("target", "rule", "count"),
    [("clips", "annotate_demo", 2), ("models", "train_model", 1), ("evaluation", "summarize", 1)],
)
def test_stages_are_targets(snakemake, project, target, rule, count):
    done = snakemake(project, "--configfile", "config.yaml", "--dry-run", "--cores", "1", target)
    assert jobs(done.stdout)[rule] == count
    assert "write_report" not in jobs(done.stdout)


def test_a_mistake_ends_the_run_with_one_line_before_any_job(snakemake, project):
    done = snakemake(project, "--configfile", "config.yaml", "--cores", "1", "--config", "modles=[knn]")
    assert done.returncode == 2
    assert done.stdout.splitlines()[-1].startswith("error: config.yaml: unknown key 'modles'")
    assert "Traceback" not in done.stdout and not (project / "out").exists()


@pytest.mark.parametrize("text", [LAUGHS, "results_dir: a\nresults_dir: b\n", "fps: 1:30\n", 'results_dir: "a{b}"\n'])
def test_what_yaml_would_make_of_a_configuration_is_told_before_it_is_used(snakemake, project, text):
    (project / "my.yaml").write_text(text)
    done = snakemake(project, "--dry-run", "--cores", "1", "--configfile", "config.yaml", "my.yaml")
    assert done.returncode == 2 and "Traceback" not in done.stdout
    assert done.stdout.splitlines()[-1].startswith("error: ") and "my.yaml" in done.stdout.splitlines()[-1]


@pytest.mark.parametrize("arguments", [(), ("--configfile", "my.yaml")])
def test_started_elsewhere_the_workflow_says_where_its_configuration_lies(snakemake, tmp_path, arguments):
    (tmp_path / "my.yaml").write_text("subjects: [lively]\nresults_dir: out\nposenet: {parts: []}\n")
    done = snakemake(tmp_path, "--dry-run", "--cores", "1", *arguments)
    assert done.returncode == 2
    line = done.stdout.splitlines()[-1]
    default = f"--configfile {ROOT}/config/config.yaml my.yaml"
    assert line.startswith("error: ") and line.endswith(default) and "Traceback" not in done.stdout
    assert f"config/config.yaml was not found in {tmp_path}; start snakemake in {ROOT}" in line
    done = snakemake(tmp_path, "--dry-run", "--cores", "1", "clips", *default.split())  # which helps
    assert done.returncode == 0 and jobs(done.stdout)["annotate_demo"] == 20, done.stdout


def test_scripts_are_short():
    scripts = list((ROOT / "workflow" / "scripts").glob("*.py"))
    rules = "".join(path.read_text() for path in (ROOT / "workflow" / "rules").glob("*.smk"))
    assert len(scripts) > 10
    for script in scripts:
        helper = script.stem in ("job", "tee", "sections", "speakers")
        assert len(script.read_text().splitlines()) < 40, f"{script.name} is long"
        assert helper or f'script:\n        "../scripts/{script.name}"' in rules, f"no rule runs {script.name}"
        assert helper or f'library_code("{script.name}")' in rules, f"edits of what {script.name} uses go unseen"


def test_a_rule_sees_the_library_code_that_it_runs_and_no_other():
    names = {path.name for path in library_files("export.py")}
    assert {"export.py", "bvh.py", "glb.py", "clip.py", "errors.py", "job.py", "upper55.yaml"} <= names
    assert not {"training.py", "voice.py", "report.py"} & names
    assert {path.suffix for path in library_files("render.py")} <= {".py", ".yaml", ".html", ".js", ".txt"}  # no caches
    assert "training.py" in {path.name for path in library_files("train.py")}
    assert library_code("export.py") == library_code("export.py") != library_code("train.py")


def test_the_digest_is_the_same_wherever_project_and_library_lie(tmp_path):
    digests = []
    for library, project in (("a/site-packages", "b/talks"), ("b/site-packages", "a/talks")):
        shutil.copytree(ROOT / "src/cospeech", tmp_path / library / "cospeech")
        shutil.copytree(ROOT / "workflow", tmp_path / project / "workflow")
        code = "import digest; print(digest.library_code('export.py'), *digest.library_files('export.py'))"
        paths = f"{tmp_path / library}{os.pathsep}{tmp_path / project / 'workflow'}"
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env={"PYTHONPATH": paths}, capture_output=True, text=True, check=True)
        digest, *files = done.stdout.split()
        assert all(file.startswith(str(tmp_path)) for file in files)
        digests.append(digest)
    assert digests[0] == digests[1]


def test_pins_cover_every_dependency_and_name_no_machine():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = project["dependencies"] + extras["test"] + extras["lint"]
    normal = lambda text: re.match(r"[\w.-]+", text)[0].lower().replace("_", "-")
    lines = [line for line in (ROOT / "envs/requirements.txt").read_text().splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==[\w.!]+", line) for line in lines)
    assert {normal(name) for name in wanted} <= {normal(line) for line in lines}
