"""HA2G and its baselines from training to long speech: one unit of 34 frames after the other, joined where they meet.

Each unit begins with the last 4 poses of the one before and is faded in over them (Yoon et al. 2020; HA2G's released
code). Where a unit begins in the speech is counted in seconds on every clock, so that nothing drifts.
"""

from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.gestures.generator import Speech
from cospeech.gestures.ha2g.dataset.bones import Proportions, motion_from_vectors
from cospeech.gestures.ha2g.dataset.corpus import FPS, FRAMES, SAMPLES, SEED_FRAMES
from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.gestures.ha2g.dataset.references import SUFFIX, ReferenceFrames
from cospeech.gestures.ha2g.dataset.vocabulary import Vocabulary
from cospeech.learning.weights import OnnxNetwork
from cospeech.speech.mel import COLUMNS, HOP, S2G_COLUMNS, S2G_HOP, column_at, log_mel, log_mel_s2g
from cospeech.speech.mfcc import RATE

HOP_FRAMES = FRAMES - SEED_FRAMES  # from one unit's first frame to the next one's
RANDOM = "random"  # the style that is drawn


class MultiSpeakerGenerator:
    """A network of `models`: speech of any length in, motion out, in the style of any speaker.

    network : path of its ONNX file, or what is called like an `OnnxNetwork` and has a `description`.
    identity : the same of its identity encoder; by default identity.onnx beside the network's file, when it is asked.
    """

    def __init__(self, network, threads=None, identity=None):
        self.identity = identity or (None if callable(network) else Path(network).with_name("identity.onnx"))
        self.network = network if callable(network) else OnnxNetwork(network, threads)
        self.description = about = self.network.description
        self.table = level_table(about["levels"])
        self.speakers = about["speakers"]
        self.inputs = about["inputs"]
        self.vocabulary = Vocabulary(tuple(about["vocabulary"])) if about["vocabulary"] else None
        self.mean = np.array(about["mean"], np.float32)
        self.figures = {name: Proportions.of(lists) for name, lists in about["figures"].items()}

    @classmethod
    def load(cls, name, folder, threads=None):
        """The network `name` of the ensemble whose results lie in `folder`: `ha2g_1`, or `ha2g` of the first seed."""
        return cls(network_folder(name, folder) / "model.onnx", threads)

    def generate(self, speech, *, style=None, initial=RANDOM, seed=0):
        """Speech -> Motion of round(duration * 15) frames.

        Words of the speech are heard by networks that hear them; None leaves them unheard.
        style : {speaker: weight}, "calm", "calm=0.7,lively=0.3", or "random" for a style vector drawn from the normal
            distribution; None is every speaker's by the same weight. A speaker may be a file of reference frames
            (.h5), of whomever, if the network knows speakers by reference frames.
        initial : the poses before the first frame, "random" from the training part or "mean". seed : of what is drawn.

        The motion's bones are those of the style's speakers, mixed by weight (of all, where
        the style has none of them).
        """
        speech = Speech.of(speech)
        frames = len(speech)
        (weights, unseen), rng = self.weights_of(style), np.random.default_rng(seed)
        given = {"seed": self._initial(initial, weights, rng)[None], "speaker": weights[None].astype(np.float32)}
        if "style" in self.inputs:
            vector = rng.standard_normal(self.inputs["style"]) if style == RANDOM else self._unseen_style(unseen)
            given["style"] = vector[None].astype(np.float32)
        conditions = self._conditions(speech, frames)
        poses = self._units(conditions, given, unit_starts(frames))[:frames]
        vectors = (poses + self.mean).reshape(len(poses), -1, 3)
        shares = weights if weights.any() else np.full(len(weights), 1 / len(weights))
        shares = shares / shares.sum() if unseen else shares
        figure = Proportions.mixed([self.figures[name] for name in self.speakers], shares)
        return motion_from_vectors(vectors, self.table, figure)

    def weights_of(self, style):
        """A style as weights over the speakers, (S,), and {file of reference frames: weight}.

        All together sum to one, or to zero for "random".
        """
        if style == RANDOM:
            return np.zeros(len(self.speakers)), {}
        weights = parse_style(style) if isinstance(style, str) else style or dict.fromkeys(self.speakers, 1.0)
        unseen = {name: weight for name, weight in weights.items() if name not in self.speakers}
        for name in unseen:
            if Path(name).suffix != SUFFIX:
                raise CospeechError(f"style: no speaker {name!r}; known: {', '.join(self.speakers)}, or {RANDOM}")
            self._check_reference_frames(name)
        given = np.array([weights.get(name, 0.0) for name in self.speakers])
        total = given.sum() + sum(unseen.values())
        return given / total, {name: weight / total for name, weight in unseen.items()}

    def _check_reference_frames(self, name):
        if "picture" not in self.description:
            raise CospeechError(
                f"style: {name}: {self.description['model']} knows its speakers ({', '.join(self.speakers)}) by name, "
                "not by reference frames; train ha2g with ensemble.identity: frames"
            )

    def style_vector(self, path):
        """The mean style vector (Z,) of whoever a file of reference frames shows."""
        pictures, side = ReferenceFrames.read(path).pictures, self.description["picture"]
        if pictures.shape[1] != side:
            raise CospeechError(f"{path}: {pictures.shape[1]} pixels wide, the network knows pictures of {side}")
        if not callable(self.identity):
            self.identity = OnnxNetwork(self.identity)
        return self.identity(pictures=pictures.transpose(0, 3, 1, 2))[0].mean(axis=0)

    def _unseen_style(self, unseen):
        """What is added to the style of the known speakers (Z,): that of the others, by weight."""
        return sum(
            (weight * self.style_vector(path) for path, weight in unseen.items()), np.zeros(self.inputs["style"])
        )

    def _initial(self, initial, weights, rng):
        """(4, 3V) poses before the first frame, of one of the style's speakers."""
        if initial not in (RANDOM, "mean"):
            raise CospeechError(f"initial: {initial!r} is not known; known: {RANDOM}, mean")
        starts = self.description["starts"]
        chances = weights[starts["speaker"]] if weights.any() else np.ones(len(starts["speaker"]))
        which = rng.choice(len(chances), p=chances / chances.sum()) if chances.any() else None
        if initial == "mean" or which is None:
            return np.zeros(self.inputs["seed"], np.float32)
        return np.array(starts["poses"][which], np.float32)

    def _conditions(self, speech, frames):
        """{input: function of a unit's first frame} for what this network takes of the speech."""
        import soxr

        if speech.samples is None:
            raise CospeechError(f"{self.description['model']}: hears the sound itself, and features alone are given")
        samples, words = np.asarray(speech.samples, np.float32), speech.words
        samples = samples if speech.rate == RATE else soxr.resample(samples, speech.rate, RATE, quality="HQ")
        reach = round(unit_starts(frames)[-1] / FPS * RATE) + SAMPLES + 2 * HOP
        samples = np.pad(samples, (0, max(0, reach - len(samples))))
        conditions = {}
        if "mel" in self.inputs:
            mel = log_mel(samples)
            conditions["mel"] = lambda frame: _cut(mel, column_at(frame / FPS, HOP), COLUMNS)
        if "s2g_mel" in self.inputs:
            s2g = log_mel_s2g(samples)
            conditions["s2g_mel"] = lambda frame: _cut(s2g, column_at(frame / FPS, S2G_HOP), S2G_COLUMNS).T
        if "wave" in self.inputs:
            conditions["wave"] = lambda frame: _cut(samples, round(frame / FPS * RATE), SAMPLES)
        if "words" in self.inputs:
            if words is None or not len(words):
                notice(f"{self.description['model']} hears words, and the speech has none: give --words or --recognize")
            numbers = np.zeros(unit_starts(frames)[-1] + FRAMES, np.float32)
            if words is not None:
                numbers[:frames] = self.vocabulary.frames(words, frames, FPS)
            conditions["words"] = lambda frame: numbers[frame : frame + FRAMES]
        return conditions

    def _units(self, conditions, given, starts):
        """Every unit's poses, each begun with the last poses of the one before, joined: (34 + 30 (K - 1), 3V)."""
        units = []
        for frame in starts:
            arrays = {name: cut(frame)[None] for name, cut in conditions.items()} | given
            units.append(self.network(**{name: arrays[name] for name in self.inputs})[0][0])
            given["seed"] = units[-1][None, -SEED_FRAMES:]
        return cross_fade(units)


def network_folder(name, folder):
    """Where an ensemble's network lies, by its name, `ha2g_1`, or by its row alone, `ha2g`: the first seed's."""
    trained = sorted(file.parent for file in Path(folder).glob("models/*/model.onnx"))
    for network in trained:
        if name in (network.name, network.name.rpartition("_")[0]):
            return network
    known = ", ".join(network.name for network in trained) or "none; make them with config/ha2g.yaml first"
    raise CospeechError(f"model {name!r}: not trained for {Path(folder).name}; trained there: {known}")


def unit_starts(frames):
    """First frames of the units that make a motion of this length: 0, 30, 60, ..."""
    return np.arange(0, max(1, frames - SEED_FRAMES), HOP_FRAMES)


def cross_fade(units, over=SEED_FRAMES):
    """Join units whose first `over` frames lie on the last ones of the unit before: (K x (34, C)) -> (T, C).

    Frame j of the overlap is prev (n - j) / (n + 1) + next (j + 1) / (n + 1), n = over.
    """
    share = (np.arange(over, dtype=np.float32)[:, None] + 1) / (over + 1)
    joined = [units[0]]
    for unit in units[1:]:
        before = joined[-1][-over:]
        joined[-1] = joined[-1][:-over]
        joined.append(np.concatenate([before * (1 - share) + unit[:over] * share, unit[over:]]))
    return np.concatenate(joined)


def parse_style(text):
    """ "calm=0.7,lively=0.3", or one name, as {speaker: weight}."""
    weights = {}
    for part in text.split(","):
        name, _, weight = (piece.strip() for piece in part.partition("="))
        try:
            weights[name] = float(weight or 1.0)
        except ValueError:
            weights[name] = -1.0
        if not name or not 0 <= weights[name] < np.inf:
            raise CospeechError(f"style: {text!r} is not understood; write it like calm=0.7,lively=0.3")
    if not sum(weights.values()):
        raise CospeechError(f"style: {text!r} weighs nobody; give one speaker a weight over 0")
    return weights


def _cut(array, start, length):
    return array[..., start : start + length]
