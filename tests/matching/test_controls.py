"""Controls: their algebra, their windows, the search under them, and what happens when nothing fits."""

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from cospeech.cli import main
from cospeech.clip import Clip
from cospeech.demo import read_take, write_take
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.matching import KNN, Database
from cospeech.matching.control.controls import Control, Wanted
from cospeech.matching.control.signals import SIGNALS, ControlSignals, signal
from cospeech.matching.explain import explain
from cospeech.matching.resync.refine import Resynchronizer
from cospeech.matching.trace import trace_of
from cospeech.speech import write_wav
from cospeech.split import split_clips
from tests.matching.reference import algorithm1

FPS = 15.0
LEFT, RIGHT = 7, 4  # wrists of upper55, as published


@pytest.fixture
def added():
    """Registers signals by a function of positions, and takes them back."""
    before = dict(SIGNALS)
    yield signal
    SIGNALS.clear()
    SIGNALS.update(before)


def covered(database):
    """(M, F) bool: frames that some eligible window holds."""
    frames = np.zeros(database.eligible.shape, bool)
    for clip, frame in np.argwhere(database.eligible):
        frames[clip, frame : frame + 8] = True
    return frames


def left_height(database, percentile):
    """(M, F) heights of the left wrist, and their percentile over the frames that can be generated."""
    height = database.positions[:, :, LEFT, 1]
    return height, np.percentile(height[covered(database)], percentile)


def found(match):
    return list(zip(match.clip, match.frame, match.pose_rank, match.audio_rank, strict=True))


def truth(knn, features, eligible=None, **options):
    database = knn.matcher.database
    eligible = database.eligible if eligible is None else eligible
    queries = knn.matcher.query_features(features)
    return algorithm1(database.pose, database.audio, eligible, queries, np.zeros(96), **options)


@pytest.mark.parametrize("k", [1, 3, 9])
@pytest.mark.parametrize("variant", ["pose", "audio", "pose_only"])
def test_search_is_algorithm_1_under_masks_that_change_in_time(database, variant, k):
    """One hundred windows under none, one or two controls; the last of them has five frames."""
    knn, features = KNN(database), np.random.default_rng(k).normal(size=(797, 28))
    height, high = left_height(database, 85)
    low = np.percentile(height[covered(database)], 15)
    apart = np.abs(height - database.positions[:, :, RIGHT, 1])
    mask = np.ones((100, *height.shape), bool)
    for w in range(100):
        middle = (8 * w + min(8 * w + 8, 797)) / 2 / FPS
        if 2.0 <= middle < 20.5:
            mask[w] &= height >= high
        if 15 <= middle < 30:
            mask[w] &= ~((apart < np.float32(0.2)) & (height > low)) | (height <= low)
        if middle >= 40:
            mask[w] &= height <= low
    controls = [
        "left_wrist_height=high@2.0-20.5",
        "not (symmetry=<0.2 and not left_wrist_height=low) or left_wrist_height=low@15-30",
        {"signal": "left_wrist_height", "level": "low", "start": 40.0},
    ]
    match = knn.match(features, controls=controls, initial="mean", k=k, variant=variant)
    assert not match.unmasked.any() and set(match.widened) == {""}
    assert found(match) == truth(knn, features, k=k, mask=mask, variant=variant)
    allowed = database.eligible & mask & np.roll(mask, -7, axis=2)
    assert match.candidates.tolist() == allowed.any(axis=2).sum(axis=1).tolist()
    assert len(match.positions) == 797 and match.controls[30] == tuple(controls[:2])


def test_strict_tests_every_frame_of_a_window(database):
    knn, features = KNN(database), np.random.default_rng(0).normal(size=(90, 28))
    height, low = left_height(database, 15)
    fits = np.zeros(height.shape, bool)
    for clip, frame in np.argwhere(database.eligible):
        fits[clip, frame] = (height[clip, frame : frame + 8] <= low).all()
    match = knn.match(features, controls=["strict left_wrist_height=low"], initial="mean")
    assert found(match) == truth(knn, features, database.eligible & fits)
    loose = knn.match(features, controls=["left_wrist_height=low"], initial="mean")
    assert (loose.candidates >= match.candidates).all() and found(loose) != found(match)


def test_strict_tests_the_step_into_a_window_as_it_is_made(database):
    """Speed at every frame, seams included, keeps the bound, or that to which the step is told to be widened."""
    knn, features = KNN(database), np.random.default_rng(0).normal(size=(157, 28))
    speed = np.linalg.norm(np.diff(database.positions[:, :, LEFT], axis=1), axis=-1) * FPS
    bound = float(np.percentile(speed, 60))
    with pytest.warns(CospeechNotice, match="no gesture goes on so from the frame before"):
        match = knn.match(features, controls=[f"strict left_wrist_speed=<{bound:.4f}"])
    made = np.linalg.norm(np.diff(match.positions[:, LEFT], axis=0), axis=-1) * FPS
    at = np.arange(1, 157)
    assert (made[at % 8 > 0] <= bound + 1e-4).all()
    limits = {"": bound, "step not tested": np.inf}
    limits |= {f"step percentile {p}": knn.signals.percentile("left_wrist_speed", 100 - p) for p in (75, 60, 45, 30)}
    assert set(match.widened) <= set(limits)
    for w in range(1, 20):
        assert made[8 * w - 1] <= max(bound, limits[match.widened[w]]) + 1e-4
    free = knn.match(features, controls=[f"left_wrist_speed=<{bound:.4f}"])
    unbound = np.linalg.norm(np.diff(free.positions[:, LEFT], axis=0), axis=-1) * FPS
    assert made[7::8].mean() < 0.75 * unbound[7::8].mean()


@pytest.mark.parametrize("placement", ["continued", "any_frame", "any_frame_continued"])
def test_a_control_that_every_frame_keeps_changes_nothing_wherever_windows_may_start(database, placement):
    knn, features = KNN(database), np.random.default_rng(0).normal(size=(157, 28))
    free = knn.match(features, placement=placement)
    match = knn.match(features, placement=placement, controls=["reach=>=0@0-5", "hand_distance=>=0@2-"])
    assert found(match) == found(free)
    assert np.array_equal(match.positions, free.positions)


def test_no_control_and_controls_elsewhere_change_nothing(database):
    """Windows outside every interval are Algorithm 1's own, also when the take itself is left out."""
    knn, features = KNN(database), np.random.default_rng(0).normal(size=(90, 28))
    options = {"seed": 4, "k": 2, "exclude_take": "one"}
    free = knn.match(features, **options)
    late = knn.match(features, controls=["left_wrist_height=high@4-"], **options)
    assert found(late)[:7] == found(free)[:7] and found(late)[8:] != found(free)[8:]
    assert late.controls[6] == () and late.controls[8] == ("left_wrist_height=high@4-",)
    assert "one" not in late.take


@pytest.mark.parametrize(
    ("interval", "windows"),
    [
        ((0, 2), [0, 1, 2, 3]),  # middles at 0.27, 0.80, 1.33, 1.87, 2.40, 2.93, 3.40 s (the last window has 7 frames)
        ((2, np.inf), [4, 5, 6]),
        ((0.9, 1.0), [1]),  # shorter than a window: the nearest
        ((3.5, 3.6), [6]),
        ((1.333, 1.335), [2]),
    ],
)
def test_an_interval_takes_the_windows_whose_middle_it_holds(interval, windows):
    first = np.arange(0, 55, 8)
    middles = (first + np.minimum(first + 8, 55)) / 2 / FPS
    control = Control("", Wanted.of("reach", "low"), *map(float, interval))
    assert np.flatnonzero(control.windows(middles)).tolist() == windows


TERMS = ["left_wrist_height=high", "symmetry=<0.3", "left_wrist_speed= slow", "reach=> .1"]


@settings(max_examples=150, deadline=None)
@given(
    expression=st.recursive(
        st.sampled_from(range(4)),
        lambda inner: st.one_of(
            st.tuples(st.just("not"), inner),
            st.tuples(inner, st.sampled_from(["and", "or"]), inner),
            st.tuples(st.just("("), inner, st.just(")")),
        ),
        max_leaves=6,
    )
)
def test_and_or_not_and_parentheses_mean_what_they_mean_in_python(database, expression):
    def text(part, names):
        return (
            names[part]
            if isinstance(part, int)
            else part
            if isinstance(part, str)
            else " ".join(text(p, names) for p in part)
        )

    signals = ControlSignals(database)
    frames = Control.parse(text(expression, TERMS)).wanted.frames(signals)
    single = [Control.parse(term).wanted.frames(signals) for term in TERMS]
    for at in np.ndindex(2, 20):
        assert frames[at] == eval(text(expression, [str(bool(one[at])) for one in single]))


def test_signals_know_true_neighbours_and_no_false_ones(random_takes):
    """A wrist at 0.6 m/s: the same speed at clips' first frames, none across a gap between two stretches of a take."""
    positions, features = random_takes(np.random.default_rng(0), (200, 150))
    for p in positions:
        p[:, LEFT] = np.arange(len(p))[:, None] * np.array([0.04, 0, 0]) + np.array([0.1, 0.25, 0])
        p[:, RIGHT] = [-0.3, 0.15, 0.4]
    for starts in ([0.0, 200 / FPS], [0.0, 40.0]):
        signals = ControlSignals(Database.from_arrays(positions, features, ["a", "a"], starts=starts))
        np.testing.assert_allclose(signals.values("left_wrist_speed"), 0.6, rtol=1e-4)
    np.testing.assert_allclose(signals.values("right_wrist_speed"), 0, atol=1e-6)
    np.testing.assert_allclose(signals.values("left_wrist_height"), 0.25, rtol=1e-6)
    np.testing.assert_allclose(signals.values("symmetry"), 0.1, rtol=1e-5)
    np.testing.assert_allclose(signals.values("hand_distance")[0, 0], np.sqrt(0.16 + 0.01 + 0.16), rtol=1e-5)
    np.testing.assert_allclose(signals.values("reach")[0, [0, 20]], [0.5, 0.9], rtol=1e-5)


def test_signals_of_a_database_that_is_mapped_into_memory(database, tmp_path):
    database.save(tmp_path / "d.h5")
    mapped = ControlSignals(Database.load(tmp_path / "d.h5"))
    for name in SIGNALS:
        assert np.array_equal(mapped.values(name), ControlSignals(database).values(name))


def test_a_function_of_positions_becomes_a_signal(database, added):
    @added("m")
    def head_height(positions, fps):
        """height of the head"""
        return positions[:, 12, 1]

    knn = KNN(database)
    match = knn.match(np.zeros((40, 28)), controls=["head_height=high"])
    threshold = np.percentile(database.positions[:, :, 12, 1][covered(database)], 85)
    assert (match.positions[::8, 12, 1] >= np.float32(threshold)).all()
    added("m")(lambda positions, fps: positions[:3, 0, 0])
    with pytest.raises(CospeechError, match=r"<lambda>: .*one finite number per frame"):
        knn.match(np.zeros((40, 28)), controls=["<lambda>=high"])


def test_without_candidates_a_control_is_widened_in_named_steps_and_says_so(database, added):
    knn, features = KNN(database), np.zeros((60, 28))
    with pytest.warns(
        CospeechNotice, match="left_wrist_height=>50.* widened to percentile 75 in 4 windows from 2.13 s"
    ):
        match = knn.match(features, controls=["left_wrist_height=>50@2-"], initial="mean")
    assert match.widened.tolist() == [""] * 4 + ["percentile 75"] * 4 and not match.unmasked.any()
    height, upper = left_height(database, 75)
    mask = np.ones((8, *height.shape), bool)
    mask[4:] = height >= upper
    assert found(match) == truth(knn, features, mask=mask)

    added("m")(lambda positions, fps: -positions[:, LEFT, 1])
    SIGNALS["depth"] = SIGNALS.pop("<lambda>")
    with pytest.warns(CospeechNotice, match="no gesture of the database fits; set aside in 8 windows"):
        match = knn.match(features, controls=["left_wrist_height=high", "depth=high"], initial="mean")
    assert match.unmasked.all() and set(match.widened) == {"off"} and found(match) == truth(knn, features)
    assert "left_wrist_height=high, depth=high (off)" in explain(trace_of(match), FPS)


MISTAKES = {
    "left_wrst_height=high": ["left_wrst_height", "left_wrist_height", "reach"],
    "left_wrist_height=fast": ["fast", "low, high", "in m"],
    "left_wrist_speed=>x": [">x", "slow, fast", "m/s"],
    "left_wrist_height=>nan": [">nan"],
    "left_wrist_height=high@5-2": ["5-2", "after"],
    "left_wrist_height=high@600-700": ["600-700", "outside the speech", "4.00 s"],
    "left_wrist_height=high@soon": ["soon", "START-END"],
    "left_wrist_height=high@.-2": [".-2", "START-END"],
    "left_wrist_height=high@-": ["START-END"],
    "left_wrist_height=high and": ["the end"],
    "(left_wrist_height=high": ["the end"],
    "left_wrist_height=high reach=low": ["reach=low", "and, or"],
    "left_wrist_height": ["SIGNAL=LEVEL"],
    "": ["SIGNAL=LEVEL"],
    "left_wrist_height=high and left_wrist_height=low": ["contradicts itself"],
    "not left_wrist_height=high and left_wrist_height=high": ["contradicts itself"],
    "reach=>0.2 and (reach=<0.1 or not reach=>=.2)": ["contradicts itself"],
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_one_line_that_lists_what_is_known(database, text):
    with pytest.raises(CospeechError) as error:
        KNN(database).match(np.zeros((60, 28)), controls=[text])
    assert all(word in str(error.value) for word in MISTAKES[text]) and "\n" not in str(error.value)


def test_contradictions_name_the_two_controls_where_they_meet(database):
    knn = KNN(database)
    high, low = "left_wrist_height=high@1-3", "left_wrist_height=low@2-4"
    with pytest.raises(CospeechError, match=f"'{high}' and '{low}': contradict"):
        knn.match(np.zeros((90, 28)), controls=[high, "reach=high", low])
    match = knn.match(np.zeros((90, 28)), controls=[high, "left_wrist_height=low@3-4"])  # one after the other
    assert not match.unmasked.any()


def test_a_control_of_a_configuration(database):
    entry = {"signal": "left_wrist_height", "level": "high", "start": 2.0, "end": 5.5}
    control = Control.of(entry)
    assert control == Control.parse("left_wrist_height=high@2-5.5")
    assert Control.of({"signal": "reach", "level": ">0.2", "strict": True}) == Control.parse("strict reach=>0.2")
    with pytest.raises(CospeechError, match="'gesture' is not known; give signal, level"):
        Control.of({"keyword": "huge", "gesture": "wide"})
    with pytest.raises(CospeechError, match="either a mask or controls"):
        KNN(database).match(np.zeros((8, 28)), controls=[entry], mask=database.eligible)
    with pytest.warns(CospeechNotice, match="goes on past the speech"):
        KNN(database).match(np.zeros((60, 28)), controls=[entry])


def test_the_configuration_knows_every_signal_and_level(request):
    schema = yaml.safe_load((request.config.rootpath / "workflow/schemas/config.schema.yaml").read_text())
    entries = schema["properties"]["synthesis"]
    control = entries["items"]["properties"]["controls"]["items"]["else"]["properties"]
    assert control["signal"]["enum"] == list(SIGNALS)
    assert set(control["level"]["else"]["enum"]) == {level for s in SIGNALS.values() for level in s.levels}
    good = {"signal": "reach", "level": "high"}

    def accepts(control, model="knn"):
        entry = {"name": "a", "subject": "b", "audio": "c.wav", "model": model, "controls": [control]}
        return Draft202012Validator(entries).is_valid([entry])

    assert accepts(good) and accepts(good | {"level": ">0.2", "start": 2, "end": 5.5, "strict": True}, "resync")
    word = {"keyword": "huge", "gesture": "wide"}
    assert accepts(word) and not accepts(word | {"signal": "reach"}) and not accepts({"keyword": "huge"})
    assert not accepts(good, "regression") and not accepts(word, "regression")
    entry = {"name": "a", "subject": "b", "audio": "c.wav", "model": "knn", "seams": "blend", "words": "w.tsv"}
    entry |= {"replace": [{"start": 1, "end": 2.5, "clip": "d.h5", "at": 3.0}], "gestures": "g.yaml", "recognize": True}
    entries_of = Draft202012Validator(entries)
    assert entries_of.is_valid([entry]) and entries_of.is_valid([entry | {"seams": False}])  # YAML's bare `off`
    assert not entries_of.is_valid([entry | {"seams": "smooth"}])
    assert not entries_of.is_valid([entry | {"replace": [{"start": 1, "clip": "d.h5"}]}])
    assert not accepts(good | {"level": "hgh"}) and not accepts(good | {"start": -1}) and not accepts({"level": "high"})


def test_the_resynchroniser_refines_controlled_motion(database):
    seen = {}

    class Network:
        def run_long(self, features, matched):
            seen["matched"] = matched
            return {"motion": matched}

    resync = Resynchronizer.__new__(Resynchronizer)
    resync.knn, resync.network, resync.build = KNN(database), Network(), None
    features, matches = np.zeros((40, 28), np.float32), []
    resync.generate(features, controls=["left_wrist_height=high"], report=matches.append)
    free = resync.knn.match(features)
    assert matches[0].candidates[0] < (database.eligible.any(axis=1)).sum() and found(matches[0]) != found(free)
    assert len(seen["matched"]) == 40


@pytest.fixture(scope="module", params=["calm", "lively"])
def speaker(request, tmp_path_factory):
    """k-NN of three minutes of a demo speaker, and the speech of a fourth."""
    folder, clips = tmp_path_factory.mktemp("speaker"), []
    for take in range(4):
        files = folder / f"{take}.h5", folder / f"{take}.wav"
        write_take(request.param, take, seconds=60.0, seed=0, truth=files[0], wav=files[1])
        clips.append(read_take(*files, subject=request.param, clip=f"take{take}"))
    return KNN(Database.from_clips(clips[:3])), clips[3].features


@pytest.mark.parametrize(
    "control",
    [
        "left_wrist_height=high",
        "left_wrist_speed=fast",
        "symmetry=asymmetric",
        "strict left_wrist_height=low",
        "strict symmetry=symmetric",
    ],
)
def test_a_controlled_demo_speaker_reaches_the_threshold_and_keeps_moving(speaker, control):
    """The project's figures: mean at or beyond the percentile, deviation at least 40 % of the unconstrained one.

    The lower levels are postures of rest here, without deviation to speak of; `strict` holds them in every frame.
    """
    knn, features = speaker
    name, level = control.removeprefix("strict ").split("=")
    upper = SIGNALS[name].levels[level]
    threshold = knn.signals.percentile(name, 85 if upper else 15)
    free = SIGNALS[name](knn.generate(features).positions, FPS)
    controlled = SIGNALS[name](knn.generate(features, controls=[control]).positions, FPS)
    if upper:
        assert controlled.mean() >= threshold > free.mean()
        assert controlled.std() >= 0.4 * free.std()
    else:
        assert controlled.max() <= np.float32(threshold) < free.mean()


@pytest.fixture(scope="module")
def project(tmp_path_factory, database):
    folder = tmp_path_factory.mktemp("project")
    split_clips({"one": 300, "two": 64, "three": 290}, {}, {"train": 0.8, "test": 0.2}).write(
        folder / "toy" / "split.h5"
    )
    database.save(folder / "toy" / "database.h5")
    (folder / "config.yaml").write_text(f"results_dir: {folder}\nfps: 15\n")
    noise = np.random.default_rng(0).normal(size=64000) * 0.05
    write_wav(folder / "talk.wav", noise.astype(np.float32), 16000)
    return folder


# What these tests know of the search is Algorithm 1's.
PUBLISHED = ["--placement", "published", "--seams", "off", "--audio-rank", "plain"]


def generate(project, *more, model="knn"):
    more = [*more, *(PUBLISHED if model == "knn" else [])]
    return main(
        [
            "generate",
            "--subject",
            "toy",
            "--model",
            model,
            "--audio",
            str(project / "talk.wav"),
            "--out",
            str(project / "o.h5"),
            "--config",
            str(project / "config.yaml"),
            *more,
        ]
    )


def test_command_line_controls_and_explains(project, database, capsys):
    assert generate(project, "--control", "left_wrist_height=high@2-4", "--control", "reach=>0", "--explain") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 2 + 8 and "audio rank" in lines[2] and lines[1] == "seams off, k 1, seed 0"
    assert lines[3].endswith("reach=>0") and lines[9].endswith("left_wrist_height=high@2-4, reach=>0")
    seconds, take, time = lines[9].split()[:3]
    height, high = left_height(database, 85)
    clip = np.flatnonzero((database.take == database.takes.index(take)) & (database.start <= float(time) + 0.01))[-1]
    frame = round((float(time) - database.start[clip]) * FPS)
    assert seconds == "3.20" and height[clip, frame] >= high and height[clip, frame + 7] >= high
    assert np.array_equal(Clip.read(project / "o.h5").positions[48:56], database.positions[clip, frame : frame + 8])


def test_command_line_lists_controls_without_any_other_option(capsys):
    assert main(["generate", "--list-controls"]) == 0
    out = capsys.readouterr().out
    assert all(name in out and s.lower in out and s.upper in out for name, s in SIGNALS.items())


def test_command_line_lists_the_thresholds_of_a_subject(project, database, capsys):
    config = ["--config", str(project / "config.yaml")]
    assert main(["generate", "--list-controls", "--subject", "toy", *config]) == 0
    line = next(row for row in capsys.readouterr().out.splitlines() if row.startswith("left_wrist_height"))
    low, high = (left_height(database, percentile)[1] for percentile in (15, 85))
    assert f"low <= {low:.3f}, high >= {high:.3f}" in line


def test_command_line_mistakes(project, capsys):
    for more, model, word in [
        (["--control", "left=high"], "knn", "left_wrist_height"),
        (["--control", "reach=low@9-10"], "knn", "outside the speech"),
        (["--control", "reach=low"], "regression", "--control"),
        (["--explain"], "gesture_gan", "--explain"),
        (["--k", "0"], "knn", "k is 0"),
    ]:
        assert generate(project, *more, model=model) == 2
        error = capsys.readouterr().err.splitlines()
        assert len(error) == 1 and word in error[0]
