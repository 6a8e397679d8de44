"""Word times of a speech without a transcript, recognised offline by CMU PocketSphinx and its own English model."""

from pathlib import Path

import numpy as np

from cospeech.clip import Words
from cospeech.errors import CospeechError, notice
from cospeech.speech.audio import SILENT_PEAK
from cospeech.speech.words import find_words, read_words

RATE = 16000  # of the acoustic model
FRAMES = 100  # of the recogniser, per second
LONGEST = 20.0  # seconds that are recognised at once
PAUSE = 0.25  # seconds of sound whose loudness is compared, to cut longer speech in a pause


def words_of_speech(audio, samples, rate, path=None, recognize=False):
    """The `Words` of a sound file `audio`, whose samples are these, or None.

    From the file of word times `path`, or one that lies beside the sound; without both recognised, if `recognize`.
    CospeechError for words beyond the sound's end.
    """
    seconds = len(samples) / rate
    words = read_words(path, Path(audio).stem, seconds) if path else find_words(audio, seconds)
    return recognize_words(samples, rate) if words is None and recognize else words


def recognize_words(samples, rate):
    """The English `Words` heard in (N,) float32 mono samples; fillers and silences are left out.

    The model (US English, some 130 000 words) comes with the package `pocketsphinx`, an extra of this one.
    """
    try:
        from pocketsphinx import Decoder
    except ImportError as error:
        raise CospeechError("recognition needs pocketsphinx; pip install pocketsphinx, or give --words") from error
    import soxr

    sound = soxr.resample(np.asarray(samples, np.float32), rate, RATE)
    decoder, found = Decoder(samprate=RATE, loglevel="FATAL"), []
    for begin, end in _parts(sound):
        if np.abs(sound[begin:end]).max(initial=0.0) < SILENT_PEAK:
            continue  # the recogniser hears words in digital silence
        pcm = (np.clip(sound[begin:end], -1, 1) * 32767).astype("<i2")
        decoder.start_utt()
        decoder.process_raw(pcm.tobytes(), full_utt=True)
        decoder.end_utt()
        at = begin / RATE
        found += [(s.word, at + s.start_frame / FRAMES, at + (s.end_frame + 1) / FRAMES) for s in decoder.seg()]
    found = [(word.split("(")[0], start, end) for word, start, end in found if word[0] not in "<["]
    if not found:
        notice("recognition: no words were heard")
    texts, starts, ends = zip(*found, strict=True) if found else ((), (), ())
    return Words(np.array(starts, float), np.minimum(np.array(ends, float), len(sound) / RATE), list(texts))


def _parts(sound):
    """[(begin, end)] of at most `LONGEST` seconds, cut where the second half of each is quietest."""
    begin, longest, step = 0, round(LONGEST * RATE), round(PAUSE * RATE)
    while len(sound) - begin > longest:
        half = sound[begin + longest // 2 : begin + longest]
        energy = np.convolve(half.astype(float) ** 2, np.ones(step), "valid")
        cut = begin + longest // 2 + int(energy.argmin()) + step // 2
        yield begin, cut
        begin = cut
    yield begin, len(sound)
