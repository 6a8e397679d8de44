"""What the virtual speaker says: the texts of `texts/`, freshly combined and worded for every take."""

import re
from functools import cache
from importlib.resources import files

STRAY = "phrases"  # the text whose sentences fit anywhere
STRAY_SHARE = 0.12  # chance that one of them follows a sentence
CHOICE = re.compile(r"\{([^{}]*)\}")


@cache
def texts():
    """{name: list of paragraphs, each a list of sentences} as written, alternatives and emphasis marks included."""
    folder = files("cospeech.demo") / "texts"
    named = {path.name.removesuffix(".txt"): path.read_text("utf-8") for path in folder.iterdir()}
    return {name: [_sentences(p) for p in named[name].split("\n\n")] for name in sorted(named)}


def _sentences(paragraph):
    return [line.strip() for line in paragraph.splitlines() if line.strip() and not line.startswith("#")]


def worded(sentence, rng):
    """One wording of a sentence: each {a|b|c} becomes one of its alternatives, drawn evenly."""
    return CHOICE.sub(lambda found: str(rng.choice(found[1].split("|"))), sentence)


def monologue(words, rng):
    """Sentences of at least `words` words in all: list of (text, starts a paragraph).

    Whole paragraphs in random order, so that neighbouring sentences belong together; each is said once before any is
    said again, the wording is drawn anew every time, and now and then a stray sentence follows. Words between
    asterisks are to be emphasized.
    """
    paragraphs = [p for name, text in texts().items() if name != STRAY for p in text]
    stray = [sentence for paragraph in texts()[STRAY] for sentence in paragraph]
    said, count = [], 0
    while count < words:
        for i in rng.permutation(len(paragraphs)):
            for j, sentence in enumerate(paragraphs[i]):
                said.append((worded(sentence, rng), j == 0))
                if rng.random() < STRAY_SHARE:
                    said.append((worded(str(rng.choice(stray)), rng), False))
                    count += len(said[-2][0].split())
                count += len(said[-1][0].split())
            if count >= words:
                break
    return said
