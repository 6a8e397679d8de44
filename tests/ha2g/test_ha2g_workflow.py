"""HA2G in the workflow: what a run would do, which takes and speakers go where, and one line for each mistake."""

import re
import sys
from dataclasses import fields

import pytest
import yaml

from cospeech.errors import CospeechError
from tests.workflow.conftest import ROOT, snakemake  # noqa: F401 - a fixture

sys.path.insert(0, str(ROOT / "workflow"))

from configuration import SCHEMAS, check, read_configuration, read_yaml


def merged(**changes):
    """config.yaml with ha2g.yaml over it and these keys of the ensemble changed."""
    config = read_yaml(ROOT / "config/config.yaml") | read_yaml(ROOT / "config/ha2g.yaml")
    config["ensemble"] |= changes
    return config


def test_the_ensemble_file_is_accepted_and_every_key_commented():
    config = merged()
    read_configuration(config, "config/ha2g.yaml", ROOT)
    text = (ROOT / "config/ha2g.yaml").read_text()
    known = read_yaml(SCHEMAS / "config.schema.yaml")["properties"]["ensemble"]["properties"]
    assert set(config["ensemble"]) == set(known)
    for key in known:
        assert re.search(rf"^  # .*\n  {key}:", text, re.MULTILINE), f"{key} has no comment"


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"name": "calm"}, "name 'calm' is a subject's"),
        ({"speakers": ["calm", "ada"]}, "ensemble.speakers: 'ada' is not one of calm, lively"),
        ({"held_out": ["ada"]}, "ensemble.held_out: 'ada' is not one of calm, lively"),
        ({"held_out": ["calm", "lively"]}, "all speakers are held out"),
        ({"embeddings": "nowhere.vec"}, "ensemble.embeddings: nowhere.vec: no such file"),
        ({"models": ["ha2f"]}, "'ha2f' is not one of ha2g, trimodal"),
        ({"seeds": []}, "ensemble.seeds: the list is empty"),
        ({"levles": "ted10"}, "unknown key 'levles'; did you mean 'levels'"),
        ({"identity": "face"}, "'face' is not one of speaker, frames"),
        ({"imagenet": "resnet18.pth"}, "ensemble.imagenet: is for identity: frames alone"),
        ({"identity": "frames", "imagenet": "nowhere.pth"}, "ensemble.imagenet: nowhere.pth: no such file"),
    ],
)
def test_a_mistake_is_one_line(changes, line):
    with pytest.raises(CospeechError, match=re.escape(line)) as error:
        read_configuration(merged(**changes), "my.yaml", ROOT)
    assert str(error.value).startswith("my.yaml: ") and "\n" not in str(error.value)


SPEAKER_WITHOUT_FILM = {
    "no film": {"kind": "demo", "speaker": "calm", "minutes": 1, "takes": 4},
    "no filmed take in the training part": {"kind": "demo", "speaker": "calm", "minutes": 1, "takes": 8}
    | {"film": {"domain": "studio", "takes": 2}},
}


@pytest.mark.parametrize("lacks", SPEAKER_WITHOUT_FILM)
def test_who_has_no_film_is_named_with_the_remedy(lacks, tmp_path):
    """Known by frames all speakers must be; known by number none needs a film."""
    content = {"name": "ada", "source": SPEAKER_WITHOUT_FILM[lacks], "split": {"train": 0.25, "val": 0, "test": 0.75}}
    (tmp_path / "ada.yaml").write_text(yaml.safe_dump(content))
    config = merged(speakers=["calm", "ada"]) | {"subjects": ["calm", str(tmp_path / "ada.yaml")], "seed": 6}
    read_configuration(config, "my.yaml", ROOT)
    config["ensemble"]["identity"] = "frames"
    with pytest.raises(CospeechError) as error:
        read_configuration(config, "my.yaml", ROOT)
    assert str(error.value) == (
        f"my.yaml: ensemble.identity: frames: speaker 'ada' (kind: demo) has {lacks}; give one, leave 'ada' out of "
        "speakers, or set identity: speaker"
    )


def test_other_frame_rates_are_refused():
    with pytest.raises(CospeechError, match=r"fps: 30: .* for 15 fps"):
        read_configuration(merged() | {"fps": 30}, "my.yaml", ROOT)


def test_budget_sections_have_the_trainings_keys():
    from cospeech.gestures.ha2g import hierarchy, joint_embedding, seq2seq, speech2gesture, trimodal
    from cospeech.gestures.ha2g.dataset.filters import Filters

    budget = read_yaml(SCHEMAS / "budget.schema.yaml")
    sections = {
        "trimodal": trimodal,
        "seq2seq": seq2seq,
        "speech2gesture": speech2gesture,
        "joint_embedding": joint_embedding,
    }
    sections |= {"ha2g": hierarchy}
    known = {name: budget["properties"][name]["properties"] for name in sections}
    for name, module in sections.items():
        assert set(known[name]) == {field.name for field in fields(module.Settings)}, name
        if "weights" in known[name]:
            assert set(known[name]["weights"]["properties"]) == set(module.Settings().weights), name
    config = read_yaml(SCHEMAS / "config.schema.yaml")["properties"]["ensemble"]["properties"]
    assert set(config["filters"]["properties"]) == {field.name for field in fields(Filters)}
    check(read_yaml(ROOT / "config/budgets/paper.yaml"), "budget", "paper.yaml")


def test_training_opens_no_take_of_another_part_and_no_speaker_who_is_held_out(snakemake, tmp_path):  # noqa: F811
    """The input of the one job that makes the training material, as a dry run lists it."""
    own = tmp_path / "own.yaml"
    own.write_text(yaml.safe_dump({"ensemble": merged(held_out=["lively"])["ensemble"]}))
    arguments = ("--configfile", str(own), "--dry-run", "--cores", "2", "--forceall", "--nolock")
    done = snakemake(ROOT, *arguments)
    assert done.returncode == 0, done.stdout
    corpus = re.search(r"^rule collect_corpus:\n    input: (.*)$", done.stdout, re.MULTILINE)[1].split(", ")
    subjects, _ = read_configuration(merged(), "x", ROOT)
    trained = [f"results/calm/clips/{take}.h5" for take in subjects["calm"].takes_of("train")]
    assert corpus == ["results/calm/split.h5", *trained]
    spoken = re.findall(r"results/everyone/synthesis/ha2g_0/(\w+)/(\w+)\.h5", done.stdout)
    assert {clip for speaker, clip in spoken if speaker == "lively"} == set(subjects["lively"].takes_of("test"))
    assert not set(subjects["lively"].takes_of("test")) & set(subjects["lively"].takes_of("train"))
    counts = dict(re.findall(r"^(\w+) +(\d+)$", done.stdout, re.MULTILINE))
    assert counts["train_shared"] == counts["synthesize_shared"] == "5"
    assert "reference_frames" not in done.stdout and "export_identity" not in done.stdout


def test_reference_frames_are_of_training_takes_and_strangers_are_only_looked_at(snakemake, tmp_path):  # noqa: F811
    """Who is held out shows the finished networks a film, of takes that nothing is tested on; none is learned from."""
    own = tmp_path / "own.yaml"
    ensemble = merged(held_out=["lively"], identity="frames", models=["ha2g", "trimodal"], seeds=[0, 1])["ensemble"]
    own.write_text(yaml.safe_dump({"ensemble": ensemble}))
    arguments = ("--configfile", str(own), "--dry-run", "--cores", "2", "--forceall", "--nolock")
    done = snakemake(ROOT, *arguments)
    assert done.returncode == 0, done.stdout
    inputs = lambda rule: [
        set(line.split(", ")) for line in re.findall(rf"^rule {rule}:\n    input: (.*)$", done.stdout, re.MULTILINE)
    ]
    subjects, _ = read_configuration(merged(), "x", ROOT)
    for files in inputs("take_reference_frames"):
        (split,) = (file for file in files if file.endswith("split.h5"))
        name = split.split("/")[1]
        trained = [take for take in subjects[name].takes_of("train") if take in subjects[name].filmed]
        films = {f"results/{name}_on_film/media/{take}.mp4" for take in trained}
        assert trained and files == {split, *films, *(f"results/{name}_on_film/tracks/{take}.h5" for take in trained)}
    (corpus,) = inputs("collect_corpus")
    frames = {name: f"results/{name}/reference_frames.h5" for name in ("calm", "lively")}
    assert frames["calm"] in corpus and not any("lively" in file for file in corpus)
    shown = [file for file in inputs("synthesize_shared") if frames["lively"] in file]
    assert sorted(file for files in shown for file in files if "identity" in file) == [
        f"results/everyone/models/ha2g_{seed}/identity.onnx" for seed in (0, 1)
    ]
