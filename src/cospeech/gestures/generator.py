"""The one door of every generator: `Speech` in, `Motion` out, and `MODELS`, in which each is written down once.

A generator of one's own is an entry of `MODELS` whose `generator` has a class method `load(name, folder, threads)` and
`generate(speech, *, seed=0, **options) -> Motion`; commands, configuration, workflow and tables follow from the entry.
"""

import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Protocol

import numpy as np

from cospeech.clip import Motion, Words
from cospeech.errors import CospeechError
from cospeech.speech import integrated_loudness, load_audio, speech_features, words_of_speech

SMOOTHING = 1.5  # frames; published Gaussian on body, hands and head rotation at 15 Hz (thesis section 4.3)
MATCHING = ("k", "initial", "placement", "control", "keyword", "gestures", "seams", "audio_rank", "explain")


@dataclass
class Speech:
    """What is spoken, on the clock of the motion that goes with it; what is made of it is made when first asked for.

    samples (N,) float32 mono at `rate` Hz, or None where there are but features. words : `Words`, or None where nobody
    knows them. fps : frames of motion a second. path : the file that it was read from, or "".
    """

    samples: np.ndarray | None = None
    rate: int = 0
    words: Words | None = None
    fps: float = 15.0
    path: str = ""
    known_features: np.ndarray | None = field(default=None, repr=False)

    @classmethod
    def load(cls, path, fps=15.0, words=None, recognize=False):
        """From any sound file. words : `Words`, or the file that has them; None looks beside the sound, and recognises
        them if that is asked and nothing is found."""
        samples, rate = load_audio(path)
        if not isinstance(words, Words):
            words = words_of_speech(path, samples, rate, words, recognize)
        return cls(samples, rate, words, fps, str(path))

    @classmethod
    def of(cls, speech):
        """A Speech as it is, a Clip's, or nothing but features (T, 28)."""
        if isinstance(speech, cls):
            return speech
        if hasattr(speech, "features"):
            return cls(words=speech.words, fps=speech.fps, known_features=speech.features)
        return cls(known_features=np.asarray(speech))

    def __len__(self):
        """T, frames of motion: round(duration * fps)."""
        if self.samples is None:
            return len(self.known_features)
        return round(len(self.samples) / self.rate * self.fps)

    @cached_property
    def features(self):
        """(T, 28) float32 speech features, see `cospeech.speech.speech_features`."""
        if self.known_features is not None:
            return self.known_features
        return speech_features(self.samples, self.rate, self.fps, len(self))

    @cached_property
    def loudness(self):
        """Integrated loudness in LUFS."""
        return integrated_loudness(self.samples, self.rate)

    def check_length(self):
        """CospeechError unless there is at least one frame."""
        if not len(self):
            seconds = len(self.samples) / self.rate
            raise CospeechError(
                f"{Path(self.path).name}: {seconds:.3f} s of sound is less than one frame at {self.fps} fps"
            )


class Generator(Protocol):
    """Speech in, motion out."""

    def generate(self, speech: Speech, *, seed: int = 0) -> Motion:
        """Motion of len(speech) frames; whoever draws at random draws from `seed` alone."""
        ...


@dataclass
class Recordings:
    """What a network learns from: `clips` of one speaker's training part, or the `corpus` of many.

    starts : seconds at which each clip begins in its take; None when all begin at 0. database : of the clips, for
    models that need it. imagenet : path of weights to start an image encoder from. control : {signal: list of (T,)}.
    """

    clips: list = field(default_factory=list)
    starts: list | None = None
    database: object = None
    corpus: object = None
    imagenet: str | None = None
    control: dict = field(default_factory=dict)

    @property
    def who(self):
        """Names of the first speakers."""
        return "+".join(self.corpus.speakers[:3]) if self.corpus is not None else self.clips[0].subject

    def digest(self):
        """Bytes that differ where a training's result would."""
        of_clips = b"".join(clip.features.tobytes() + clip.positions.tobytes() for clip in self.clips)
        of_corpus = "" if self.corpus is None else self.corpus.digest() + str(self.imagenet or "")
        return of_clips + of_corpus.encode()


@dataclass(frozen=True)
class Model:
    """A generator as everything that lists generators knows it.

    label : what tables call it. about : one line for people. source : where it was published.
    generator : "module:class", loaded when it is needed. task : "module:function" of (name, recordings, settings, seed)
        that makes its training; "" where nothing is trained. section : of the budget; the name where it is "".
    defaults : keys of that section where its own are not the network's. changes : keys that make a table's row of a
        model, and of : which model that is.
    learns : from one "speaker", or from many "speakers" together.
    needs : what it generates from besides its network: "database", "audio_rank" (the learned one), "clips".
    options : what `cospeech generate` and a `synthesis:` entry may ask of it. signal : what it is told to control.
    smoothing : sigma in frames of the Gaussian over its motion.
    """

    label: str
    about: str
    generator: str
    source: str = ""
    task: str = ""
    section: str = ""
    defaults: dict = field(default_factory=dict)
    changes: dict = field(default_factory=dict)
    of: str = ""
    learns: str = "speaker"
    needs: tuple = ()
    options: tuple = ()
    signal: str = ""
    smoothing: float = SMOOTHING


CHAPTER4 = {
    "generator": "cospeech.gestures.chapter4.inference:GestureGenerator",
    "task": "cospeech.gestures.chapter4.models:training_task",
}
MOGLOW = CHAPTER4 | {
    "generator": "cospeech.gestures.chapter4.inference:Sampler",
    "section": "moglow",
    "source": "Alexanderson et al. 2020",
}
CONTROLLED = MOGLOW | {
    "generator": "cospeech.matching.control.controlled_sampler:ControlledSampler",
    "options": ("control",),
}
SEARCH = {"needs": ("database", "audio_rank"), "options": MATCHING, "source": "thesis section 5.3"}
MANY = {
    "generator": "cospeech.gestures.ha2g.long_speech:MultiSpeakerGenerator",
    "task": "cospeech.gestures.ha2g.models:training_task",
    "learns": "speakers",
    "options": ("style", "initial"),
    "smoothing": 0.0,
}
MODELS = {
    "regression": Model(
        "Direct regression",
        "chapter 4's network without a discriminator",
        source="thesis section 4.5",
        defaults={"adversary": "none"},
        **CHAPTER4,
    ),
    "lstm": Model(
        "LSTM",
        "an LSTM each for face, body and hands",
        source="thesis section 4.5, after Shlizerman et al. 2018",
        **CHAPTER4,
    ),
    "velocity_gan": Model(
        "Velocity adversarial",
        "chapter 4's network with a discriminator on velocities",
        source="thesis section 4.5, after Ginosar et al. 2019",
        defaults={"adversary": "velocity"},
        **CHAPTER4,
    ),
    "gesture_gan": Model(
        "Habibie et al. 2021",
        "chapter 4: a speech encoder, three decoders, and a discriminator on speech and pose",
        source="IVA 2021, thesis section 4.4",
        **CHAPTER4,
    ),
    "moglow": Model("MoGlow", "a normalising flow, which draws motion at random", **MOGLOW),
    "moglow_height": Model(
        "MoGlow, wrist height", "MoGlow that is told the left wrist's height", signal="left_wrist_height", **CONTROLLED
    ),
    "moglow_speed": Model(
        "MoGlow, wrist speed", "MoGlow that is told the left wrist's speed", signal="left_wrist_speed", **CONTROLLED
    ),
    "moglow_symmetry": Model(
        "MoGlow, symmetry", "MoGlow that is told the hands' symmetry", signal="symmetry", **CONTROLLED
    ),
    "knn": Model(
        "k-NN, seams inertialised",
        "the speaker's own recordings, found eight frames at a time (Algorithm 1), set to look best",
        generator="cospeech.matching.knn:KNN",
        smoothing=0.0,
        **SEARCH,
    ),
    "knn_published": Model(
        "k-NN, pose pre-selected",
        "Algorithm 1 as published",
        generator="cospeech.matching.knn:PublishedKNN",
        smoothing=0.0,
        **SEARCH | {"needs": ("database",)},
    ),
    "resync": Model(
        "k-NN + cGAN",
        "the search, refined by a conditional GAN",
        generator="cospeech.matching.resync.refine:Resynchronizer",
        task="cospeech.matching.resync.gan:training_task",
        **SEARCH,
    ),
    "mean_pose": Model(
        "Mean pose",
        "the training part's mean, held",
        generator="cospeech.gestures.baselines:MeanPose",
        needs=("clips",),
    ),
    "random": Model(
        "Random take",
        "a stretch of the speaker's own motion, whatever the speech",
        generator="cospeech.gestures.baselines:RandomTake",
        needs=("clips",),
        smoothing=0.0,
    ),
    "ha2g": Model("HA2G", "hierarchical audio learner and hierarchical pose inferer", source="Liu et al. 2022", **MANY),
    "trimodal": Model("Trimodal", "from wave, words and speaker", source="Yoon et al. 2020", **MANY),
    "seq2seq": Model("Seq2Seq", "from words alone", source="Yoon et al. 2019", **MANY),
    "speech2gesture": Model("Speech2Gesture", "from the spectrogram alone", source="Ginosar et al. 2019", **MANY),
    "joint_embedding": Model(
        "Joint Embedding", "speech and motion in one space", source="Ahuja and Morency 2019", **MANY
    ),
}


def variant(of, label, **changes):
    """A row of a table: the Model `of` trained with other keys of its section."""
    model = MODELS[of]
    return replace(model, label=label, section=model.section or of, changes=changes, of=of)


# Rows of tables that are models trained with other keys; `words` is our own, the others are the publications'.
VARIANTS = {
    "pose_gan": variant("gesture_gan", "Adversary on pose", adversary="pose"),
    "window16": variant("gesture_gan", "16 frames", frames=16),
    "window32": variant("gesture_gan", "32 frames", frames=32),
    "window128": variant("gesture_gan", "128 frames", frames=128),
    "low_only": variant("ha2g", "Low-level audio only", audio_levels=["low"]),
    "mid_only": variant("ha2g", "Mid-level audio only", audio_levels=["mid"]),
    "high_only": variant("ha2g", "High-level audio only", audio_levels=["high"]),
    "no_in_level_negatives": variant("ha2g", "Without negatives of other times and clips", in_level_negatives=False),
    "no_cross_level_negatives": variant("ha2g", "Without negatives of low and mid level", cross_level_negatives=False),
    "no_text": variant("ha2g", "Without text", text=False),
    "words": variant("ha2g", "Hearing words when generating", text_input=True),
    "holistic": variant("ha2g", "Holistic", pose_hierarchy="none"),
    "no_hand_hierarchy": variant("ha2g", "Without hand hierarchy", pose_hierarchy="body"),
    "no_body_hierarchy": variant("ha2g", "Without body hierarchy", pose_hierarchy="hands"),
    "same_audio": variant("ha2g", "Same audio for every level", same_audio=True),
    "no_physical": variant("ha2g", "Without physical loss", weights={"physical": 0.0}),
}


# Tables of chapter 4 over several seeds: their rows, and what they call them.
COMPARISONS = {
    "generators": {row: row for row in ("regression", "lstm", "velocity_gan", "gesture_gan", "moglow")},
    "ablation": {
        "regression": "no adversary",
        "pose_gan": "adversary on pose",
        "velocity_gan": "adversary on velocity",
        "gesture_gan": "adversary on audio and pose",
    },
    "window_length": {
        "window16": "16 frames",
        "window32": "32 frames",
        "gesture_gan": "64 frames",
        "window128": "128 frames",
    },
}


def named(*, learns=None, trained=None, needs=None):
    """Names in `MODELS`, in order: of those that learn so, that are trained or not, that need this."""
    return [
        name
        for name, model in MODELS.items()
        if (learns is None or model.learns == learns)
        and (trained is None or bool(model.task) == trained)
        and (needs is None or needs in model.needs)
    ]


def find(name):
    """The `Model` of a name or of a network's folder, `ha2g` or `ha2g_1`; CospeechError that lists the known ones."""
    for known in (name, re.sub(r"_\d+$", "", name)):
        if known in MODELS or known in VARIANTS:
            return MODELS.get(known) or VARIANTS[known]
    raise CospeechError(f"model {name!r} is not known; known: {', '.join(MODELS)}")


def smoothing_of(row):
    """sigma in frames of the Gaussian over a model's motion; of a network that has no entry, the published one."""
    return MODELS[row].smoothing if row in MODELS else SMOOTHING


def section_of(name):
    """The budget's section of a model or of a table's row."""
    model = find(name)
    return model.section or name


def settings_for(name, budget, *more):
    """The keys that a name is trained with: its budget's section, `more` sections over it, and what a row changes."""
    settings = {}
    for section in (budget.get(section_of(name), {}), *(budget.get(other, {}) for other in more), find(name).changes):
        nested = {key: settings.get(key, {}) | value for key, value in section.items() if isinstance(value, dict)}
        settings |= section | nested
    return settings


def resolve(text):
    """The class or function that "module:name" says."""
    module, _, name = text.partition(":")
    return getattr(import_module(module), name)
