"""Speech synthesis in a process of its own: one request on standard input, samples and events on standard output.

espeak-ng seeds its noise from the clock and keeps its state in global variables that initializing again does not reset,
so the same sentence sounds slightly different every time. A fixed seed in a fresh process for each take makes equal
requests give equal bytes. It needs nothing but the standard library; `voice.py` starts it and speaks with it.

Request, JSON: library, data (paths), voice, seconds, sentences: [{ssml, rate, pitch, range, volume, pause}].
Answer: one line of JSON {rate, spoken: [{sentence, offset, samples}], events: [[sentence, type, position, sample,
text]]}, then the samples, 16 bit little-endian.
"""

import ctypes
import json
import os
import sys

SYNCHRONOUS, PHONEME_EVENTS, PHONEME_IPA = 2, 1, 2
RATE, VOLUME, PITCH, RANGE = 1, 2, 3, 4
UTF8_SSML = 0x11
WORD, PHONEME = 1, 7
SEED = 1  # of the voice's noise
TOO_LONG_IN_A_ROW = 12  # sentences that do not fit before the rest of the take stays silent


class Event(ctypes.Structure):
    """`espeak_EVENT` of speak_lib.h; `id` is the union's `char string[8]`."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("identifier", ctypes.c_uint),
        ("position", ctypes.c_int),
        ("length", ctypes.c_int),
        ("milliseconds", ctypes.c_int),
        ("sample", ctypes.c_int),
        ("user_data", ctypes.c_void_p),
        ("id", ctypes.c_char * 8),
    )


CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(Event))


class Synthesizer:
    """espeak-ng with one voice; `say` returns one sentence's samples (bytes) and its word and phoneme events."""

    def __init__(self, library, data, voice):
        self.library = ctypes.CDLL(library)
        self.chunks, self.events = [], []
        self.callback = CALLBACK(self._collect)  # kept alive as long as the library may call it
        options = PHONEME_EVENTS | PHONEME_IPA
        self.rate = self.library.espeak_Initialize(SYNCHRONOUS, 0, os.path.dirname(data).encode(), options)
        if self.rate <= 0 or self.library.espeak_SetVoiceByName(voice.encode()):
            raise SystemExit(f"espeak-ng cannot speak with voice {voice}")
        self.library.espeak_ng_SetRandSeed(ctypes.c_long(SEED))  # after initializing, which seeds from the clock
        self.library.espeak_SetSynthCallback(self.callback)

    def _collect(self, samples, count, events):
        if samples and count:
            self.chunks.append(ctypes.string_at(samples, 2 * count))
        i = 0
        while events[i].type:
            event = events[i]
            if event.type in (WORD, PHONEME):
                text = event.id.decode("utf-8", "ignore") if event.type == PHONEME else ""
                self.events.append((event.type, event.position - 1, event.sample, text))
            i += 1
        return 0

    def say(self, sentence):
        self.chunks, self.events = [], []
        for parameter, key in ((RATE, "rate"), (PITCH, "pitch"), (RANGE, "range"), (VOLUME, "volume")):
            self.library.espeak_SetParameter(parameter, int(sentence[key]), 0)
        text = sentence["ssml"].encode()
        self.library.espeak_Synth(text, len(text) + 1, 0, 1, 0, UTF8_SSML, None, None)
        return b"".join(self.chunks), self.events


def main():
    request = json.load(sys.stdin)
    voice = Synthesizer(request["library"], request["data"], request["voice"])
    total = round(request["seconds"] * voice.rate)
    audio, spoken, events, refused = [], [], [], 0
    at = 0
    for i, sentence in enumerate(request["sentences"]):
        before = round(sentence["pause"] * voice.rate)
        samples, spoken_events = voice.say(sentence)
        if at + before + len(samples) // 2 > total:
            refused += 1
            if refused == TOO_LONG_IN_A_ROW:
                break
            continue
        refused = 0
        audio += [bytes(2 * before), samples]
        spoken.append({"sentence": i, "offset": at + before, "samples": len(samples) // 2})
        events += [(i, *event) for event in spoken_events]
        at += before + len(samples) // 2
    audio.append(bytes(2 * (total - at)))
    head = json.dumps({"rate": voice.rate, "spoken": spoken, "events": events})
    sys.stdout.buffer.write(head.encode() + b"\n" + b"".join(audio))


if __name__ == "__main__":
    main()
