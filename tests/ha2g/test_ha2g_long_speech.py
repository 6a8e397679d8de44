"""Long speech: the right sound at every time, seams that join, any length, and styles by name and weight.

Known functions stand where networks do, so that what is generated can be foretold.
"""

import numpy as np
import pytest

from cospeech.clip import Words
from cospeech.errors import CospeechError
from cospeech.gestures.generator import Speech
from cospeech.gestures.ha2g.dataset.bones import Proportions, bone_vectors
from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.gestures.ha2g.dataset.vocabulary import Vocabulary
from cospeech.gestures.ha2g.long_speech import MultiSpeakerGenerator, cross_fade, parse_style, unit_starts
from cospeech.skeleton import UPPER55
from cospeech.synthesis import synthesize
from tests.conftest import make_clip

RATE = 16000
FRAME = np.arange(34)
TABLE = level_table("ted10")
ARM = 5  # the vector that shows what the network heard: an angle about the forward axis
SHAPES = {
    "mel": (128, 70),
    "wave": (36267,),
    "s2g_mel": (225, 64),
    "words": (34,),
    "seed": (4, 27),
    "speaker": (2,),
    "style": (3,),
}


class Known:
    """Poses whose left forearm points to an angle (1, 34) that `angle` finds in the inputs; all else points up."""

    def __init__(self, angle, description):
        self.angle, self.description = angle, description

    def __call__(self, **inputs):
        angle = np.broadcast_to(self.angle(**inputs), (1, 34))
        poses = np.zeros((1, 34, 9, 3), np.float32)
        poses[..., 1] = 1
        poses[..., 2] = np.linspace(-0.3, 0.3, 9)  # not all in one line
        poses[:, :, ARM] = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=2)
        return [poses.reshape(1, 34, 27)]


def figure(seed):
    """Some speaker's build."""
    rest = make_clip(seed, 2).positions[0]
    return Proportions(TABLE.lengths * (1 + 0.1 * seed), rest, np.array([[0.0, -0.1, -0.04], [0.0, 0.14, 0.0]]))


def generator(angle, *inputs):
    """A MultiSpeakerGenerator of a function of some inputs."""
    start = np.tile([0.0, 1.0, 0.0], (4, 9))
    about = {
        "model": "known",
        "levels": "ted10",
        "inputs": {name: list(SHAPES[name]) for name in inputs},
        "speakers": ["ann", "bob"],
        "vocabulary": Vocabulary.of(["tick", "tock", "tock"]).words,
        "mean": [0.0] * 27,
        "starts": {"poses": [start.tolist()] * 2, "speaker": [0, 1]},
        "figures": {"ann": figure(0).lists(), "bob": figure(1).lists()},
    }
    return MultiSpeakerGenerator(Known(angle, about), 1)


def arm_angles(motion):
    """What the network said at every frame."""
    arm = bone_vectors(motion.positions, motion.rotation, TABLE)[:, ARM]
    return np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))


def test_a_ramp_of_a_minute_is_heard_where_it_is():
    """The public code reads the spectrogram 14.6 times too slowly at 60 s: it takes its bins for its columns."""
    samples = np.arange(60 * RATE, dtype=np.float32) / (60 * RATE)
    where = np.rint(FRAME / 15 * RATE).astype(int)
    ramp = generator(lambda wave, seed: wave[:, where], "wave", "seed")
    found = arm_angles(ramp.generate(Speech(samples, RATE)))
    np.testing.assert_allclose(found, np.arange(900) / 15 / 60, atol=2e-5)


@pytest.mark.parametrize("kind", ["mel", "s2g_mel"])
def test_clicks_of_a_minute_are_heard_when_they_click(kind):
    """Clicks as long as a frame at odd times: the arm moves at their frames and rests at all others."""
    times, length = np.arange(1.3, 60, 3.7), RATE // 15
    samples = np.zeros(60 * RATE, np.float32)
    for begin in np.rint(times * RATE).astype(int):
        samples[begin : begin + length] = np.random.default_rng(0).normal(0, 0.1, length)
    column = np.rint(FRAME / 15 * RATE / (512 if kind == "mel" else 160)).astype(int)
    if kind == "mel":
        listen = lambda mel, seed: (mel[:, :, column].mean(1) + 80) / 80
    else:
        column = np.minimum(column, 224)
        listen = lambda s2g_mel, seed: (s2g_mel[:, column].mean(2) + 14) / 14
    found = arm_angles(generator(listen, kind, "seed").generate(Speech(samples, RATE)))
    heard = np.flatnonzero(found > 0.2)
    late = heard[:, None] / 15 - times[None]
    assert np.abs(late).min(axis=1).max() < 1.6 / 15, "nothing is heard elsewhere"
    assert np.abs(late).min(axis=0).max() < 1.1 / 15, "every click is heard"


def test_words_are_heard_at_their_frames():
    start = np.array([0.2, 3.05, 29.99, 44.0])
    words = Words(start, start + 0.1, ["tick", "tock", "tick", "tock"])
    network = generator(lambda words, seed: words / 10, "words", "seed")
    found = arm_angles(network.generate(Speech(np.zeros(50 * RATE, np.float32), RATE, words)))
    numbers = {int(i): round(found[i] * 10) for i in np.flatnonzero(found > 0.05)}
    assert numbers == {3: 5, 45: 4, 449: 5, 660: 4}  # the more frequent word has the lower number


def test_units_begin_where_the_last_ones_end():
    """A network that turns on from the seed by 0.01 a frame turns evenly through all of 20 s."""
    turn = lambda seed: np.arctan2(seed[:, :1, 3 * ARM + 1], seed[:, :1, 3 * ARM]) + 0.01 * FRAME
    found = arm_angles(generator(turn, "seed").generate(Speech(np.zeros(20 * RATE, np.float32), RATE)))
    np.testing.assert_allclose(np.diff(found), 0.01, atol=1e-3)


def test_cross_fade_is_the_published_one():
    units = [np.zeros((34, 1), np.float32), np.ones((34, 1), np.float32), np.full((34, 1), 3, np.float32)]
    joined = cross_fade(units)[:, 0]
    assert len(joined) == 34 + 30 + 30
    np.testing.assert_allclose(joined[28:36], [0, 0, 0.2, 0.4, 0.6, 0.8, 1, 1], atol=1e-6)
    np.testing.assert_allclose(joined[60:64], [1.4, 1.8, 2.2, 2.6], atol=1e-6)


@pytest.mark.parametrize("seconds", [0.07, 0.5, 2.0, 34 / 15, 35 / 15, 600.0])
def test_any_length_gives_as_many_frames(seconds):
    samples = np.random.default_rng(0).normal(0, 0.1, round(seconds * 22050)).astype(np.float32)
    network = generator(lambda seed, speaker: seed[:, :1, 0], "seed", "speaker")
    motion = network.generate(Speech(samples, 22050))
    assert len(motion) == round(seconds * 15) and np.isfinite(motion.positions).all()
    assert not motion.positions[:, UPPER55.root].any()


def test_every_frame_is_in_a_unit():
    for frames in range(1, 400):
        starts = unit_starts(frames)
        assert starts[-1] + 34 >= frames > starts[-1] + (4 if len(starts) > 1 else 0)
        assert (np.diff(starts) == 30).all()


def test_styles_are_mixed_by_name_and_weight():
    network = generator(lambda seed, speaker, style: speaker @ [[0.2], [1.0]], "seed", "speaker", "style")
    sound = np.zeros(RATE, np.float32)
    said = lambda style: arm_angles(network.generate(Speech(sound, RATE), style=style)).mean()
    assert said("ann") == pytest.approx(0.2, abs=1e-5)
    assert said("ann=3,bob=1") == pytest.approx(0.4, abs=1e-5)
    assert said({"bob": 2.0}) == pytest.approx(1.0, abs=1e-5)
    assert said(None) == pytest.approx(0.6, abs=1e-5)


def test_a_drawn_style_is_of_the_seed():
    angle = lambda seed, speaker, style: 9 * speaker[:, :1] + 0.1 * style[:, :1]
    network = generator(angle, "seed", "speaker", "style")
    sound = np.zeros(RATE, np.float32)
    drawn = [arm_angles(network.generate(Speech(sound, RATE), style="random", seed=seed)).mean() for seed in range(30)]
    again = arm_angles(network.generate(Speech(sound, RATE), style="random", seed=4)).mean()
    assert again == drawn[4] and len(set(drawn)) == 30
    assert 0.05 < np.std(drawn) < 0.16 and abs(np.mean(drawn)) < 0.06, "normal, and of no speaker"


@pytest.mark.parametrize(
    ("style", "line"),
    [
        ("carl", "no speaker 'carl'; known: ann, bob, or random"),
        ("ann=much", "not understood"),
        ("ann=-1", "not understood"),
        ("ann=0", "weighs nobody"),
        ("ann=nan", "not understood"),
        ("", "not understood"),
    ],
)
def test_wrong_styles_are_one_line(style, line):
    network = generator(lambda seed, speaker: seed[:, :1, 0] + speaker[:, :1], "seed", "speaker")
    with pytest.raises(CospeechError, match=line):
        network.generate(Speech(np.zeros(RATE, np.float32), RATE), style=style)
    assert parse_style("ann=0.7, bob=0.3") == {"ann": 0.7, "bob": 0.3}


def test_the_result_is_a_clip_like_any_other(tmp_path):
    network = generator(lambda seed, speaker: seed[:, :1, 0] + speaker[:, :1], "seed", "speaker")
    samples = np.random.default_rng(0).normal(0, 0.1, 3 * RATE).astype(np.float32)
    clip = synthesize(
        network, Speech(samples, RATE), subject="everyone", clip="talk", model="known_0", smoothing=0.0, style="ann"
    )
    clip.write(tmp_path / "talk.h5")
    assert (clip.frames, clip.generator, clip.fps) == (45, "known_0", 15.0)
    np.testing.assert_array_equal(
        clip.positions, network.generate(Speech(samples, RATE), style="ann").whole().positions
    )
