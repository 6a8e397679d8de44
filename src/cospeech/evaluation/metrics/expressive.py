"""How HA2G's feature networks are trained and judge (`fgd.PRESETS`)."""

from dataclasses import dataclass

from cospeech.learning.settings import COUNT, NATURAL, POSITIVE, Section, key

STRIDE = 10  # frames between the starts of two windows that are judged (HA2G section 4.1)


@dataclass(frozen=True)
class Settings(Section, section="ha2g_ruler"):
    """Of the training. Published for TED Expressive: 180 epochs, a tenth of the rate every 30 epochs."""

    steps: int = key(1500, "iterations", limits=COUNT, published=180_000)
    batch: int = key(64, "windows of 34 frames in each iteration", limits=COUNT)
    learning_rate: float = key(5e-4, "of Adam", limits=POSITIVE)
    decays: int = key(5, "how often, at even distances, the rate falls to a tenth", limits=NATURAL)
