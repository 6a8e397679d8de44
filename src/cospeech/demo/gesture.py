"""Which gestures the virtual speaker makes, with which hand and when: the stochastic model's decisions.

Gestures come in Kendon's phases: preparation, stroke, optional hold, then retraction to a rest pose or straight into
the next preparation. A stroke's apex meets the stressed vowel of a word. `docs/demo.md` states
the model with its numbers.
"""

from dataclasses import dataclass

import numpy as np

from cospeech.demo.lexicon import lexicon

APEX_JITTER = 0.025  # s, standard deviation of apex against vowel
KEYWORD_BONUS = 0.35  # added to the chance of a stroke when the word has linked gestures
KEEP_HAND = 0.5  # chance that a one-handed stroke within KEEP_HAND_FOR seconds uses the hand of the one before
KEEP_HAND_FOR = 3.0
SHORTEST_PREPARATION = 0.14  # s; with less time the hand goes straight to the apex


@dataclass
class Gesture:
    """One stroke and its phases.

    hand is right, left or both; word the index of the accented word; size, strength its amplitude and accent. Times in
    seconds: prep (the preparation starts), stroke (starts), apex, hold (starts), retract (starts), end. Joined to the
    next one without retraction: retract == end == the next one's prep.
    """

    form: str
    hand: str
    word: int
    strength: float
    size: float
    apex: float
    prep: float = 0.0
    stroke: float = 0.0
    hold: float = 0.0
    retract: float = 0.0
    end: float = 0.0


def choose_gestures(speech, prosody, parameters, rng):
    """The gestures of a take in order of time, apexes set, phases still open: list of Gesture."""
    style, strokes = parameters["gestures"], lexicon().strokes
    sentences = int(speech.sentence.max()) + 1
    quiet = rng.random(sentences) < style["quiet"]
    chosen = []
    for word, text in enumerate(speech.words.text):
        links = lexicon().keywords.get(text.lower(), {})
        if not (prosody.stressed[word] or speech.emphasized[word]) or quiet[speech.sentence[word]]:
            continue
        chance = style["rate"] + style["gain"] * (prosody.accent[word] - 0.5) + KEYWORD_BONUS * bool(links)
        apex = prosody.accent_time[word] + rng.normal(0, APEX_JITTER)
        if rng.random() > chance:
            continue
        form = _form(links, chosen, style, rng)
        reach = -strokes[form].times[0] * style["tempo"] + SHORTEST_PREPARATION
        if apex - (chosen[-1].apex if chosen else 0.0) < max(style["gap"], reach):
            continue
        hand = _hand(strokes[form].hands, apex, chosen, style["hands"], rng)
        size = style["amplitude"] * (0.55 + 0.9 * prosody.accent[word]) * np.exp(rng.normal(0, 0.15))
        chosen.append(Gesture(form, hand, word, float(prosody.accent[word]), float(np.clip(size, 0.35, 1.6)), apex))
    return chosen


def _form(links, chosen, style, rng):
    if links and rng.random() < style["keyword"]:
        return _draw(links, rng)
    if chosen and chosen[-1].form in style["forms"] and rng.random() < style["repeat"]:
        return chosen[-1].form
    return _draw(style["forms"], rng)


def _hand(hands, apex, chosen, preference, rng):
    if hands == "both":
        return "both"
    if chosen and chosen[-1].hand != "both" and apex - chosen[-1].apex < KEEP_HAND_FOR and rng.random() < KEEP_HAND:
        return chosen[-1].hand
    allowed = {hand: weight for hand, weight in preference.items() if hands == "either" or hand != "both"}
    return _draw(allowed, rng)


def _draw(weights, rng):
    names, share = list(weights), np.array([*weights.values()], float)
    return names[rng.choice(len(names), p=share / share.sum())]


def rest_schedule(speech, parameters, rng):
    """Rest poses of a take: (times (R,), list of R pose names); they change between sentences."""
    style = parameters["gestures"]
    firsts = np.flatnonzero(np.diff(speech.sentence, prepend=-1))
    times, poses = [0.0], [_draw(style["rests"], rng)]
    for time in speech.words.start[firsts[1:]]:
        if rng.random() < style["rest_change"]:
            others = {pose: weight for pose, weight in style["rests"].items() if pose != poses[-1]}
            times.append(float(time) - 0.3)
            poses.append(_draw(others, rng))
    return np.array(times), poses
