"""tools/house.py counts what it says: a small house with one fault of each kind, and one without."""

import io

import pytest

from tools import house

NOQA = "noqa: " + "E731"  # not counted here
FAULTS = {
    "import circles": {"clip.py": "from cospeech import track\n", "track.py": "def f(): from cospeech.clip import g\n"},
    "arrows upward": {"errors.py": "import cospeech.render.video\n", "render/video.py": ""},
    "constants stated twice": {"clip.py": "RATE = 15\n", "render/video.py": "WIDTH, RATE = 3, 15\n"},
    "names of modules that occur twice": {"render/video.py": "", "capture/video.py": ""},
    "folders of more than 14 modules": {f"render/a{i}.py": "" for i in range(15)},
    "functions of more than 8 arguments": {"clip.py": "def f(a, b, c, d, e, /, g, *, h, i, j): ...\n"},
    "functions of more than 60 lines": {"clip.py": "def f():\n" + "    a = 1\n" * 60},
    "files of more than 300 lines": {"clip.py": "a = 1\n" * 301},
    "scripts of more than 40 lines": {"../../workflow/scripts/train.py": "a = 1\n" * 41},
    "csv.writer": {"clip.py": "table = csv.writer(file)\n"},
    "files that name velocity_gan": {"../../workflow/a.smk": "# velocity_gan", "clip.py": "my_velocity_gan"},
    NOQA: {"clip.py": f"f = lambda: 1  # {NOQA}\n"},
}


@pytest.fixture
def tree(tmp_path):
    def build(files):
        for name, text in {"__init__.py": "", **files}.items():
            path = tmp_path / "src" / "cospeech" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path

    return build


@pytest.mark.parametrize("name", FAULTS)
def test_each_figure_counts_its_fault(tree, name):
    assert len(house.figures(tree(FAULTS[name]))[name]) == 1


def test_a_house_in_order(tree):
    files = {
        "errors.py": "from cospeech import __version__\nONE = 1\n",
        "clip.py": "from cospeech.errors import ONE\nTWO = 1\n",
        "render/__init__.py": "",
        "render/video.py": "from cospeech import clip\nclass A:\n    def f(self, a, b, c, d, e, f, g, h): 0",
        "gestures/chapter4/losses.py": "",
        "gestures/ha2g/losses.py": "",
    }
    found = house.figures(tree(files))
    assert {name: places for name, places in found.items() if places and name in FAULTS} == {}
    assert len(found["top-level modules"]) == 2 and len(found["lines in src"]) == 7


def test_what_grows_is_told_with_its_place_and_fails():
    counted = {name: [] for name in house.LIMITS}
    assert house.report(counted, out=io.StringIO()) == 0
    told = io.StringIO()
    assert house.report(counted | {"arrows upward": ["errors.py -> clip.py"]}, out=told) == 1
    assert "errors.py -> clip.py" in told.getvalue()
    assert told.getvalue().splitlines()[-1] == "grown beyond their limit: arrows upward"


def test_no_limit_is_below_its_aim():
    assert all(limit >= aim for limit, aim in house.LIMITS.values())
