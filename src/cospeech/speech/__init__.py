"""Speech: sound files, loudness, the 28 speech features of every motion frame, onsets and word times."""

from cospeech.speech.audio import audio_duration, load_audio, write_wav
from cospeech.speech.features import speech_features
from cospeech.speech.loudness import integrated_loudness, normalize_loudness
from cospeech.speech.onsets import speech_onsets
from cospeech.speech.recognize import recognize_words, words_of_speech
from cospeech.speech.words import cut_words, find_words, read_words

__all__ = [
    "audio_duration",
    "cut_words",
    "find_words",
    "integrated_loudness",
    "load_audio",
    "normalize_loudness",
    "read_words",
    "recognize_words",
    "speech_features",
    "speech_onsets",
    "words_of_speech",
    "write_wav",
]
