"""Materials of the synthetic people: skin, hair, clothes. `studio` is sober, `wild` is whatever people wear."""

from dataclasses import dataclass, fields

import numpy as np

from cospeech.people.painting.raster import CHECKS, OPENING, PATCHES, PLAIN

BALD, SHORT, MEDIUM, LONG, BUN, CURLS = range(6)
SKIN = np.array(
    [
        [0.97, 0.82, 0.72],
        [0.93, 0.74, 0.62],
        [0.86, 0.66, 0.52],
        [0.74, 0.54, 0.41],
        [0.58, 0.40, 0.29],
        [0.42, 0.28, 0.20],
    ]
)
HAIR = np.array(
    [
        [0.10, 0.08, 0.07],
        [0.20, 0.13, 0.09],
        [0.34, 0.22, 0.13],
        [0.62, 0.46, 0.26],
        [0.50, 0.24, 0.12],
        [0.62, 0.61, 0.60],
    ]
)
SOBER = np.array(
    [
        [0.24, 0.32, 0.50],
        [0.80, 0.80, 0.78],
        [0.30, 0.30, 0.33],
        [0.52, 0.22, 0.22],
        [0.32, 0.42, 0.34],
        [0.62, 0.57, 0.48],
    ]
)
JEANS = np.array([[0.20, 0.25, 0.38], [0.16, 0.16, 0.18], [0.45, 0.41, 0.35], [0.33, 0.36, 0.40]])
IRISES = np.array([[0.30, 0.20, 0.12], [0.30, 0.42, 0.55], [0.35, 0.42, 0.28], [0.18, 0.12, 0.09]])


@dataclass
class Materials:
    """N people. Colours (N, 3), 0 to 1: skin, hair, top, top2 (of its pattern), bottom, shoes, lips, iris.

    style (N,) of the hair. sleeves, legs (N,): how far cloth reaches, 1 elbow or knee, 2 wrist or ankle; above it is
    skin. loose (N,): cloth's radius over the limb's. pattern, period (N,): of the top. beard, skirt, glasses (N,) bool.
    """

    skin: np.ndarray
    hair: np.ndarray
    top: np.ndarray
    top2: np.ndarray
    bottom: np.ndarray
    shoes: np.ndarray
    lips: np.ndarray
    iris: np.ndarray
    style: np.ndarray
    sleeves: np.ndarray
    legs: np.ndarray
    loose: np.ndarray
    pattern: np.ndarray
    period: np.ndarray
    beard: np.ndarray
    skirt: np.ndarray
    glasses: np.ndarray

    def __getitem__(self, chosen):
        """The people at an index array."""
        return Materials(*(getattr(self, f.name)[chosen] for f in fields(self)))


def colors(dice, strength=1.0):
    """(N, 3) colours of any hue."""
    hue, saturation, value = dice.uniform(), dice.uniform() ** 1.5 * 0.85, dice.uniform(0.12, 0.95)
    wheel = np.clip(np.abs((hue[:, None] * 6 + [0, 4, 2]) % 6 - 3) - 1, 0, 1)
    return value[:, None] * (1 - saturation[:, None] * strength * (1 - wheel))


def draw_materials(dice, domain, female, age):
    """Draw `Materials` for people whose sex (N,) bool and age (N,) are known; domain "studio" or "wild"."""
    wild = domain == "wild"
    skin = np.clip(dice.pick(SKIN) * dice.normal(1, 0.04)[:, None], 0, 1)
    hair = dice.pick(HAIR[:5]) * dice.normal(1, 0.15)[:, None]
    grey = np.clip((age - dice.uniform(40, 75)) / 15, 0, 1)[:, None]
    hair = hair * (1 - grey) + HAIR[5] * grey
    style = np.where(
        female, dice.choice([0.02, 0.2, 0.25, 0.35, 0.12, 0.06]), dice.choice([0.16, 0.64, 0.1, 0.02, 0, 0.08])
    )
    top = colors(dice) if wild else dice.pick(SOBER)
    top2 = colors(dice) if wild else top * 0.75
    bottom = np.where(dice.chance(0.5)[:, None], colors(dice, 0.6), dice.pick(JEANS)) if wild else dice.pick(JEANS)
    pattern = dice.choice([0.5, 0.14, 0.06, 0.1, 0.1, 0.1]) if wild else np.full(len(dice), PLAIN)
    period = np.where(pattern == OPENING, dice.uniform(0.03, 0.09), dice.uniform(0.02, 0.08))
    period = np.where(np.isin(pattern, [PATCHES, CHECKS]), period * 1.5, period)
    sleeves = np.where(dice.chance(0.6), 1.95, dice.uniform(0.35, 1.0)) if wild else dice.pick([0.65, 1.95, 1.95])
    legs = np.where(dice.chance(0.85), 1.95, dice.uniform(0.6, 1.1)) if wild else np.full(len(dice), 1.95)
    lips = skin * [0.92, 0.62, 0.62] * np.where(female & dice.chance(0.4), 0.85, 1.0)[:, None]
    return Materials(
        skin,
        np.clip(hair, 0, 1),
        top,
        top2,
        bottom,
        colors(dice, 0.5) * 0.6 if wild else 0.3 * top + 0.1,
        lips,
        dice.pick(IRISES),
        style,
        sleeves,
        legs,
        dice.uniform(1.05, 1.4 if wild else 1.15),
        pattern,
        period,
        ~female & (age > 20) & dice.chance(0.3),
        female & dice.chance(0.2 if wild else 0.0),
        dice.chance(0.22 if wild else 0.12),
    )
