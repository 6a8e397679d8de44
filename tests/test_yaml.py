"""YAML files: what is read, and the one line for what is damaged, malicious, or read by YAML as something else."""

import ast
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

import cospeech
from cospeech.cli import main
from cospeech.errors import CospeechError
from cospeech.files import read_yaml

ROOT = Path(__file__).parents[1]
LAUGHS = "a0: &a0 [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"a{n}: &a{n} [{','.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 9)
)


def complaint(path):
    with pytest.raises(CospeechError) as error:
        read_yaml(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value) and len(str(error.value)) < 500
    return str(error.value)


def test_every_file_of_the_project_is_read_as_it_was_written():
    files = [file for folder in ("src", "config", "workflow", "tests") for file in (ROOT / folder).rglob("*.yaml")]
    files = [file for file in files if "node_modules" not in file.parts]
    assert len(files) > 40
    for file in files:
        assert read_yaml(file) == yaml.safe_load(file.read_text("utf-8")), file


def test_plain_values_anchors_and_merges(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("a: &x {k: 1, l: [0x1F, -2.5, true, ~, '013']}\nb: {<<: *x, k: 2}\nc: *x\n", "utf-8")
    whole = {"k": 1, "l": [31, -2.5, True, None, "013"]}
    assert read_yaml(path) == read_yaml(str(path)) == {"a": whole, "b": whole | {"k": 2}, "c": whole}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("takes:\n  - id: 013", ["line 2", "013", "11", "quotes"]),
        ("start: 1:30", ["line 1", "1:30", "90", "write seconds"]),
        ("start: 1:30.5", ["1:30.5", "90.5", "write seconds"]),
        ("id: 2021-03-04", ["2021-03-04", "date", "quotes"]),
        ("id: 2021-03-04 10:00:00", ["date", "quotes"]),
        ('path: "C:\\Users\\me"', ["single quotes"]),
        ("a: 1\nb: 2\nb: 3", ["line 3", "'b'", "twice", "line 2"]),
        ("a: {b: 1, c: {d: 1,\n  d: 2}}", ["line 2", "'d'", "line 1"]),
        ("fps: .nan", [".nan", "number"]),
        ("fps: -.inf", ["-.inf", "number"]),
        ("seed: " + "9" * 5000, ["5000 digits", "18"]),
        ("seed: 0x" + "f" * 5000, ["digits"]),
        ("a: [1, 2", ["not valid YAML"]),
        ("a: &a [*a]", ["aliases"]),
        ("a: *b", ["undefined alias"]),
        ("a: !!python/object/apply:os.system [ls]", ["constructor"]),
        ("a: !!int x", ["not valid YAML"]),
        ("a: !!int ''", ["not valid YAML"]),
        ("a: !!bool x", ["not valid YAML"]),
        ("{[1]: 2}", ["unhashable"]),
        ("--- a\n--- b", ["single document"]),
        ("a: \x00", ["not valid YAML"]),
        (b"a: \xff", ["not valid YAML"]),
    ],
)
def test_one_line_with_place_and_remedy(tmp_path, text, words):
    path = tmp_path / "bad.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    message = complaint(path)
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (LAUGHS, "aliases"),
        ("[" * 3000 + "]" * 3000, "deep"),
        ("- " * 3000 + "a", "deep"),
        ("{a: " * 3000, "deep"),
        ("# " + "x" * 5_000_000, "larger than 4 MB"),
        ("[" + "0," * 600_000 + "]", "values"),
    ],
    ids=["laughs", "flow", "block", "mappings", "large", "many"],
)
def test_what_would_need_much_time_or_memory_is_refused_before(tmp_path, text, word):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    began = time.process_time()
    assert word in complaint(path)
    assert time.process_time() - began < 30


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    assert "cannot be read" in complaint(tmp_path / "none.yaml") and "cannot be read" in complaint(tmp_path)


@given(st.text(alphabet="a1:-{}[]&*!'\"\\ \n#.?|>%@,0~<", max_size=40))
@example("!!float ,")
@example("? ? ?")
def test_any_text_gives_a_value_or_one_line(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(text, "utf-8")
    try:
        read_yaml(path)
    except CospeechError as error:
        assert "\n" not in str(error)


def test_there_is_one_reader_of_yaml():
    for path in Path(cospeech.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            name = ast.unparse(node) if isinstance(node, ast.Attribute) else ""
            assert not (name.startswith("yaml.") and "load" in name.lower()) or path.name == "files.py", path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("fps: fast", ["fps", "'fast'", "a number"]),
        ("results_dir: 5", ["results_dir", "quotes"]),
        ("results_dir: [a]", ["results_dir", "text"]),
        ("subjects: null", ["subjects", "a list"]),
        ("modles: [knn]", ["modles", "models"]),
        ("results_dir: a\nresults_dir: b", ["twice"]),
        (LAUGHS, ["aliases"]),
    ],
)
def test_commands_check_their_configuration_as_the_workflow_does(tmp_path, capsys, text, words):
    (tmp_path / "my.yaml").write_text(text)
    options = ["--subject", "ada", "--model", "knn", "--audio", "talk.wav", "--out", str(tmp_path / "talk.bvh")]
    assert main(["generate", "--config", str(tmp_path / "my.yaml"), *options]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and all(word in lines[0] for word in ["my.yaml", *words]), lines
