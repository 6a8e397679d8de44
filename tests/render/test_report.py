"""The report is one file: it parses, embeds what it was given, escapes text and asks the network for nothing."""

import base64
import math
import re
from html.parser import HTMLParser

import h5py
import numpy as np
import pytest

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.evaluation.columns import KNOWN, METRICS
from cospeech.evaluation.tables import Summary
from cospeech.files import put, writing_hdf5
from cospeech.render.pages.report import side_by_side, write_report

VOID = {"meta", "br", "img", "link", "input"}


class Page(HTMLParser):
    """Checks that tags nest, and collects text, table rows and attributes."""

    def __init__(self, path):
        super().__init__()
        self.open, self.text, self.rows, self.attributes = [], "", [], []
        self.feed(path.read_text(encoding="utf-8"))
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.attributes += [(tag, *pair) for pair in attributes]
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data

    def values(self, tag, name):
        return [value for t, n, value in self.attributes if (t, n) == (tag, name)]


def summary(row, **values):
    mean = dict.fromkeys(METRICS, math.nan) | {name: value[0] for name, value in values.items()}
    deviation = dict.fromkeys(METRICS, math.nan) | {name: value[1] for name, value in values.items()}
    return Summary("calm <&> lively", row, 1, 3, mean, deviation)


def history(path, **losses):
    with writing_hdf5(path, "cospeech.history", steps=30) as file:
        put(file, "step", np.array([10, 20, 30]))
        for term, values in losses.items():
            put(file.require_group("loss"), term, np.float32(values))
    return path


@pytest.fixture
def material(tmp_path):
    films = []
    for i in range(3):
        (tmp_path / f"film {i}.mp4").write_bytes(np.random.default_rng(i).bytes(3000))
        films.append((f"film <{i}>", tmp_path / f"film {i}.mp4"))
    (tmp_path / "train.tsv").write_text("s\th:m:s\tmax_rss\n75.25\t0:01:15\t512.5\n")
    (tmp_path / "quick.tsv").write_text("s\th:m:s\tmax_rss\n0.5\t0:00:00\t-\n")
    return {
        "title": "A <b>bold</b> study",
        "evaluation": [
            summary("ground_truth", fgd=(0.0, math.nan), beat_consistency=(0.5, 0.02)),
            summary("resync", fgd=(1.25, math.nan)),
        ],
        "histories": {"calm/resync": history(tmp_path / "h.h5", critic=[-1, -2, -1.5], rec=[3, np.nan, 1])},
        "videos": films,
        "config": "subjects: [calm]  # <none>",
        "versions": {"torch": "2.13.0"},
        "timings": [("train calm resync", tmp_path / "train.tsv"), ("quick", tmp_path / "quick.tsv")],
        "notices": ["a.bvh: up axis guessed <y>"],
    }


def test_shows_everything_it_was_given(tmp_path, material):
    write_report(tmp_path / "report.html", **material)
    page = Page(tmp_path / "report.html")
    for text in (
        "A <b>bold</b> study",
        "calm <&> lively",
        "# <none>",
        "torch",
        "2.13.0",
        "guessed <y>",
        "film <1>",
        "calm/resync: 30 iterations",
    ):
        assert text in page.text
    head, truth, model = page.rows[:3]
    assert head[0] == "row" and any(METRICS["fgd"].label in cell for cell in head)
    assert truth[0] == "ground truth" and model[0] == "resync"
    assert "0.500 ± 0.020" in truth and "n/a" in model  # beat consistency, which the model does not have
    assert "nan" not in page.text.lower().split()
    assert ["train calm resync", "1 min 15 s", "512"] in page.rows
    assert ["quick", "0.5 s", "n/a"] in page.rows


def test_asks_nothing_of_the_network_and_loads_nothing_from_outside(tmp_path, material):
    write_report(tmp_path / "report.html", **material)
    page = Page(tmp_path / "report.html")
    assert "http" not in (tmp_path / "report.html").read_text()
    loaded = [value for _, name, value in page.attributes if name in ("src", "srcset", "poster", "data")]
    assert loaded and all(value.startswith("data:") for value in loaded)
    assert all(value.startswith("#") for value in page.values("a", "href"))
    assert not page.values("link", "href") and "@import" not in page.text and "url(" not in page.text


def test_embedded_films_decode_to_the_same_bytes(tmp_path, material):
    write_report(tmp_path / "report.html", **material)
    sources = Page(tmp_path / "report.html").values("video", "src")
    found = [base64.b64decode(source.removeprefix("data:video/mp4;base64,"), validate=True) for source in sources]
    assert found == [path.read_bytes() for _, path in material["videos"]]


def test_links_films_that_are_too_large_together(tmp_path, material):
    write_report(tmp_path / "sub/report.html", **material | {"film_bytes": 6500})
    page = Page(tmp_path / "sub/report.html")
    assert len(page.values("video", "src")) == 2
    assert "../film%202.mp4" in page.values("a", "href")


def test_curves_show_every_loss_term(tmp_path, material):
    write_report(tmp_path / "report.html", **material)
    (source,) = Page(tmp_path / "report.html").values("img", "src")
    picture = base64.b64decode(source.removeprefix("data:image/svg+xml;base64,")).decode()
    assert ">critic<" in picture and ">rec<" in picture and "<svg" in picture


def test_a_learning_curve_is_shown_where_there_is_one(tmp_path, material):
    path = material["histories"]["calm/resync"]
    with h5py.File(path, "a") as file:
        file["pck/step"], file["pck/wild"] = [10, 20], [40.0, 60.5]
    write_report(tmp_path / "report.html", **material)
    pictures = re.findall(r'alt="learning curve of calm/resync"', (tmp_path / "report.html").read_text())
    assert len(pictures) == 1


def test_same_input_same_bytes(tmp_path, material):
    for name in ("a.html", "b.html"):
        write_report(tmp_path / name, **material)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_without_anything_it_is_still_a_page(tmp_path):
    write_report(tmp_path / "report.html", title="Empty")
    page = Page(tmp_path / "report.html")
    assert "Empty" in page.text and not page.values("a", "href") and not re.search(r"\$\w", page.text)


def test_missing_film_and_odd_benchmark(tmp_path, material):
    with pytest.raises(CospeechError, match=r"gone\.mp4: no such film"):
        write_report(tmp_path / "report.html", title="x", videos=[("gone", tmp_path / "gone.mp4")])
    (tmp_path / "odd.tsv").write_text("nothing here\n")
    with pytest.warns(CospeechNotice, match=r"odd\.tsv"):
        write_report(tmp_path / "report.html", title="x", timings={"odd": tmp_path / "odd.tsv"})
    assert "Run times" not in Page(tmp_path / "report.html").text


def write_table(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_any_table_gets_a_section_with_its_caption(tmp_path):
    """Deviations stand in their mean's cell, subjects get tables of their own, notes are said once."""
    sync = write_table(
        tmp_path / "table_4_4.csv",
        "subject,frames,in_sync [%],fgd,fgd deviation,warning",
        "calm,64,81.234,1.23456,0.5,beware <b>",
        "lively,16,n/a,12.3456,n/a,beware <b>",
    )
    other = write_table(tmp_path / "table_9_1.csv", "row,lips [mm],lips deviation [mm],seeds", "mean_pose,3.456,0.11,3")
    empty = write_table(tmp_path / "empty.csv", "a,b")
    captions = {"table_9_1": {"title": "Lips & teeth", "about": "How *far* off; `random` is <1>."}, "gone": {}}
    write_report(tmp_path / "r.html", title="x", tables=[sync, empty, other], captions=captions)
    page = Page(tmp_path / "r.html")
    assert page.values("a", "href") == ["#lips-teeth", "#table-4-4"]
    assert "How far off; random is <1>." in page.text and page.text.count("beware <b>") == 1
    assert page.rows == [
        ["row\xa0", "lipsmm", "seeds\xa0"],
        ["mean pose", "3.46 ± 0.11", "3"],
        ["frames\xa0", "in sync%", "fgd\xa0"],
        ["64", "81.2", "1.23 ± 0.50"],
        ["frames\xa0", "in sync%", "fgd\xa0"],
        ["16", "n/a", "12.3"],
    ]


def test_a_table_may_be_drawn_as_curves(tmp_path):
    learnt = write_table(
        tmp_path / "curve.csv",
        "step,part,pck [%],pck deviation [%]",
        "0,body,10,1",
        "50,body,80,2",
        "0,hand,20,1",
        "50,hand,n/a,n/a",
    )
    write_report(tmp_path / "r.html", title="x", tables=[learnt], captions={"curve": {"curve": "step"}})
    (source,) = Page(tmp_path / "r.html").values("img", "src")
    picture = base64.b64decode(source.removeprefix("data:image/svg+xml;base64,")).decode()
    assert all(f">{text}<" in picture for text in ("body", "hand", "step", "pck [%]"))
    assert "deviation" not in picture
    with pytest.raises(CospeechError, match=r"curve\.csv: no column 'iterations' to draw over; it has step, part"):
        write_report(tmp_path / "r.html", title="x", tables=[learnt], captions={"curve": {"curve": "iterations"}})
    write_table(learnt, "a,b", "1,2", "3")
    with pytest.raises(CospeechError, match=r"curve\.csv: line 3 has 1 cells for 2 headings"):
        write_report(tmp_path / "r.html", title="x", tables=[learnt])


def test_players_stand_in_the_page_and_run(tmp_path, make_clip, browser):
    generated, other = make_clip(), make_clip()
    generated.generator, other.subject = "resync", "berta"
    paths = [tmp_path / f"{name}.h5" for name in "abc"]
    for path, clip in zip(paths, (make_clip(), other, generated), strict=True):
        clip.write(path)
    tone = 0.1 * np.sin(np.arange(32000) / 9).astype(np.float32), 16000
    write_report(tmp_path / "r.html", title="x", players=side_by_side(paths, [tone, tone]))
    page = Page(tmp_path / "r.html")
    assert page.values("a", "href") == ["#side-by-side"] and "http" not in page.text
    browser.open(tmp_path / "r.html")
    browser.wait("document.querySelectorAll('.player canvas').length === 3")
    titles = browser.run(
        "[...document.querySelectorAll('.player')].map((each) => "
        "[...each.querySelectorAll('figcaption')].map((title) => title.textContent))"
    )
    assert titles == [["recorded", "resync"], ["recorded"]]
    browser.wait("[...document.querySelectorAll('.player button')].every((button) => !button.disabled)")


def test_every_column_is_explained():
    assert all(metric.about for metric in KNOWN.values())
