"""The virtual speaker's voice: sentences in, samples with exact word and phoneme times out (espeak-ng)."""

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from cospeech.clip import Words
from cospeech.demo.espeak import PHONEME
from cospeech.errors import CospeechError

PRIMARY, SECONDARY = "ˈ", "ˌ"  # noqa: RUF001
VOWELS = frozenset("aɐɑæʌəɚɛeɪiɨoɔɒuʊʉɜᵻ")  # noqa: RUF001


@dataclass
class Phonemes:
    """P phonemes: ipa (list of P strings without stress marks; "" is a pause), start, end (P,) s, stress (P,) 0, 1 or 2
    (none, secondary, primary), word (P,) index of the word each belongs to, -1 in a pause."""

    ipa: list
    start: np.ndarray
    end: np.ndarray
    stress: np.ndarray
    word: np.ndarray

    @property
    def vowel(self):
        """(P,) bool: the phoneme is a vowel or a diphthong."""
        return np.array([bool(p) and p[0] in VOWELS for p in self.ipa], bool)


@dataclass
class Speech:
    """One take's sound: samples (N,) int16 at `rate`, its words, phonemes, and sentence (W,) index of every word."""

    samples: np.ndarray
    rate: int
    words: Words
    phonemes: Phonemes
    sentence: np.ndarray
    emphasized: np.ndarray

    @property
    def duration(self):
        """Seconds."""
        return len(self.samples) / self.rate


def speak(sentences, voice, seconds):
    """Speak as many of `sentences` as fit into exactly `seconds`; silence fills the rest.

    sentences : list of dicts: text (words between asterisks are emphasized), rate (words per minute), pitch, range,
        volume (espeak's 0..100 scales), pause (seconds of silence before it).
    voice : espeak-ng voice name, with an optional variant, such as "en-us+m3".
    Returns Speech. Equal arguments give equal samples. Raises CospeechError when no sentence fits.
    """
    marked = [_mark_up(s["text"]) for s in sentences]
    request = [s | {"ssml": ssml} for s, (ssml, _, _) in zip(sentences, marked, strict=True)]
    head, samples = _synthesize(request, voice, seconds)
    if not head["spoken"]:
        raise CospeechError(f"demo take of {seconds:g} s: too short for a sentence; ask for 5 s or more")
    events = {}
    for i, *event in head["events"]:
        events.setdefault(i, []).append(event)
    parts = [_timed(*marked[s["sentence"]][1:], events[s["sentence"]], s, head["rate"]) for s in head["spoken"]]
    return _joined(parts, samples, head["rate"])


def _synthesize(request, voice, seconds):
    import espeakng_loader

    message = json.dumps(
        {
            "library": espeakng_loader.get_library_path(),
            "data": espeakng_loader.get_data_path(),
            "voice": voice,
            "seconds": seconds,
            "sentences": request,
        }
    )
    script = Path(__file__).with_name("espeak.py")
    done = subprocess.run([sys.executable, "-I", str(script)], input=message.encode(), capture_output=True, check=False)
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        raise CospeechError(f"espeak-ng failed: {lines[-1] if lines else f'exit code {done.returncode}'}")
    head, samples = done.stdout.split(b"\n", 1)
    return json.loads(head), np.frombuffer(samples, "<i2")


def _mark_up(text):
    """SSML of a text, and for each of its words the character it starts at in the SSML, and (word, emphasized)."""
    ssml, starts, words = "", [], []
    for token in text.split():
        emphasized = "*" in token
        token = token.replace("*", "")
        opening, closing = ('<prosody volume="x-loud" pitch="+30%">', "</prosody>") if emphasized else ("", "")
        starts.append(len(ssml) + len(opening))
        body = re.match(r"^(.*?)([^\w]*)$", token)  # punctuation stays outside the tag, where espeak-ng sees it
        ssml += opening + escape(body[1]) + closing + escape(body[2]) + " "
        words.append((re.sub(r"^\W+|\W+$", "", token) or token, emphasized))
    return ssml.strip(), starts, words


def _timed(starts, words, events, spoken, rate):
    """Words and phonemes of one sentence on the take's clock. A word lasts from its first phoneme to its last."""
    phones = [(position, sample, text) for kind, position, sample, text in events if kind == PHONEME]
    start = np.array([sample for _, sample, _ in phones])
    end = np.append(start[1:], spoken["samples"])
    silent = np.array([not text.strip(PRIMARY + SECONDARY) for _, _, text in phones])
    owner = _owners(starts, [len(w) for w, _ in words], [position for position, _, _ in phones], silent)
    kept = np.array([i for i in range(len(words)) if (owner == i).any()], int)
    first = np.array([start[owner == i][0] for i in kept])
    last = np.array([end[owner == i][-1] for i in kept])
    stress = [2 if PRIMARY in text else 1 if SECONDARY in text else 0 for _, _, text in phones]
    clock = lambda samples: (samples + spoken["offset"]) / rate
    return {
        "word": [words[i][0] for i in kept],
        "emphasized": np.array([words[i][1] for i in kept]),
        "start": clock(first),
        "end": clock(last),
        "ipa": [text.strip(PRIMARY + SECONDARY) for _, _, text in phones],
        "stress": np.array(stress),
        "from": clock(start),
        "to": clock(end),
        "owner": np.where(silent, -1, np.searchsorted(kept, owner)),
    }


def _owners(starts, letters, positions, silent):
    """Word index of each phoneme (P,), -1 in pauses.

    espeak-ng gives each phoneme the character its word starts at, but speaks pairs such as "of the" as one word: the
    phonemes of such a group are shared out by the number of letters.
    """
    group = np.maximum(np.searchsorted(starts, positions, side="right") - 1, 0)
    group[silent] = -1
    owner = np.full(len(group), -1)
    heads = [*np.unique(group[~silent]), len(starts)]
    for head, following in pairwise(heads):
        members = np.flatnonzero(group == head)
        share = np.cumsum(letters[head:following]) / max(sum(letters[head:following]), 1)
        bounds = np.round(share * len(members)).astype(int)
        owner[members] = head + np.searchsorted(bounds, np.arange(len(members)), side="right")
    return owner


def _joined(parts, samples, rate):
    counts = np.array([len(p["word"]) for p in parts])
    before = np.cumsum(counts) - counts
    join = lambda key: np.concatenate([p[key] for p in parts])
    words = Words(join("start"), join("end"), [w for p in parts for w in p["word"]])
    owner = np.concatenate([np.where(p["owner"] < 0, -1, p["owner"] + n) for p, n in zip(parts, before, strict=True)])
    ipa = [text for p in parts for text in p["ipa"]]
    phonemes = Phonemes(ipa, join("from"), join("to"), join("stress"), owner)
    sentence = np.repeat(np.arange(len(parts)), counts)
    return Speech(samples, rate, words, phonemes, sentence, join("emphasized").astype(bool))
