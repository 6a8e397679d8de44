"""Documents: links lead somewhere, and measured tables are those of the files that they name."""

import importlib.util
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.matching.search.similarity import Settings
from tests.test_house import ORDER

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
LINK = re.compile(r"\]\((?!https?:)([^)#]*)(?:#([^)]+))?\)")


def anchors(page):
    """The anchors that GitHub gives to a page's headings."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", re.sub(r"\[(.+?)\]\(.*?\)", r"\1", title).lower()) for title in titles]
    return {title.strip().replace(" ", "-") for title in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_a_page_and_to_a_heading_of_it(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target, anchor in LINK.findall(text):
        other = page.parent / target if target else page
        assert other.exists(), f"{page.name} links to {target}"
        if anchor:
            assert anchor in anchors(other), f"{page.name} links to {target}#{anchor}"


def test_every_page_can_be_reached_from_the_index():
    seen, waiting = set(), [ROOT / "docs" / "README.md"]
    while waiting:
        page = waiting.pop().resolve()
        if page not in seen and page.suffix == ".md":
            seen.add(page)
            waiting += [page.parent / target for target, _ in LINK.findall(page.read_text(encoding="utf-8")) if target]
    assert not set(ROOT.resolve().glob("docs/**/*.md")) - seen


def test_the_page_of_the_house_lists_its_rooms_in_their_order():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \|", text, flags=re.MULTILINE) == ORDER


def test_files_that_the_library_sends_its_reader_to_are_there():
    sources = [*ROOT.glob("src/**/*.py"), *ROOT.glob("config/**/*.yaml"), *ROOT.glob("workflow/**/*.smk")]
    for source in sources:
        for name in re.findall(r"docs/[\w/]+\.md", source.read_text(encoding="utf-8")):
            assert (ROOT / name).exists(), f"{source} names {name}"


@pytest.fixture
def run(tmp_path):
    """A run's files and a page that shows them."""
    results, pages = tmp_path / "results", tmp_path / "pages"
    (results / "benchmarks" / "train").mkdir(parents=True)
    pages.mkdir()
    head = "subject,row,runs,fgd,fgd deviation,jerk [m/s^3],jerk deviation [m/s^3],note\n"
    lines = "calm,ground_truth,1,0,n/a,8.6,0.5,read this\ncalm,knn,3,1.5,0.25,9,1,\nlively,knn,3,2.25,0.5,24,2,\n"
    (results / "summary.csv").write_text(head + lines)
    (results / "bench.txt").write_text("search: 6.3 ms\n")
    for name, seconds, memory in (("calm-knn", 12.5, "801.2"), ("calm-resync", 30, "400"), ("short", 0.1, "-")):
        table = f"s\th:m:s\tmax_rss\n{seconds}\t0:00:12\t{memory}\n"
        (results / "benchmarks" / "train" / f"{name}.tsv").write_text(table)
    return results, pages / "page.md"


def fill(run):
    results, page = run
    command = [
        sys.executable,
        str(ROOT / "tools" / "measured.py"),
        "--results",
        str(results),
        "--pages",
        str(page.parent),
    ]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True).stdout


def marked(name, inner):
    return f"<!-- measured from {name} -->\n{inner}\n<!-- /measured -->\n"


def test_a_page_shows_what_the_file_says_now_and_nothing_else_changes(run):
    _, page = run
    page.write_text("before\n" + marked("summary.csv: fgd", "| old |") + "after\n")
    fill(run)
    text = page.read_text()
    assert text.startswith("before\n<!-- measured from summary.csv: fgd -->\n**calm**\n\n| row | fgd |\n")
    assert "| ground truth | 0.00 |" in text and "| knn | 1.50 ± 0.25 |" in text and "| knn | 2.25 ± 0.50 |" in text
    assert "jerk" not in text and "old" not in text and text.endswith("<!-- /measured -->\nafter\n")
    assert re.search(r"\*Commit \S+, from `summary.csv`.\*", text)


def test_without_named_columns_all_are_shown_with_their_units(run):
    _, page = run
    page.write_text(marked("summary.csv", ""))
    fill(run)
    assert "| row | runs | fgd | jerk, m/s^3 |" in page.read_text()


def test_text_is_shown_as_it_is_and_jobs_by_rule(run):
    _, page = run
    page.write_text(marked("bench.txt", "") + marked("benchmarks", ""))
    fill(run)
    assert "```\nsearch: 6.3 ms\n```" in page.read_text()
    assert "| train | 3 | 43 | 801 |" in page.read_text()


def test_a_table_whose_file_is_not_there_stays(run):
    _, page = run
    page.write_text(marked("tables/none.csv", "| typed |"))
    assert "not there" in fill(run)
    assert page.read_text() == marked("tables/none.csv", "| typed |")


def test_a_column_that_the_file_lacks_is_one_line(run):
    results, page = run
    page.write_text(marked("summary.csv: fdg", "| typed |"))
    command = [
        sys.executable,
        str(ROOT / "tools" / "measured.py"),
        "--results",
        str(results),
        "--pages",
        str(page.parent),
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "no column 'fdg'" in done.stderr
    assert "typed" in page.read_text()


def test_the_moving_picture_is_made_by_its_tool_and_small(tmp_path):
    """Its speech is the recorded take's, its face too, and what it writes is an animation as the one that is shown."""
    spec = importlib.util.spec_from_file_location("moving_picture", ROOT / "tools" / "moving_picture.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    tool.SECONDS = 10
    recorded, generated = tool.clips(tmp_path, takes=2, settings=Settings(steps=2))
    assert generated.frames == recorded.frames == 150
    np.testing.assert_array_equal(generated.expression, recorded.expression)
    np.testing.assert_array_equal(generated.features, recorded.features)
    assert np.abs(generated.positions - recorded.positions).max() > 0.05
    frames = [np.full((64, 64, 3), 80 * i, np.uint8) for i in range(3)]
    tool.write_animation(tmp_path / "a.webp", frames, 15, 75)
    for path in (tmp_path / "a.webp", ROOT / "docs" / "images" / "speaking.webp"):
        assert b"ANIM" in path.read_bytes()[:100] and path.stat().st_size < tool.MOST_BYTES
    noise = [np.random.default_rng(i).integers(0, 255, (900, 900, 3), np.uint8) for i in range(4)]
    with pytest.raises(CospeechError, match="fewer --seconds"):
        tool.write_animation(tmp_path / "b.webp", noise, 15, 100)


# ---- the publications' numbers, collected from their texts


def numbers(chapter, count):
    return [f"{chapter}.{n}" for n in range(1, count + 1)]


PUBLISHED = {
    "The thesis": {
        "eq.": [*numbers(2, 7), *numbers(3, 8), *numbers(4, 3), *numbers(5, 3)],
        "Table": [*numbers(3, 7), *numbers(4, 4), *numbers(5, 4)],
        "Algorithm": ["1"],
    },
    "IVA 2021": {"eq.": ["1", "2", "3"], "Table": ["1", "2", "3", "S1"]},
    "HA2G": {"eq.": [str(n) for n in range(1, 14)], "Table": [str(n) for n in range(1, 11)]},
}
# `eq. 4.1`, `Tables 3.2 and 3.3`, `equations 3.3 to 3.8`
CITATION = re.compile(
    r"\b(eq|Table|Algorithm)(?:uation)?s?\.?\s+((?:S?\d+(?:\.\d+)?)(?:(?:,\s|,?\sand\s)S?\d+(?:\.\d+)?)*)", re.I
)


def cited(text):
    """{("eq.", "4.1"), ...} of a text, where a publication's name stands before its own numbers."""
    found = set()
    for kind, listed in CITATION.findall(text):
        kind = "eq." if kind.lower() == "eq" else kind.capitalize()
        found |= {(kind, number) for number in re.findall(r"S?\d+(?:\.\d+)?", listed)}
    return found


def rows_of_the_map():
    """[(publication, kind, number, [places])] of docs/architecture.md."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = []
    for section in text.split("\n### ")[1:]:
        publication = next(name for name in PUBLISHED if section.startswith(name))
        for kind, number, rest in re.findall(
            r"^\| (eq\.|Table|Algorithm) (\S+) \|(.*)\|$", section, flags=re.MULTILINE
        ):
            rows.append((publication, kind, number, re.findall(r"`([\w/]+)\.py:([\w.]+)`", rest.split("|")[-1])))
    return rows


MAP = rows_of_the_map()


def test_the_map_has_every_number_of_the_publications_once():
    for publication, kinds in PUBLISHED.items():
        for kind, wanted in kinds.items():
            assert [number for p, k, number, _ in MAP if (p, k) == (publication, kind)] == wanted


@pytest.mark.parametrize("row", MAP, ids=lambda row: " ".join(row[:3]))
def test_a_row_of_the_map_leads_to_code_that_says_its_number(row):
    publication, kind, number, places = row
    assert places
    for path, name in places:
        found = importlib.import_module(f"cospeech.{path.replace('/', '.')}")
        for part in name.split("."):
            found = getattr(found, part)
        source = inspect.getsource(found)
        assert (kind, number) in cited(source), f"{path}.py:{name} does not say {kind} {number}"
        assert publication != "IVA 2021" or "IVA 2021" in source


SOURCES = sorted([*ROOT.glob("src/**/*.py"), *ROOT.glob("workflow/**/*.smk"), *ROOT.glob("workflow/**/*.py")])


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_code_cites_numbers_that_there_are(path):
    text = path.read_text(encoding="utf-8")
    known = {(kind, n) for kinds in PUBLISHED.values() for kind, listed in kinds.items() for n in listed}
    assert not cited(text) - known
    assert "reference section" not in text
