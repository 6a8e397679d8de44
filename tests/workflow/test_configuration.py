"""Config, subject and budget files: what is accepted, and the one line that each mistake gets."""

import re
from dataclasses import fields

import pytest
import yaml
from configuration import check, read_configuration, read_subject, read_yaml

from cospeech.errors import CospeechError
from cospeech.learning.settings import settings_of
from tests.workflow.conftest import ROOT

SCHEMAS = ROOT / "workflow" / "schemas"
TAKE = {"id": "a", "motion": "a.bvh", "audio": "a.wav"}
OF_FILMS = {"tracker", "manifest", "model", "folder", "body_model", "face_model"}  # keys of speakers on film
MOCAP = {"kind": "mocap", "skeleton": "zeggs"}


@pytest.fixture
def here(project, monkeypatch):
    monkeypatch.chdir(project)
    for name in ("a.bvh", "a.wav", "talk.wav"):
        (project / name).touch()
    return project


def complaint(config, **changes):
    """The message about the tiny configuration with these changes."""
    with pytest.raises(CospeechError) as error:
        read_configuration(read_yaml(config) | changes, config, ROOT)
    assert "\n" not in str(error.value)
    return str(error.value)


def subject_complaint(content):
    """The message about a subject file of this content."""
    with open("bad.yaml", "w", encoding="utf-8") as file:
        yaml.safe_dump(content, file)
    with pytest.raises(CospeechError) as error:
        read_subject("bad.yaml")
    assert "\n" not in str(error.value) and str(error.value).startswith("bad.yaml: ")
    return str(error.value)


def test_default_configuration_has_both_demo_speakers():
    subjects, budget = read_configuration(read_yaml(ROOT / "config/config.yaml"), "config/config.yaml", ROOT)
    assert list(subjects) == ["calm", "lively"]
    assert budget["threads"] >= 1
    for subject in subjects.values():
        parts = [subject.takes_of(part) for part in ("train", "val", "test")]
        assert [len(takes) for takes in parts] == [16, 1, 3]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"modles": ["knn"]}, ["config.yaml", "modles", "models"]),
        ({"models": ["knn", "foo"]}, ["models[1]", "foo", "gesture_gan"]),
        ({"models": []}, ["models", "empty"]),
        ({"subjects": []}, ["subjects", "empty"]),
        ({"subjects": ["../x"]}, ["subjects", "../x", "calm"]),
        ({"subjects": ["nowhere.yaml"]}, ["nowhere.yaml", "no such file"]),
        ({"subjects": ["subject.yaml", "./subject.yaml"]}, ["subject.yaml", "tiny", "taken"]),
        ({"budget": "nix"}, ["budget", "nix", "demo"]),
        ({"fps": "15"}, ["fps", "15"]),
        ({"fps": 0}, ["fps"]),
        ({"seed": -1}, ["seed"]),
        ({"fps": "fast"}, ["fps", "'fast'", "a number"]),
        ({"results_dir": 5}, ["results_dir", "'5'", "quotes"]),
        ({"results_dir": "out{x}"}, ["results_dir", "out{x}", "braces"]),
        ({"subjects": None}, ["subjects", "a list"]),
    ],
)
def test_mistakes_in_the_config(here, changes, words):
    message = complaint("config.yaml", **changes)
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"subject": "nobody"}, ["nobody", "tiny"]),
        ({"model": "resync"}, ["resync", "regression"]),
        ({"audio": "gone.wav"}, ["gone.wav", "no such file"]),
        ({"name": "../talk"}, ["../talk"]),
        ({"name": "take01"}, ["take01", "taken"]),
        ({"k": 2}, ["k", "regression"]),
        ({"speed": 2}, ["synthesis[0]", "speed"]),
    ],
)
def test_mistakes_in_synthesis_entries(here, change, words):
    entry = {"name": "talk", "subject": "tiny", "audio": "talk.wav", "model": "regression"}
    read_configuration(read_yaml("config.yaml") | {"synthesis": [entry]}, "config.yaml", ROOT)
    message = complaint("config.yaml", synthesis=[entry | change])
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "../x"}, ["name", "../x"]),
        ({"name": "a\n"}, ["name"]),
        ({"source": {"kind": "tape"}}, ["source.kind", "tape", "mocap"]),
        ({"source": MOCAP | {"takes": []}}, ["source.takes", "empty"]),
        ({"source": MOCAP | {"takes": [TAKE | {"strat": 1.0}]}}, ["takes[0]", "strat", "start"]),
        ({"source": MOCAP | {"takes": [TAKE | {"part": "dev"}]}}, ["part", "dev", "val"]),
        ({"source": MOCAP | {"takes": [TAKE | {"motion": "b.bvh"}]}}, ["'a'", "motion", "b.bvh", "no such file"]),
        ({"source": MOCAP | {"takes": [TAKE, TAKE]}}, ["'a'", "twice"]),
        ({"source": MOCAP | {"takes": [TAKE | {"start": 5, "end": 5}]}}, ["'a'", "start"]),
        ({"source": MOCAP | {"takes": [{"id": "a", "motion": "a.bvh"}]}}, ["audio", "missing"]),
        ({"source": MOCAP | {"takes": [TAKE | {"part": "train"}]}}, ["test", "empty"]),
        ({"source": {"kind": "demo", "speaker": "calm", "minutes": 0, "takes": 2}}, ["minutes"]),
        ({"split": {"train": 0.8, "vla": 0.1}}, ["split", "vla", "val"]),
        ({"name": 12}, ["name", "'12'", "quotes"]),
        ({"source": MOCAP | {"takes": [TAKE | {"id": False}]}}, ["takes[0].id", "no", "quotes"]),
        ({"source": MOCAP | {"takes": [TAKE | {"start": "1:30"}]}}, ["takes[0].start", "'1:30'", "seconds"]),
        ({"source": MOCAP | {"takes": [TAKE | {"motion": "a{b}.bvh"}]}}, ["takes[0].motion", "a{b}.bvh", "braces"]),
        ({"source": MOCAP | {"takes": [TAKE | {"audio": "C:\new.wav"}]}}, ["takes[0].audio", "single quotes"]),
        ({"source": {"kind": "demo", "speaker": "calm", "minutes": 1, "takes": 1e12}}, ["takes", "maximum"]),
    ],
)
def test_mistakes_in_a_subject_file(here, change, words):
    good = {"name": "x", "source": MOCAP | {"takes": [TAKE]}}
    message = subject_complaint(good | change)
    assert all(word in message for word in words), message


def test_braces_in_a_list_of_films_and_in_a_synthesis(here):
    (here / "a{b}.mp4").touch()
    (here / "films.csv").write_text("id,video\nmonday,a{b}.mp4\n")
    message = subject_complaint({"name": "x", "source": {"kind": "video", "manifest": "films.csv"}})
    assert all(word in message for word in ("'monday'", "a{b}.mp4", "braces"))
    (here / "a{b}.wav").touch()
    entry = {"name": "talk", "subject": "tiny", "audio": "a{b}.wav", "model": "regression"}
    assert "'talk': audio: a{b}.wav: Snakemake takes braces" in complaint("config.yaml", synthesis=[entry])


@pytest.mark.parametrize("text", ["- a\n- b\n", "name: [\n", "\x00", "name: 013\n", "name: a\nname: b\n"])
def test_a_file_that_is_no_mapping_is_named(here, text):
    (here / "bad.yaml").write_text(text)
    with pytest.raises(CospeechError, match=r"^bad\.yaml: .*$"):
        read_subject("bad.yaml")


def test_parts_are_known_before_any_recording_is_read(here):
    takes = [TAKE | {"id": "a", "part": "train"}, TAKE | {"id": "b", "part": "test"}]
    (here / "two.yaml").write_text(yaml.safe_dump({"name": "x", "source": MOCAP | {"takes": takes}}))
    subject = read_subject("two.yaml")
    assert subject.takes_of("train") == ["a"] and subject.takes_of("test") == ["b"]
    assert subject.parts == {"a": "train", "b": "test"}
    single = {"name": "x", "source": MOCAP | {"takes": [TAKE]}, "split": {"by": "time"}}
    (here / "one.yaml").write_text(yaml.safe_dump(single))
    subject = read_subject("one.yaml")
    assert subject.takes_of("train") == subject.takes_of("test") == ["a"]
    assert subject.parts == {"a": None}


def test_every_key_of_films_is_explained():
    text = (ROOT / "docs" / "capture.md").read_text()
    assert all(f"{key}:" in text for key in OF_FILMS)
    assert read_yaml(SCHEMAS / "subject.schema.yaml")["properties"].keys() >= OF_FILMS


def test_every_key_is_in_the_default_files_and_commented():
    for file, schema in (("config.yaml", "config"), ("subjects/calm.yaml", "subject"), ("budgets/demo.yaml", "budget")):
        text = (ROOT / "config" / file).read_text()
        known = read_yaml(SCHEMAS / f"{schema}.schema.yaml")["properties"].keys() - OF_FILMS
        assert set(yaml.safe_load(text)) - OF_FILMS == set(known)
        for key in known:
            assert re.search(rf"^# .*\n{key}:|^\n{key}:\n  # ", text, re.MULTILINE), f"{file}: {key} has no comment"


def test_budget_keys_are_the_trainings_settings():
    from cospeech.evaluation.metrics.fgd import Settings as FeatureNet
    from cospeech.evaluation.metrics.sync_classifier import Settings as Sync
    from cospeech.gestures.chapter4.gesture_gan import Settings as Gesture
    from cospeech.gestures.chapter4.lstm import Settings as LSTM
    from cospeech.gestures.chapter4.moglow import Settings as MoGlow
    from cospeech.matching.resync.gan import Settings as Resync

    schema = read_yaml(SCHEMAS / "budget.schema.yaml")
    sections = {"lstm": LSTM, "moglow": MoGlow, "resync": Resync, "feature_net": FeatureNet, "sync_classifier": Sync}
    of_the_rule = {"sync_classifier": {"frames"}}  # its three window lengths are Table 4.4's
    known = {name: schema["properties"][name]["properties"] for name in sections}
    for name, settings in {**sections, "gesture_gan": Gesture}.items():
        keys = set(known.get(name) or schema["$defs"]["gesture_gan"]["properties"])
        assert keys == {field.name for field in fields(settings)} - of_the_rule.get(name, set())


def test_paper_budget_holds_the_published_values():
    from cospeech.gestures.chapter4.gesture_gan import Settings as Gesture
    from cospeech.gestures.chapter4.lstm import Settings as LSTM
    from cospeech.gestures.chapter4.moglow import Settings as MoGlow
    from cospeech.matching.resync.gan import Settings as Resync

    paper = read_yaml(ROOT / "config/budgets/paper.yaml")
    check(paper, "budget", "paper.yaml")
    for name, settings in {
        "regression": Gesture,
        "gesture_gan": Gesture,
        "lstm": LSTM,
        "moglow": MoGlow,
        "resync": Resync,
    }.items():
        assert paper[name] and settings_of(settings(), paper[name], name) == settings()
