"""Takes in, a `Corpus` out: every speaker's training part, filtered, on all clocks."""

from dataclasses import dataclass

import numpy as np

from cospeech.clip import Clip
from cospeech.errors import CospeechError, notice
from cospeech.gestures.ha2g.dataset.bones import bone_vectors, mean_lengths, measure_proportions
from cospeech.gestures.ha2g.dataset.corpus import FPS, FRAMES, SAMPLES, STRIDE, Corpus, check_rate
from cospeech.gestures.ha2g.dataset.filters import Filters, mean_pose
from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.gestures.ha2g.dataset.vocabulary import Vocabulary, check_words, warn_of_other_transcript
from cospeech.speech.mel import HOP, log_mel, log_mel_s2g
from cospeech.speech.mfcc import RATE


@dataclass
class Take:
    """A stretch of a speaker's clip, and its sound: samples (N,) at 16 kHz from the first frame on."""

    clip: Clip
    samples: np.ndarray

    @property
    def name(self):
        return f"{self.clip.subject}/{self.clip.clip}"


def collect(takes, levels="expressive43", *, filters=None, embeddings=None, references=None, least=1, seed=0):
    """The `Corpus` of {speaker: [Take]}, all of the training part; `counts` is its form of HA2G's Table 5.

    Parameters
    ----------
    levels : name of the level table. filters : `Filters`, the released ones if None.
    embeddings : path of word vectors (see `embeddings`), or None: the networks then learn them from scratch.
    references : {speaker: (K, side, side, 3) uint8 pictures} for networks that know speakers by them, or None.
    least : occurrences that a word needs to have a number. seed : of word vectors that the file lacks.

    Raises CospeechError when nothing is left to learn from; what the filters dropped is told, and in `Corpus.counts`.
    """
    table, filters = level_table(levels), filters or Filters()
    counts = {"takes": 0, "short": 0, "unseen": 0}
    kept = {speaker: [t for t in of_one if _usable(t, table, filters, counts)] for speaker, of_one in takes.items()}
    for speaker, of_one in kept.items():
        if not of_one:
            raise CospeechError(f"{speaker}: no training take of {filters.frames / FPS:g} s or more; give longer takes")
    if len(kept) == 1:
        notice(f"{next(iter(kept))} is the only speaker, so the networks learn one style and have none to choose from")
    _check_references(references, kept)
    listed = [take for of_one in kept.values() for take in of_one]
    vocabulary = _vocabulary(listed, embeddings, least, seed)
    parts = [_arrays(take, table, vocabulary) for take in listed]
    names = parts[0].keys()
    clips = {speaker: [take.clip for take in of_one] for speaker, of_one in kept.items()}
    corpus = Corpus(
        table,
        list(kept),
        vocabulary,
        np.concatenate([p["vectors"][p["valid"]] for p in parts]).mean(axis=0).ravel(),
        mean_lengths([take.clip for take in listed], table),
        {speaker: measure_proportions(of_one, table) for speaker, of_one in clips.items()},
        _table_of_takes(kept, listed, parts),
        np.zeros(0, np.int64),
        np.zeros(0, np.int64),
        {name: np.concatenate([part[name] for part in parts]) for name in names},
        counts,
        references={name: references[name] for name in kept} if references else {},
    )
    corpus.window_take, corpus.window_frame = _windows(listed, parts, table, filters, counts)
    _report(counts, filters)
    return corpus


def _usable(take, table, filters, counts):
    clip, duration = take.clip, len(take.samples) / RATE
    check_rate(clip.fps)
    if abs(duration - clip.duration) > 1.0:
        raise CospeechError(f"{take.name}: {duration:.2f} s of sound for {clip.duration:.2f} s of motion")
    check_words(clip.words, duration, take.name)
    warn_of_other_transcript(clip.words, take.samples, RATE, take.name)
    reason = filters.refuse_take(clip, table)
    counts[reason or "takes"] += 1
    return reason is None


def _check_references(references, speakers):
    """Either no speaker has reference frames or every one, all of one size."""
    missing = [name for name in speakers if references and not len(references.get(name, ()))]
    if missing:
        raise CospeechError(
            f"{missing[0]}: has no reference frames, which other speakers are known by; film {missing[0]} too, leave "
            f"{missing[0]} out, or set ensemble.identity: speaker"
        )
    sizes = {pictures.shape[1:] for pictures in (references or {}).values()}
    if len(sizes) > 1:
        raise CospeechError(f"reference frames of several sizes, {sorted(size[0] for size in sizes)}; make them again")


def _vocabulary(takes, embeddings, least, seed):
    vocabulary = Vocabulary.of((text for take in takes for text in take.clip.words.text), least)
    if len(vocabulary.words) == 4:
        notice("no take has words: the networks learn from sound alone")
    elif embeddings is None:
        notice(f"no word vectors given: those of {vocabulary.size - 4} words are learned from scratch")
    else:
        from cospeech.gestures.ha2g.dataset.embeddings import read_embeddings

        return vocabulary.with_vectors(read_embeddings(embeddings, set(vocabulary.words[4:])), seed)
    return vocabulary


def _arrays(take, table, vocabulary):
    """One take on every clock; its sound is followed by silence as far as the last window hears."""
    clip = take.clip
    last = round((clip.frames - FRAMES) / FPS * RATE)
    samples = np.pad(take.samples, (0, max(0, last + SAMPLES + 2 * HOP - len(take.samples))))
    return {
        "vectors": bone_vectors(clip.positions, clip.rotation, table),
        "valid": clip.valid,
        "words": vocabulary.frames(clip.words, clip.frames, FPS).astype(np.int32),
        "mel": np.ascontiguousarray(log_mel(samples).T),
        "s2g_mel": np.ascontiguousarray(log_mel_s2g(samples).T),
        "wave": np.clip(np.rint(samples * 32768), -32768, 32767).astype(np.int16),
    }


def _table_of_takes(kept, listed, parts):
    begins = lambda name: np.cumsum([0] + [len(part[name]) for part in parts])[:-1]
    return {
        "name": [take.name for take in listed],
        "speaker": np.repeat(np.arange(len(kept)), [len(of_one) for of_one in kept.values()]),
        "frame": begins("vectors"),
        "column": begins("mel"),
        "s2g_column": begins("s2g_mel"),
        "sample": begins("wave"),
    }


def _windows(listed, parts, table, filters, counts):
    """(N,) takes and (N,) first frames of the windows that the filters keep; `counts` is added to."""
    mean = mean_pose(np.concatenate([part["vectors"][part["valid"]] for part in parts]), table)
    which, frames = [], []
    for number, (take, part) in enumerate(zip(listed, parts, strict=True)):
        starts = np.arange(0, take.clip.frames - FRAMES + 1, STRIDE)
        good, dropped = filters.windows(starts, FRAMES, take.clip.valid, part["words"], part["vectors"], table, mean)
        for name, count in dropped.items():
            counts[name] = counts.get(name, 0) + count
        which.append(np.full(good.sum(), number))
        frames.append(starts[good])
    counts["windows"] = int(sum(map(len, frames)))
    return np.concatenate(which).astype(np.int64), np.concatenate(frames).astype(np.int64)


def _report(counts, filters):
    """What was dropped and why, in one line; an error when nothing is left."""
    dropped = ", ".join(
        f"{count} {name}" for name, count in counts.items() if name not in ("takes", "windows") and count
    )
    line = f"{counts['windows']} windows of {FRAMES} frames in {counts['takes']} takes"
    if not counts["windows"]:
        raise CospeechError(f"training part: no window of {FRAMES} frames is left by the filters ({dropped})")
    notice(f"{line}; dropped: {dropped or 'nothing'} (takes under {filters.frames / FPS:g} s count as short)")
