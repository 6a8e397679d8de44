"""A learned audio-gesture similarity for the audio rank, instead of the hand-made one (thesis 5.5 asks for it).

Two small networks, one that hears a second of speech and one that sees the second of motion that went with it, are
trained so that what belongs together points in one direction (contrastive, after Chung and Zisserman 2016). The search
stays as it is: where it compared the speech with the speech of each candidate, it now compares it with the motion that
would be copied. In the database each frame's 112 audio numbers give way to the embedding of its motion, in the query to
that of the speech.
"""

from dataclasses import asdict, dataclass, replace
from hashlib import sha256

import numpy as np

from cospeech.errors import CospeechError
from cospeech.learning.settings import COUNT, DROPOUT, POSITIVE, WEIGHT, Section, key
from cospeech.learning.weights import load_weights, save_weights
from cospeech.matching.database.descriptors import AUDIO_WIDTH, POSE_WIDTH, Normalization

BLOCK = 16384  # frames of the database embedded at a time
TOWERS = ("audio", "motion")


@dataclass(frozen=True)
class Settings(Section, section="audio_rank"):
    """Of the training."""

    steps: int = key(1000, "iterations", limits=COUNT, published=20_000)
    batch: int = key(256, "windows in each iteration", limits=COUNT, published=1024)
    learning_rate: float = key(1e-3, "of AdamW", limits=POSITIVE)
    weight_decay: float = key(0.01, "of AdamW", limits=WEIGHT)
    hidden: int = key(128, "units of the hidden layer of each network", limits=COUNT)
    embedding: int = key(
        32, "numbers of an embedding, a multiple of 4 for the search's kernels", limits={"minimum": 4, "multipleOf": 4}
    )
    dropout: float = key(0.3, "share of hidden units that are dropped", limits=DROPOUT)
    temperature: float = key(0.1, "of the contrastive loss: what the cosines are divided by", limits=POSITIVE)


@dataclass(frozen=True)
class LearnedNormalization(Normalization):
    """What takes the place of `Database.audio_normalization`: z-normalisation, then the audio network."""

    similarity: object

    def __call__(self, features):
        """(W, 112) audio features -> (W, embedding) float32; each row by itself, so that no batch changes it."""
        rows = super().__call__(features)
        return np.stack([self.similarity.embed("audio", row[None])[0] for row in rows])


@dataclass
class Similarity:
    """The two trained networks as arrays; `description` says how and on which database they were trained."""

    arrays: dict
    description: dict

    def embed(self, tower, rows):
        """Normalised (N, 112) audio or (N, 192) motion features -> (N, embedding) float32 unit vectors."""
        part = lambda name: self.arrays[f"{tower}.{name}"].astype(np.float64)
        hidden = np.maximum(rows.astype(np.float64) @ part("0.weight").T + part("0.bias"), 0.0)
        found = hidden @ part("3.weight").T + part("3.bias")
        return (found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)).astype(np.float32)

    def applied(self, database):
        """The Database with its motion's embeddings for audio features; zeros where no window may ever start.

        CospeechError if it is not the one that the networks were trained on.
        """
        if fingerprint(database) != self.description["database"]:
            raise CospeechError("learned audio rank: trained on another database; train it again")
        embeddings = np.zeros((*database.real.shape, self.description["settings"]["embedding"]), np.float32)
        clips, frames = usable(database)
        for i in range(0, len(clips), BLOCK):
            clip, frame = clips[i : i + BLOCK], frames[i : i + BLOCK]
            embeddings[clip, frame] = self.embed("motion", motion_windows(database, clip, frame))
        normal = database.audio_normalization
        learned = LearnedNormalization(normal.mean, normal.std, self)
        return replace(database, audio=embeddings, audio_normalization=learned, kept={})

    def save(self, path):
        """Write as safetensors with the description in the header."""
        save_weights(path, self.arrays, self.description)

    @classmethod
    def load(cls, path):
        """Read what `save` wrote; CospeechError when it is something else."""
        arrays, description = load_weights(path)
        if description.get("model") != "audio_rank":
            raise CospeechError(f"{path}: weights of {description.get('model')!r}, expected a learned audio rank")
        return cls(arrays, description)


def fingerprint(database):
    """Names a database's speech and how it is normalised: 16 hexadecimal digits."""
    normal = database.audio_normalization
    digest = sha256(normal.mean.tobytes() + normal.std.tobytes() + database.real.tobytes())
    return digest.hexdigest()[:16]


def usable(database):
    """Clips and frames, (N,) ints each, at which a window may start under any placement."""
    return np.nonzero(database.placed("any_frame").eligible)


def motion_windows(database, clip, frame):
    """What the motion network sees of windows that start there: (N, 192), both halves of a second of arms and hands."""
    return np.concatenate([database.pose[clip, frame], database.pose_after(clip, frame)], axis=1)


def train_similarity(database, settings=None, *, seed=0, checkpoint=None):
    """Train on every window of a Database; return (Similarity, History)."""
    import torch

    from cospeech.learning.training import train

    settings = settings or Settings()
    if settings.embedding % 4:
        raise CospeechError(f"budget: audio_rank.embedding is {settings.embedding}, expected a multiple of 4")
    torch.manual_seed(seed)
    task = _task(database, settings)
    description = {"model": "audio_rank", "settings": asdict(settings), "database": fingerprint(database), "seed": seed}
    identity = str(description)
    history = train(task, settings.steps, seed=seed, checkpoint=checkpoint, identity=identity, label="audio rank")
    arrays = {name: tensor.detach().cpu().numpy() for name, tensor in task.modules["towers"].state_dict().items()}
    return Similarity(arrays, description), history


def _task(database, settings):
    import torch
    from torch import nn
    from torch.nn import functional as F

    from cospeech.learning.training import descend, device

    class Contrast:
        """Which of a batch's motions belongs to which speech: symmetric cross-entropy over cosines (InfoNCE)."""

        def __init__(self):
            self.clip, self.frame = usable(database)
            widths = {"audio": AUDIO_WIDTH, "motion": 2 * POSE_WIDTH}
            tower = lambda width: nn.Sequential(
                nn.Linear(width, settings.hidden),
                nn.ReLU(),
                nn.Dropout(settings.dropout),
                nn.Linear(settings.hidden, settings.embedding),
            )
            self.towers = nn.ModuleDict({name: tower(widths[name]) for name in TOWERS}).to(device())
            self.modules = {"towers": self.towers}
            options = {"lr": settings.learning_rate, "weight_decay": settings.weight_decay}
            self.optimizers = {"towers": torch.optim.AdamW(self.towers.parameters(), **options)}

        def iterate(self, step, rng):
            which = rng.integers(len(self.clip), size=settings.batch)
            clip, frame = self.clip[which], self.frame[which]
            inputs = {"audio": database.audio[clip, frame], "motion": motion_windows(database, clip, frame)}
            one, two = (
                F.normalize(self.towers[name](torch.as_tensor(inputs[name], device=device())), dim=1) for name in TOWERS
            )
            cosines, right = one @ two.T / settings.temperature, torch.arange(len(one), device=device())
            loss = (F.cross_entropy(cosines, right) + F.cross_entropy(cosines.T, right)) / 2
            descend(self, "towers", loss)
            return {"contrast": loss.detach(), "right": (cosines.argmax(dim=1) == right).float().mean()}

    return Contrast()
