"""What is generated from the trainings' keys: not stale, whole, and with the numbers that the publications print."""

from dataclasses import dataclass

import pytest
import yaml
from jsonschema import Draft202012Validator

from cospeech.errors import CospeechError
from cospeech.evaluation.metrics.sync_classifier import Settings as SyncSettings
from cospeech.gestures.chapter4.gesture_gan import Settings as GestureSettings
from cospeech.gestures.ha2g.hierarchy import Settings as HA2GSettings
from cospeech.learning.settings import (
    COUNT,
    LEFT_OUT,
    UNPUBLISHED,
    Section,
    key,
    keys_of,
    one_of,
    published,
    schema_of,
    settings_of,
    some_of,
)
from cospeech.matching.resync.gan import Settings as ResyncSettings
from tools import config

SECTIONS = config.sections()
PAPER = yaml.safe_load((config.ROOT / "config/budgets/paper.yaml").read_text())
# As printed: thesis 4.4 and 5.3.3 with its released code, 3.4.2; HA2G section 4.1 and its logs; reference section 5.
PRINTED = {
    "gesture_gan": {
        "steps": 300_000,
        "batch": 25,
        "frames": 64,
        "learning_rate": 5e-4,
        "weights": {"face": 0.37, "body": 600.0, "hands": 840.0, "adversarial": 5.0},
    },
    "resync": {
        "steps": 300_000,
        "batch": 100,
        "learning_rate": 1e-4,
        "weight_decay": 4e-5,
        "gradient_penalty": 100.0,
        "critic_iterations": 5,
        "fidelity": 0.1,
    },
    "lstm": {"hidden": 200, "layers": 1, "dropout": 0.1, "learning_rate": 1e-3},
    "moglow": {"hidden": 800, "flows": 10},
    "ha2g": {"learning_rate": 5e-4, "betas": (0.5, 0.999), "style": 18, "batch": 64, "epochs": 180.0},
    "posenet": {
        "pretraining": 186_000,
        "pretraining_batch": 21,
        "steps": 240_000,
        "batch": 10,
        "learning_rate": 0.05,
        "weights": {"heatmap": 0.1, "pose": 10.0, "bone_vector": 10.0, "bone_length": 100.0, "projection": 10.0},
    },
}


@dataclass(frozen=True)
class Toy(Section, section="toy"):
    """One key of each kind."""

    steps: int = key(10, "iterations", limits=COUNT, published=1000)
    rate: float = key(1e-5, "of Adam", "1/s")
    kind: str = key("plain", "of network", limits=one_of("plain", "odd"), published=LEFT_OUT)
    parts: tuple = key(("body",), "that are learnt", limits=some_of("body", "face", least=1))
    weights: dict = key({"near": 1.0, "far": 2.0}, "of terms", parts={"near": "close by", "far": "away"})
    trick: bool = key(False, "ours", published=UNPUBLISHED)
    frames: int = 64


# ---- what is committed -----------------------------------------------------------------------------------------------


def test_nothing_generated_is_stale():
    assert not config.stale(), "run `make config` and commit what it writes"


def test_a_stale_file_is_found_and_mended(tmp_path, monkeypatch):
    page = tmp_path / "docs" / "page.md"
    for path, text in (
        (page, "# Page\n\n<!-- generated: lstm -->\nold\n<!-- end -->\n\nprose\n"),
        (tmp_path / "workflow/schemas/budget.schema.yaml", config.schema()),
        (tmp_path / "config/budgets/paper.yaml", config.paper().replace("steps: 80000", "steps: 80001")),
    ):
        path.parent.mkdir(parents=True)
        path.write_text(text)
    monkeypatch.setattr(config, "ROOT", tmp_path)
    assert config.stale() == [tmp_path / "config/budgets/paper.yaml", page]
    text = config.generated()[page]
    assert text.startswith("# Page\n\n<!-- generated: lstm -->\n| key |") and text.endswith("<!-- end -->\n\nprose\n")
    assert "old" not in text and "| `hidden` | `200` |" in text and config.document(text) == text


def test_every_key_stands_in_one_table_of_the_documents():
    pages = "".join(path.read_text() for path in (config.ROOT / "docs").glob("*.md"))
    tables = [SECTIONS[name].settings for _, name, _ in config.MARKED.findall(pages)]
    kinds = [type(settings) for settings in tables]
    assert len(kinds) == len(set(kinds)) and set(kinds) == {type(section.settings) for section in SECTIONS.values()}


@pytest.mark.parametrize("name", SECTIONS)
def test_every_key_says_what_it_is(name):
    for own, its in keys_of(SECTIONS[name].settings).items():
        default = getattr(SECTIONS[name].settings, own)
        assert its.description and its.parts.keys() == (default if isinstance(default, dict) else {}).keys(), own


@pytest.mark.parametrize("name", PRINTED)
def test_paper_budget_has_the_printed_numbers(name):
    read = settings_of(SECTIONS[name].settings, PAPER[name], name)
    assert {own: getattr(read, own) for own in PRINTED[name]} == PRINTED[name]


def test_paper_budget_has_every_section_and_fits_the_schema():
    assert list(PAPER) == ["threads", *SECTIONS]
    schema = yaml.safe_load(config.schema())
    Draft202012Validator.check_schema(schema)
    Draft202012Validator(schema).validate(PAPER)


# ---- a toy's keys ----------------------------------------------------------------------------------------------------


def test_what_follows_from_a_key(monkeypatch):
    section = config.BudgetSection("A toy.", Toy(), {"odd": Toy(parts=("face",), weights={"near": 3.0, "far": 2.0})})
    monkeypatch.setattr(config, "sections", lambda: {"toy": section})
    assert config.paper().split("\n\n", 2)[2] == (
        "# A toy.\ntoy:\n  steps: 1000  # iterations\n  rate: 0.00001  # of Adam (1/s)\n"
        "  # kind: plain  # of network; one of plain, odd\n"
        "  # parts: [body]  # that are learnt; some of body, face; odd: [face]\n"
        "  weights:  # of terms\n    # near: 1.0  # close by; odd: 3.0\n    far: 2.0  # away\n"
        "  trick: false  # ours; not published\n"
    )
    assert config.table("toy").splitlines()[2:] == [
        "| `steps` | `1000`; default: `10` | iterations |",
        "| `rate` | `0.00001` | of Adam (1/s) |",
        "| `kind` | left out: `plain` | of network; one of plain, odd |",
        "| `parts` | `[body]`; odd: `[face]` | that are learnt; some of body, face |",
        "| `weights.near` | `1.0`; odd: `3.0` | close by |",
        "| `weights.far` | `2.0` | away |",
        "| `trick` | `false`; not published | ours |",
    ]
    assert "frames" not in schema_of(Toy())["properties"] and published(Toy())["steps"] == 1000


@pytest.mark.parametrize(
    ("value", "right"),
    [
        ({"steps": 1}, True),
        ({"steps": 0}, False),
        ({"steps": 1.5}, False),
        ({"rate": 1}, True),
        ({"kind": "odd"}, True),
        ({"kind": "new"}, False),
        ({"parts": []}, False),
        ({"parts": ["face", "foot"]}, False),
        ({"trick": 1}, False),
        ({"weights": {"far": 0}}, True),
        ({"weights": {"farther": 0}}, False),
        ({"frames": 64}, False),
    ],
)
def test_the_schema_knows_types_limits_and_names(value, right):
    assert Draft202012Validator(schema_of(Toy())).is_valid(value) == right


@pytest.mark.parametrize(
    ("settings", "options", "message"),
    [
        (Toy, {"kind": "new"}, r"^budget: toy.kind is 'new'; known: plain, odd$"),
        (Toy, {"parts": ("foot",)}, r"^budget: toy.parts: 'foot' is not known; known: body, face$"),
        (Toy, {"parts": ()}, r"^budget: toy.parts is \(\); some of body, face$"),
        (
            GestureSettings,
            {"adversary": "face"},
            r"gesture_gan.adversary is 'face'; known: none, audio_pose, pose, vel",
        ),
        (ResyncSettings, {"keep": "best"}, r"resync.keep is 'best'; known: last, balanced"),
        (HA2GSettings, {"preset": "leaked"}, r"ha2g.preset is 'leaked'; known: paper, released"),
        (HA2GSettings, {"pose_hierarchy": "feet"}, r"ha2g.pose_hierarchy is 'feet'; known: full, none"),
        (SyncSettings, {"preset": "huge"}, r"sync_classifier.preset is 'huge'; known: resync, ls3dcg, unet"),
    ],
)
def test_a_choice_that_is_none_is_one_line(settings, options, message):
    with pytest.raises(CospeechError, match=message):
        settings(**options)
