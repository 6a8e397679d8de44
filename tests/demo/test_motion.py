"""The virtual speaker's body and face: anatomy, synchrony, variety, and the difference between the two speakers."""

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cospeech.demo import write_take
from cospeech.demo.lexicon import lexicon, speaker_parameters
from cospeech.demo.motion import interpolate
from cospeech.face.expressions import COSPEECH64
from cospeech.skeleton import UPPER55, to_parent_relative

SECONDS, FPS = 120.0, 60
WRISTS = UPPER55.joints("right_wrist", "left_wrist")


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    """{speaker: {dataset: array}} of one take of two minutes each."""
    folder, takes = tmp_path_factory.mktemp("motion"), {}
    for speaker in ("calm", "lively"):
        truth = folder / f"{speaker}.h5"
        write_take(speaker, 3, seconds=SECONDS, seed=1, wav=folder / f"{speaker}.wav", truth=truth)
        content = takes.setdefault(speaker, {})
        with h5py.File(truth) as file:
            content.update({f"{group}/{name}": item[()] for group in file for name, item in file[group].items()})
        content["positions"] = content["motion/positions"].astype(float)
        content["speed"] = np.linalg.norm(np.gradient(content["positions"][:, WRISTS], 1 / FPS, axis=0), axis=-1)
    return takes


@pytest.fixture(params=["calm", "lively"])
def take(request, takes):
    return takes[request.param]


def test_every_number_is_finite(take):
    assert all(np.isfinite(a).all() for a in take.values() if a.dtype.kind == "f")


def test_bones_keep_their_lengths(take):
    lengths = np.linalg.norm(to_parent_relative(take["positions"]), axis=-1)
    lengths[:, UPPER55.root] = 0
    assert np.ptp(lengths, axis=0).max() < 1e-6
    assert lengths[0, UPPER55.index["right_elbow"]] == pytest.approx(lengths[0, UPPER55.index["left_elbow"]], abs=1e-6)


def test_arms_stay_within_reach_and_elbows_bend_forward(take):
    for side in ("right", "left"):
        joints = UPPER55.joints(*(f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist")))
        shoulder, elbow, wrist = take["positions"][:, joints].transpose(1, 0, 2)
        upper, fore = ((b - a) / np.linalg.norm(b - a, axis=1)[:, None] for a, b in ((shoulder, elbow), (elbow, wrist)))
        bend = np.degrees(np.arccos(np.sum(upper * fore, axis=1)))
        assert bend.min() > 5 and bend.max() < 150
        assert (elbow[:, 1] < shoulder[:, 1] + 0.06).all()  # elbows are never lifted over the shoulders


def test_hands_are_never_inside_the_trunk(take):
    hands = take["positions"][:, 13:]
    beside = (hands[..., 1] > -0.1) & (hands[..., 1] < 0.42)  # hip to armpit
    radius = np.linalg.norm(hands[..., [0, 2]] / [0.14, 0.10], axis=-1)
    assert radius[beside].min() > 1.0
    assert np.linalg.norm(hands - take["positions"][:, [UPPER55.index["head"]]], axis=-1).min() > 0.10


def test_fingers_bend_only_towards_the_palm(take):
    """The angle between a finger's bones stays within what a hand can do, and hands close, open and point."""
    bones = lambda side, finger: np.diff(
        take["positions"][:, UPPER55.joints(*(f"{side}_{finger}_{i}" for i in range(4)))], axis=1
    )
    bent = {}
    for finger in ("index", "middle"):
        b = bones("right", finger)
        b /= np.linalg.norm(b, axis=-1, keepdims=True)
        bent[finger] = np.degrees(np.arccos(np.clip(np.sum(b[:, 0] * b[:, 1], -1), -1, 1)))
        assert bent[finger].max() < 110
    assert (bent["index"] > 70).any() and (bent["index"] < 10).any()
    assert ((bent["index"] < 20) & (bent["middle"] > 70)).mean() > 0.001


def test_the_head_joints_turn_with_the_head_rotation(take):
    up = take["positions"][:, UPPER55.index["head_top"]] - take["positions"][:, UPPER55.index["neck"]]
    unturned = Rotation.from_rotvec(take["face/rotation"]).inv().apply(up)
    assert np.ptp(unturned, axis=0).max() < 1e-5
    assert 3 < np.degrees(np.linalg.norm(take["face/rotation"], axis=1)).max() < 75


def test_strokes_meet_the_stressed_words(take):
    """Fast before, slow after the accent: the wrist brakes into the vowel. Shuffled in time, that is gone."""
    speed = take["speed"].sum(axis=1)
    accents = take["words/accent_time"][take["words/stressed"]]

    def braking(times):
        before, after = (np.interp(times + shift, np.arange(len(speed)) / FPS, speed) for shift in (-0.12, 0.06))
        return (before - after).mean()

    rng = np.random.default_rng(0)
    shuffled = [braking((accents + shift) % SECONDS) for shift in rng.uniform(2, SECONDS - 2, 200)]
    assert braking(accents) > np.mean(shuffled) + 6 * np.std(shuffled)


def test_gestures_have_their_phases_in_order(take):
    phases = np.stack([take[f"gestures/{p}"] for p in ("prep", "stroke", "apex", "hold", "retract", "end")])
    assert (np.diff(phases, axis=0) > -0.15).all()  # the left hand may lag, a shortened stroke start late
    assert (phases[5] > phases[0]).all() and (np.diff(phases[2]) > 0.4).all()
    apex, word = take["gestures/apex"], take["gestures/word"]
    inside = (apex > take["words/start"][word] - 0.1) & (apex < take["words/end"][word] + 0.1)
    assert inside.all()


def test_louder_and_higher_accents_get_larger_gestures(take):
    assert np.corrcoef(take["gestures/strength"], take["gestures/size"])[0, 1] > 0.5
    near = [take["speed"][int((t - 0.3) * FPS) : int(t * FPS)].max() for t in take["gestures/apex"] if t > 0.5]
    strong = take["gestures/strength"][take["gestures/apex"] > 0.5] > np.median(take["gestures/strength"])
    assert np.mean(np.array(near)[strong]) > np.mean(np.array(near)[~strong])


def test_hands_move_more_while_speaking(take):
    times = np.arange(int(SECONDS * FPS)) / FPS
    since = times - take["words/end"][np.clip(np.searchsorted(take["words/start"], times) - 1, 0, None)]
    speed = take["speed"].sum(axis=1)
    assert speed[since < 0].mean() > 1.25 * speed[since > 0.6].mean()


def test_lively_moves_more_faster_and_higher_than_calm(takes):
    calm, lively = takes["calm"], takes["lively"]
    assert lively["speed"].mean() > 1.5 * calm["speed"].mean()
    assert len(lively["gestures/apex"]) > 1.3 * len(calm["gestures/apex"])
    assert np.percentile(lively["speed"], 99) > 1.4 * np.percentile(calm["speed"], 99)
    reach = lambda take: np.percentile(take["positions"][:, WRISTS, 1], 95)
    assert reach(lively) > reach(calm) + 0.05


def test_the_same_words_are_gestured_in_several_ways(tmp_path):
    forms, hands = {}, {}
    for take in range(4):
        write_take("lively", take, seconds=90.0, seed=5, wav=tmp_path / "a.wav", truth=tmp_path / "a.h5")
        with h5py.File(tmp_path / "a.h5") as file:
            words = file["words/text"].asstr()[()]
            columns = file["gestures/word"], file["gestures/form"].asstr()[()], file["gestures/hand"].asstr()[()]
            for word, form, hand in zip(*columns, strict=True):
                forms.setdefault(words[word].lower(), []).append(form)
                hands.setdefault(form, set()).add(hand)
    often = {word: found for word, found in forms.items() if len(found) >= 3}
    assert len(often) >= 8
    assert np.mean([len(set(found)) >= 2 for found in often.values()]) > 0.7
    assert {"right", "left"} <= hands["beat"]
    linked = [form in lexicon().keywords[w] for w, found in forms.items() if w in lexicon().keywords for form in found]
    assert np.mean(linked) > 0.6


def test_keywords_name_known_strokes():
    known = lexicon().strokes
    for word, links in lexicon().keywords.items():
        assert links.keys() <= known.keys(), word
    for speaker in ("calm", "lively"):
        style = speaker_parameters(speaker)["gestures"]
        assert style["forms"].keys() <= known.keys() and style["rests"].keys() == lexicon().rests.keys()


def test_minimum_jerk_passes_its_keys_and_rests_in_them():
    times, values = np.array([0.0, 0.5, 1.5]), np.array([[0.0], [1.0], [3.0]])
    still = np.zeros(3, bool)
    assert np.allclose(interpolate(times, values, still, times), values)
    at = np.linspace(0.5, 1.5, 1001)
    course = interpolate(times, values, still, at)[:, 0]
    assert np.diff(course)[[0, -1]] == pytest.approx(0, abs=1e-6)
    assert np.diff(course).max() / 0.001 == pytest.approx(1.875 * 2, rel=1e-3)
    passed = interpolate(times, values, np.array([False, True, False]), np.array([0.4999, 0.5, 0.5001]))[:, 0]
    assert np.diff(passed) / 1e-4 == pytest.approx([2.0, 2.0], rel=1e-3)


def test_the_jaw_opens_for_open_vowels_and_lips_close_for_labials(take):
    jaw = take["face/expression"][:, COSPEECH64.index("jaw_open")]
    press = take["face/expression"][:, COSPEECH64.index("mouth_press_left")]
    ipa = np.array([p.decode() for p in take["phonemes/ipa"]])
    middle = np.clip(((take["phonemes/start"] + take["phonemes/end"]) / 2 * FPS).astype(int), 0, len(jaw) - 1)
    opened = np.isin([p[:1] for p in ipa], list("aɑæʌɛɔɒ"))  # noqa: RUF001
    closed = np.isin(ipa, ["p", "b", "m"])
    assert jaw[middle][opened].mean() > 2.5 * jaw[middle][closed].mean()
    assert press[middle][closed].mean() > 3 * press[middle][opened].mean()


def test_the_mouth_is_still_in_silence(take):
    times = np.arange(int(SECONDS * FPS)) / FPS
    last = np.clip(np.searchsorted(take["words/start"], times + 0.25) - 1, 0, None)
    silent = times - take["words/end"][last] > 0.3
    mouth = [i for i, name in enumerate(COSPEECH64) if name.startswith(("jaw", "tongue", "mouth_p", "mouth_f"))]
    assert silent.sum() > 2 * FPS
    assert take["face/expression"][silent][:, mouth].max() < 0.06


def test_the_face_blinks_and_stays_in_range(take):
    expression = take["face/expression"]
    assert expression.min() >= 0 and expression.max() <= 1
    closed = expression[:, COSPEECH64.index("eye_blink_left")] > 0.7
    blinks = (np.diff(closed.astype(int)) == 1).sum()
    assert 8 < blinks / SECONDS * 60 < 50
    assert expression[:, COSPEECH64.index("brow_inner_up")].max() > 0.3
