"""The player in a real browser: it plays with its sound, shows what the films show, and asks nothing of a network."""

import argparse
import base64
import json
import re
from itertools import pairwise

import av
import cv2
import numpy as np
import pytest

from cospeech.clip import Words
from cospeech.commands import player as command
from cospeech.errors import CospeechError
from cospeech.render.character.figure import BACKGROUND, FADE, TITLE, Character
from cospeech.render.character.puppet import JOINTS, make_puppets, rebuild
from cospeech.render.character.triangles import Camera, Painter
from cospeech.render.pages.player_page import embedded, player_data, player_html, player_script, write_player
from cospeech.skeleton import UPPER55


@pytest.fixture
def show(browser, tmp_path):
    """Opens a page of panels and waits until it can be played."""

    def show(*panels, **options):
        browser.log.clear(), browser.requests.clear()
        write_player(tmp_path / "page.html", list(panels), **options)
        browser.open(tmp_path / "page.html")
        browser.run("player.ready.then(() => 1)")
        return browser

    return show


def settled(browser, script=""):
    """The page after a script and after it has been drawn."""
    browser.run(
        f"(async () => {{ {script}; player.density = 1; player._slow = 0; player.redraw();"
        " for (let i = 0; i < 4; i++) await new Promise(requestAnimationFrame); })()"
    )
    return browser.screenshot()


def differing(a, b):
    """Share of pixels above the bar that differ visibly."""
    return (np.abs(a[:460].astype(int) - b[:460]).max(-1) > 20).mean()


def tone(seconds=2.0, rate=16000):
    return 0.3 * np.sin(2 * np.pi * 220 * np.arange(round(seconds * rate)) / rate).astype(np.float32), rate


def test_it_plays_with_the_clock_of_its_sound(show, make_clip):
    page = show(("recorded", make_clip(60)), ("generated", make_clip(45)), audio=tone(4.0))
    pictures = [page.screenshot()]
    page.click(".bar button")
    page.wait("player.time > 0.3")
    clocks = "[performance.now() / 1000, player.audio.currentTime]"
    before = page.run(clocks)
    for moment in (0.9, 1.5):
        page.wait(f"player.time > {moment}")
        pictures.append(page.screenshot())
    passed, advanced = np.subtract(page.run(clocks), before)
    assert advanced == pytest.approx(passed, rel=0.3)
    assert min(differing(a, b) for a, b in pairwise(pictures)) > 0.002
    assert page.run("player.drawn") > 10 and page.run("player.button.textContent") == "Pause"
    page.key(" ", "Space", 32, " ")
    page.wait("player.paused")
    assert not page.log
    assert [address for address in page.requests if not address.startswith(("file:", "data:"))] == []
    assert len([address for address in page.requests if address.startswith("file:")]) == 1


def test_any_moment_can_be_reached_and_looks_the_same_each_time(show, make_clip):
    page = show(("a", make_clip(60)), audio=tone(4.0))
    there, elsewhere, again = (settled(page, f"player.seek({at})") for at in (2.2, 0.5, 2.2))
    assert differing(there, elsewhere) > 0.002
    np.testing.assert_array_equal(there[:460], again[:460])
    page.key("ArrowLeft", "ArrowLeft", 37)
    page.wait("Math.abs(player.time - 1.2) < 0.01")
    page.key("Home", "Home", 36)
    page.wait("player.time === 0")
    x, y, width = page.run(
        "(({left, top, width, height}) => [left, top + height / 2, width])(player.slider.getBoundingClientRect())"
    )
    page.mouse("mousePressed", x + 0.75 * width, y), page.mouse("mouseReleased", x + 0.75 * width, y)
    page.wait("Math.abs(player.time - 3) < 0.1")
    assert not page.log


def test_dragging_turns_the_wheel_nears_and_reset_returns(show, make_clip):
    page = show(("a", make_clip()))
    front = settled(page)
    for kind, x in (("mousePressed", 300), ("mouseMoved", 380), ("mouseReleased", 380)):
        page.mouse(kind, x, 250)
    turned = settled(page)
    assert page.run("player.camera.yaw") < -0.1 and differing(front, turned) > 0.01
    page.mouse("mouseWheel", 300, 250, deltaX=0, deltaY=-300)
    page.wait("player.camera.zoom > 1.2")
    assert differing(settled(page), turned) > 0.01
    page.click(".bar button:last-child")
    np.testing.assert_array_equal(settled(page)[:460], front[:460])


def test_joints_are_where_the_clip_and_pythons_camera_have_them(show, make_clip):
    clip, other = make_clip(31), make_clip(20, fps=25.0)
    other.positions[4, UPPER55.index["left_wrist"]] = [20.0, -30.0, 5.0]  # failed tracking: 16 bits must still hold it
    page = show(("a", clip), ("b", other))
    for panel, each in enumerate((clip, other)):
        for frame in (0, 3.25, len(each) - 1, len(each) + 40):
            low = min(int(frame), len(each) - 1)
            high = min(low + 1, len(each) - 1)
            expected = each.positions[low] + (each.positions[high] - each.positions[low]) * (frame % 1)
            found = np.array(page.run(f"player.jointsAt({panel}, {frame / each.fps})"))[:55]
            np.testing.assert_allclose(found, expected, atol=6e-4)
    settings = page.run("player.data.camera")
    width, height = page.run("[player.canvases[0].clientWidth, player.canvases[0].clientHeight]")
    camera = Camera.containing(np.array(settings["points"]), width, height, TITLE, FADE)
    seen = page.run("player.jointsAt(0, 0.4).slice(0, 55).map((joint) => player.project(0, joint))")
    np.testing.assert_allclose(seen, camera.project(clip.positions[6])[:, :2], atol=0.6)
    everything = camera.project(clip.positions)[..., :2]
    assert (everything > 0).all() and (everything < (width, height)).all()


@pytest.mark.parametrize("posture", ["sitting", "none"])
def test_every_vertex_is_where_the_films_have_it(show, make_clip, posture):
    """A nodding, leaning, grimacing clip: the browser's mesh against Python's, millimetre by millimetre."""
    clip, rng = make_clip(40), np.random.default_rng(2)
    wave = np.sin(np.arange(40)[:, None] / [3, 4, 5])
    clip.rotation = (0.6 * wave).astype(np.float32)
    clip.expression = rng.uniform(0, 0.9, clip.expression.shape).astype(np.float32)
    lean = UPPER55.joints("spine", "neck", "head", "head_top", "left_shoulder", "right_shoulder")
    clip.positions[:, lean] += (0.05 * wave[:, None] * [1, 0.2, 1]).astype(np.float32)
    page = show(("still", make_clip(3)), ("a", clip), posture=posture)
    figure = Character(clip.positions, posture=posture)
    points, _ = figure.pose(clip.positions, clip.rotation, clip.expression)
    moving = points.shape[1] - len(figure.props)  # all panels share the stool of the first
    for frame in (0, 11, 26):
        found = page.run(f"(player.puppets.pose(1, {frame / clip.fps}), [...player.puppets.points])")
        apart = np.linalg.norm(np.reshape(found, (-1, 3))[:moving] - points[frame, :moving], axis=-1)
        assert np.sqrt(np.mean(apart**2)) < 3e-4 and apart.max() < 4e-3  # a lid that snaps shut is off for a frame


@pytest.mark.parametrize("frame", [0, 5])  # mouth shut, mouth open
def test_the_picture_is_that_of_the_films(show, make_clip, frame):
    """Python's rasteriser and the browser's, on the same camera: outlines and colours agree."""
    clip = make_clip()
    page = show(("a", clip), posture="none")
    settled(page, f"player.seek({frame / clip.fps})")
    picture = base64.b64decode(page.run("player.canvases[0].toDataURL()").split(",")[1])
    picture = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    height, width = picture.shape[:2]
    camera = Camera.containing(np.array(page.run("player.data.camera.points")), width, height, TITLE, FADE)
    figure, part = Character(clip.positions, posture="none"), slice(frame, frame + 1)
    points, bright = figure.pose(clip.positions[part], clip.rotation[part], clip.expression[part])
    film = np.full((height, width, 3), BACKGROUND, np.uint8)
    Painter(camera).draw(film, points[0], bright[0], figure.triangles, figure.colors)
    pelvis = int(camera.project(clip.positions[frame, UPPER55.index["pelvis"]])[1])
    outlines = [(np.abs(each[:pelvis].astype(int) - BACKGROUND).max(-1) > 40) for each in (picture, film)]
    assert (outlines[0] & outlines[1]).sum() > 0.98 * (outlines[0] | outlines[1]).sum() > 1000
    inside = cv2.erode((outlines[0] & outlines[1]).astype(np.uint8), np.ones((3, 3))).astype(bool)
    apart = np.abs(picture[:pelvis].astype(int) - film[:pelvis])[inside].max(-1)
    assert np.median(apart) < 6 and (apart > 40).mean() < 0.05


def test_two_players_on_one_page_and_one_of_them_plays_once(browser, make_clip, tmp_path):
    """What a study embeds: a player of its own data, played a single time, that tells its end."""
    data = embedded(player_data([("a", make_clip(45))], tone(3.0)))
    (tmp_path / "two.html").write_text(f"""<!doctype html><div id="a" style="height: 300px"></div>
        <div id="b" style="height: 200px"></div><script>{player_script()}</script><script>
        const data = {data}, place = (id) => document.getElementById(id), heard = [];
        const once = new CospeechPlayer(place("a"), data, {{ once: true }});
        const other = new CospeechPlayer(place("b"), data);
        for (const name of ["ready", "play", "ended"]) once.addEventListener(name, () => heard.push(name));
        </script>""")
    browser.log.clear()
    browser.open(tmp_path / "two.html")
    browser.wait("once.painter && other.painter")
    assert browser.run("[...place('a').querySelectorAll('input')].length") == 0
    browser.click("#a .bar button")
    browser.run("once.seek(2.9)")
    assert browser.run("once.time") < 2.5
    browser.wait("heard.includes('ended')")
    browser.run("once.play().then(() => 1)")
    assert browser.run("once.paused && once.button.disabled") and browser.run("heard") == ["ready", "play", "ended"]
    assert browser.run("other.time") == 0
    browser.run("other.remove()")
    assert browser.run("document.querySelectorAll('.cospeech').length") == 1
    assert not browser.log


@pytest.mark.parametrize(
    ("broken", "line"),
    [
        ({"audio": "data:audio/mp4;base64,AAAA"}, "cannot play its sound"),
        ({"version": 99}, "version 99"),
        ({"blob": "AAAA"}, "Cannot show"),
    ],
)
def test_what_cannot_be_shown_is_said_on_the_page(browser, make_clip, tmp_path, broken, line):
    data = embedded(player_data([("a", make_clip(9))]) | broken)
    (tmp_path / "bad.html").write_text(f"""<!doctype html><body><script>{player_script()}</script><script>
        const player = new CospeechPlayer(document.body, {data});
        player.ready.catch(() => {{}});</script>""")
    browser.open(tmp_path / "bad.html")
    browser.wait(f"player.words.textContent.includes({json.dumps(line)})")


def test_titles_words_and_buttons_can_be_read_by_a_program(show, make_clip):
    title = "<b>50 %DATA%</b> & \u201eLaut\u201c"
    clip = make_clip()
    clip.words = Words(np.array([0.2, 0.5]), np.array([0.4, 0.6]), ["</script>", "fine"])
    page = show((title, clip), ("second", make_clip(1)))
    assert page.run("document.querySelector('figcaption').textContent") == title
    assert title in page.run("document.title")
    settled(page, "player.seek(0.5)")
    assert page.run("player.words.textContent") == "</script> fine"
    tree = page.send("Accessibility.getFullAXTree")["nodes"]
    named = {(node["role"]["value"], node.get("name", {}).get("value")) for node in tree if "role" in node}
    assert {("button", "Play"), ("button", "Reset view"), ("slider", "Time in seconds")} <= named
    assert not page.log


def test_legs_keep_their_length_on_feet_that_stay(make_clip):
    clip = make_clip()
    hips = UPPER55.joints("left_hip", "right_hip")
    clip.positions[:, hips] += (0.04 * np.sin(np.arange(30) / 4)[:, None, None] * [1, 0.25, -0.5]).astype(np.float32)
    for stance in ("standing", "sitting"):
        _, (puppet,), _ = make_puppets([clip], stance)
        for side, sign in (("left", 1), ("right", -1)):
            hip, knee, ankle = (puppet.joints[:, JOINTS.index(f"{side}_{name}")] for name in ("hip", "knee", "ankle"))
            assert np.ptp(ankle, axis=0).max() == 0 and np.ptp(hip, axis=0).max() > 0.07
            for a, b in ((hip, knee), (knee, ankle)):
                np.testing.assert_allclose(np.linalg.norm(b - a, axis=1), 0.42 * puppet.scale, rtol=0.02)
            straight = hip + (ankle - hip) * 0.5
            assert ((knee - straight)[:, 2] > 0).all() and (sign * ankle[:, 0] > 0).all()
    assert (knee[:, 2] > hip[:, 2] + 0.25).all()  # sitting: the thigh lies forward


def test_trunk_and_face_are_the_films_within_a_fraction_of_a_millimetre(make_clip):
    clip = make_clip(60)
    rng = np.random.default_rng(1)
    sway = np.cumsum(rng.normal(0, 0.004, (60, 3)), 0).astype(np.float32)
    clip.positions[:, UPPER55.joints("spine", "neck", "left_shoulder", "right_shoulder")] += sway[:, None]
    clip.expression = rng.uniform(0, 0.8, clip.expression.shape).astype(np.float32)
    (figure,), (puppet,), shapes = make_puppets([clip], "none")
    first = sum(len(figure.templates[n][0]) * len(limbs) for n, limbs in figure.limbs.items())
    points, _ = figure.pose(clip.positions, clip.rotation, clip.expression)
    trunk = rebuild(shapes["trunk"], puppet.weights["trunk"]) * puppet.scale
    apart = np.linalg.norm(trunk - points[:, first : first + trunk.shape[1]], axis=-1)
    assert np.sqrt(np.mean(apart**2, 0)).max() < 4e-4
    expected = figure.head.shape(60, clip.expression)
    apart = np.linalg.norm(rebuild(shapes["head"], puppet.weights["head"]) - expected, axis=-1)
    assert np.sqrt(np.mean(apart**2, 0)).max() < 4e-4


def test_a_minute_of_four_methods_stays_under_three_megabytes(make_clip):
    rng = np.random.default_rng(0)
    panels = []
    for name in "abcd":
        clip = make_clip(900)
        jitter = np.cumsum(rng.normal(0, 0.004, clip.positions.shape), 0)  # as restless as real hands
        clip.positions += (jitter - jitter.mean(0)).astype(np.float32).clip(-0.2, 0.2)
        clip.expression = np.abs(clip.expression + rng.normal(0, 0.05, clip.expression.shape)).astype(np.float32)
        panels.append((name, clip))
    noise = rng.normal(0, 0.1, 60 * 16000).astype(np.float32), 16000
    assert len(player_html(panels, noise).encode()) < 3e6


def test_same_input_same_bytes_and_the_sound_is_whole(make_clip, tmp_path):
    panels = [("a", make_clip(45))]
    assert player_html(panels, tone(3.0)) == player_html(panels, tone(3.0))
    sound = tmp_path / "sound.mp4"
    sound.write_bytes(base64.b64decode(player_data(panels, tone(3.0))["audio"].split(",")[1]))
    with av.open(str(sound)) as film:
        heard = np.concatenate([frame.to_ndarray()[0] for frame in film.decode(audio=0)])
    assert len(heard) == pytest.approx(3.0 * 48000, abs=2048)
    assert abs(np.fft.rfftfreq(48000, 1 / 48000)[np.abs(np.fft.rfft(heard[48000:96000])).argmax()] - 220) <= 1


def test_mistakes_get_one_line(make_clip, tmp_path):
    broken = make_clip()
    broken.positions[7, 3, 1] = np.nan
    for panels, options, line in (
        ([("a", broken)], {}, "positions holds NaN"),
        ([], {}, "no clip"),
        ([("a", make_clip(0))], {}, "0 frames"),
        ([("a", make_clip())], {"posture": "kneeling"}, "standing, sitting or none"),
    ):
        with pytest.raises(CospeechError, match=line) as error:
            write_player(tmp_path / "a.html", panels, **options)
        assert "\n" not in str(error.value)
    with pytest.raises(CospeechError, match=r"ends in \.html"):
        write_player(tmp_path / "a.mp4", [("a", make_clip())])
    assert not list(tmp_path.iterdir())


def test_the_command_takes_the_first_clips_sound_and_names_panels(make_clip, tmp_path):
    import soundfile

    soundfile.write(tmp_path / "take.wav", *tone())
    clip, generated = make_clip(), make_clip()
    clip.audio, generated.generator = "take.wav", "resync"
    clip.write(tmp_path / "a.h5"), generated.write(tmp_path / "b.h5")
    parser = argparse.ArgumentParser()
    command.add(parser.add_subparsers())

    def run(*arguments):
        options = parser.parse_args(["player", *map(str, arguments), "--out", str(tmp_path / "page.html")])
        options.run(options)

    run(tmp_path / "a.h5", tmp_path / "b.h5", "--posture", "sitting")
    page = (tmp_path / "page.html").read_text()
    data = json.loads(re.search('<script type="application/json" id="motion">(.*?)</script>', page, re.S)[1])
    assert [panel["title"] for panel in data["panels"]] == ["anna · recorded", "anna · resync"]
    assert data["duration"] == 2.0 and data["posture"] == "sitting" and len(data["audio"]) > 10000
    with pytest.raises(CospeechError, match="1 for 2 clips"):
        run(tmp_path / "a.h5", tmp_path / "b.h5", "--titles", "one")
