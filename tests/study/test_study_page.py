"""The page of a study in a real browser: a participant answers, closes it, goes on, saves; the file is analysed."""

import json
import time
from collections import Counter
from importlib.resources import files
from itertools import combinations, pairwise

import numpy as np
import pytest

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.study.analyse import analyse
from cospeech.study.stimuli import cut
from tests.render.browser import Browser, chromium

pytestmark = pytest.mark.skipif(not chromium(), reason="no Chromium on this machine")
STARS = {"ground_truth": 5, "mismatched": 3, "knn": 2}
READY = "document.getElementById('play') && !document.getElementById('play').disabled"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile"), (1000, 1000)) as browser:
        yield browser


class Participant:
    """Somebody who reads the page and uses mouse and keyboard."""

    def __init__(self, browser, folder, study, choose):
        self.browser, self.folder, self.study, self.choose = browser, folder, study, choose
        self.known = {s["id"]: s["condition"] for s in study["stimuli"]}
        browser.log.clear(), browser.requests.clear()

    def begin(self, code):
        for script in ("localStorage.clear()", "1"):  # pages on a disk share their memory: start as a new browser
            self.browser.open(self.folder / "index.html")
            self.browser.run(script)
        self.browser.wait("document.getElementById('start')")
        self.browser.click("#start")  # neither code nor consent yet
        assert self.browser.run("document.getElementById('start') !== null")
        self.browser.run("document.getElementById('code').focus()")
        self.browser.send("Input.insertText", text=code)
        self.browser.click("#agree")
        self.browser.click("#start")

    def watch(self):
        """Plays what is shown; -> the text of an attention check that stood there meanwhile, or ""."""
        page, text = self.browser, ""
        page.wait(READY)
        assert page.run("document.querySelector('fieldset').disabled && document.getElementById('next').disabled")
        page.click("#play")
        while page.run("document.querySelector('fieldset').disabled"):
            text = text or page.run("document.querySelector('.notice')?.textContent ?? ''")
            time.sleep(0.02)
        assert page.run("document.getElementById('play').disabled")
        return text

    def answer(self, item):
        """Chooses by name of the question, and goes on."""
        page, value = self.browser, self.choose(self, item)
        for key in self.study["questions"]:
            assert page.run("document.getElementById('next').disabled")
            page.click(f"input[name={key}][value='{value}']")
        page.click("#next")

    def item(self):
        """What the page is about to show, as its plan says."""
        number = int(self.browser.run("document.getElementById('progress').textContent").split()[0]) - 1
        return self.plan[number]

    def save(self, folder):
        """The file that the page gives back."""
        self.browser.send("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
        self.browser.wait("document.getElementById('download')")
        name = self.browser.run("document.getElementById('download').download")
        self.browser.click("#download")
        deadline = time.monotonic() + 20
        while not (folder / name).is_file():
            assert time.monotonic() < deadline, "the file was not saved"
            time.sleep(0.05)
        return folder / name


def plans(browser, study, codes, folder):
    """Of each code the plan that the page's own script makes."""
    page = (folder / "index.html").read_text()
    told = json.loads(page.split('id="design">')[1].split("</script>")[0])
    script = (files("cospeech.study") / "plan.js").read_text()
    return browser.run(
        f"(() => {{ {script}\n return {json.dumps(codes)}.map((code) => makePlan({json.dumps(told)}, code)); }})()"
    )


def test_a_participant_rates_reloads_and_the_file_is_analysed(browser, make_study, tmp_path):
    folder, study = make_study(title="<b>Study</b> %DATA% </script>", instructions="<img src=x onerror=alert(1)>")

    def choose(self, item):
        return item["expected"] if item["kind"] == "check" else STARS[self.known[item["stimuli"][0]]]

    someone = Participant(browser, folder, study, choose)
    someone.plan = plans(browser, study, ["p-01"], folder)[0]
    someone.begin("p-01")
    asked = {}
    for number, item in enumerate(someone.plan):
        assert someone.item() == item
        if number == 2:  # closed in the middle: goes on at the same clip
            browser.open(folder / "index.html")
            browser.wait(READY)
            assert someone.item() == item
        asked[number] = someone.watch()
        someone.answer(item)
    assert [bool(text) for text in asked.values()] == [item["kind"] == "check" for item in someone.plan]
    expected = next(item["expected"] for item in someone.plan if item["kind"] == "check")
    assert f"choose {expected} in every question" in "".join(asked.values())
    path = someone.save(tmp_path)
    file = json.loads(path.read_text())
    assert [one["stimuli"] for one in file["answers"]] == [item["stimuli"] for item in someone.plan]
    assert [one["views"] for one in file["answers"]] == [1, 1, 2, 1, 1, 1, 1]
    found = analyse(folder, [path])
    assert found.participants == ["p-01"] and not found.left
    assert {(row.condition, row.mean, row.ratings) for row in found.table} == {(c, v, 2) for c, v in STARS.items()}
    assert not browser.log and browser.run("document.querySelectorAll('img, b').length") == 0
    clips = folder / "clips"
    assert {a.removeprefix("file://") for a in browser.requests if a.startswith("file:")} == {
        str(folder / "index.html"),
        *map(str, clips.glob("*.js")),
    }
    assert all(address.startswith(("file:", "data:", "blob:")) for address in browser.requests)


def test_pairs_are_played_one_after_the_other_and_analysed(browser, make_study, tmp_path):
    folder, study = make_study(kind="pairs", tracks=1, ties=True)
    order = ["ground_truth", "knn", "mismatched"]  # whom this participant prefers

    def choose(self, item):
        ranks = [order.index(self.known[one]) for one in item["stimuli"]]
        return item.get("expected") or ("first" if ranks[0] < ranks[1] else "second")

    someone = Participant(browser, folder, study, choose)
    someone.plan = plans(browser, study, ["q"], folder)[0]
    someone.begin("q")
    for item in someone.plan:
        assert browser.run("document.querySelectorAll('.stage').length") == 2
        someone.watch()
        someone.answer(item)
    found = analyse(folder, [someone.save(tmp_path)])
    assert {(row.condition, row.wins) for row in found.table} == {("ground_truth", 2), ("knn", 1), ("mismatched", 0)}
    strength = {row.condition: row.strength for row in found.table}
    assert strength["ground_truth"] > strength["knn"] > strength["mismatched"]
    assert len(found.notes) == 2  # nobody beat the truth: no finite strengths, and it is said
    assert not browser.log


def test_a_character_is_seen_moving_and_the_others_of_its_track_are_not(browser, make_study):
    folder, study = make_study()
    someone = Participant(browser, folder, study, None)
    someone.begin("seen")
    browser.wait(READY)
    assert browser.run("[...document.querySelectorAll('.stage canvas')].filter((one) => one.clientWidth).length") == 1
    before = browser.screenshot()
    browser.click("#play")
    browser.wait("!document.querySelector('fieldset').disabled")
    assert (np.abs(browser.screenshot().astype(int) - before)[150:500].max(-1) > 20).mean() > 0.001


def test_what_is_shown_for_a_clip_is_the_motion_of_its_condition(browser, make_study, stimuli):
    folder, study = make_study()
    told = json.loads((folder / "index.html").read_text().split('id="design">')[1].split("</script>")[0])
    truth = {(s.condition, s.track): cut(s)[0].positions[3] for s in stimuli}  # 0.2 s at 15 frames a second
    known = {s["id"]: (s["condition"], s["track"]) for s in study["stimuli"]}
    browser.open(folder / "index.html")
    for clip, panel, number in told["stimuli"]:
        found = browser.run(f"""new Promise((done) => {{
            window.cospeechTrack = (name, data) => done(data);
            document.head.append(Object.assign(document.createElement("script"),
                                               {{ src: "clips/{told["files"][number]}.js" }}));
        }}).then((data) => Puppets.unpack(data)).then((puppets) => [...puppets.jointsAt({panel}, 0.2)])""")
        np.testing.assert_allclose(np.reshape(found, (-1, 3))[:55], truth[known[clip]], atol=6e-4)
    apart = {method: truth[method, "anna/take01@0.00"] for method in ("ground_truth", "mismatched", "knn")}
    assert min(np.abs(a - b).max() for a, b in combinations(apart.values(), 2)) > 0.01  # they can be told apart


def test_who_stops_gives_a_half_filled_file_and_may_go_on(browser, make_study, tmp_path):
    folder, study = make_study()
    someone = Participant(browser, folder, study, None)
    someone.begin("half")
    browser.wait(READY)
    browser.click("#stop")
    with pytest.warns(CospeechNotice, match="half-filled, 0 of 7 answered"), pytest.raises(CospeechError):
        analyse(folder, [someone.save(tmp_path)])
    browser.run("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Go on').click()")
    browser.wait(READY)
    assert browser.run("document.getElementById('progress').textContent") == "1 of 7"


def test_a_missing_clip_is_said_in_one_line(browser, make_study):
    folder, study = make_study()
    for path in (folder / "clips").glob("*.js"):
        path.unlink()
    Participant(browser, folder, study, None).begin("r")
    browser.wait("document.getElementById('status')?.textContent.includes('cannot be read; the folder is not whole')")
    assert browser.run(READY) is False


def test_every_condition_is_seen_equally_often_and_on_every_track(browser, make_study):
    folder, study = make_study(tracks=2, checks=2)
    known = {s["id"]: (s["condition"], s["track"]) for s in study["stimuli"]}
    codes = [f"p{i}" for i in range(120)]
    made = plans(browser, study, codes, folder)
    assert made == plans(browser, study, codes, folder)
    orders, firsts = set(), Counter()
    for plan in made:
        rated = [known[item["stimuli"][0]] for item in plan if item["kind"] == "rating"]
        assert sorted(rated) == sorted(known.values())  # every condition once on each of the two tracks
        assert Counter(c for c, _ in rated[:3]) == Counter(c for c, _ in rated[3:]) == Counter(STARS.keys())
        assert all(a[0] != b[0] for a, b in pairwise(rated))
        places = [i for i, item in enumerate(plan) if item["kind"] == "check"]
        assert len(places) == 2 and places[0] > 0 and places[1] - places[0] > 1
        orders.add(tuple(rated))
        firsts[rated[0]] += 1
    assert len(orders) > 60 and len(firsts) == 6 and max(firsts.values()) < 40  # 20 each on average
    assert {item["expected"] for plan in made for item in plan if item["kind"] == "check"} == {1, 2, 3, 4, 5}


def test_every_pair_is_seen_once_a_round_and_sides_are_balanced(browser, make_study):
    folder, study = make_study(kind="pairs", tracks=2, checks=0)
    known = {s["id"]: (s["condition"], s["track"]) for s in study["stimuli"]}
    made = plans(browser, study, [f"p{i}" for i in range(60)], folder)
    for plan in made:
        pairs = [tuple(known[one] for one in item["stimuli"]) for item in plan]
        assert all(a[1] == b[1] and a[0] != b[0] for a, b in pairs)
        assert Counter(frozenset((a[0], b[0])) for a, b in pairs) == dict.fromkeys(
            (frozenset(p) for p in (("knn", "mismatched"), ("knn", "ground_truth"), ("mismatched", "ground_truth"))), 2
        )
        assert set(Counter(a[0] for a, _ in pairs).values()) == {2}  # first as often as second
        assert all(len({a[1] for a, b in pairs if {a[0], b[0]} == pair}) == 2 for pair in [{"knn", "mismatched"}])
