"""Takes of the virtual speaker: sound and truth written together, and read back as clips."""

import zlib
from pathlib import Path

import h5py
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d
from scipy.signal import firwin

from cospeech import __version__
from cospeech.clip import AXES, Clip, Words
from cospeech.demo.face import animate_face
from cospeech.demo.lexicon import speaker_parameters
from cospeech.demo.motion import perform
from cospeech.demo.prosody import measure_prosody
from cospeech.demo.script import monologue
from cospeech.demo.voice import speak
from cospeech.errors import CospeechError
from cospeech.face.expressions import COSPEECH64
from cospeech.files import put, reading_hdf5, sha256, writing_hdf5
from cospeech.skeleton import UPPER55, bone_lengths, with_bone_lengths

SCHEMA = "cospeech.truth"
FACE_MODEL = "cospeech64"
SHORTEST = 5.0  # s
AROUSAL_MEMORY = 0.6  # correlation of one sentence's arousal with the next one's
PASSBAND = 0.9  # of half the new rate: where the low-pass before sampling lets half through
PHASES = ("prep", "stroke", "apex", "hold", "retract", "end")


def write_take(speaker, take, *, seconds, seed, wav, truth, fps=60.0):
    """Make take number `take` of a speaker: its sound (22.05 kHz wav) and its truth (HDF5, schema `cospeech.truth`).

    speaker : "calm" or "lively" (`speakers.yaml`).  take, seed : integers; a take depends on nothing but
        (speaker, take, seed, seconds, fps).  seconds : exact length; speech ends with a whole sentence before it.
    wav, truth : paths to write.  fps : frames a second of the truth.
    Raises CospeechError for an unknown speaker or less than 5 s.
    """
    parameters = speaker_parameters(speaker)
    if not seconds >= SHORTEST:
        raise CospeechError(f"demo take {take} of {speaker}: {seconds} s asked for, it needs {SHORTEST:g} s or more")
    sources = np.random.SeedSequence([seed, take, zlib.crc32(speaker.encode())]).spawn(3)
    script, body, face = (np.random.default_rng(source) for source in sources)
    speech = speak(_sentences(parameters["voice"], seconds, script), parameters["voice"]["name"], seconds)
    frames = round(seconds * fps)
    prosody = measure_prosody(speech, frames, fps)
    performance = perform(speech, prosody, parameters, frames, fps, body)
    expression = animate_face(speech, prosody, performance.rotation, parameters, fps, face)
    _write_wav(wav, speech)
    head = {
        "speaker": speaker,
        "take": take,
        "seed": seed,
        "seconds": float(seconds),
        "fps": float(fps),
        "frames": frames,
    }
    head |= {"units": "m", "axes": AXES, "skeleton": UPPER55.name, "cospeech_version": __version__}
    with writing_hdf5(truth, SCHEMA, **head, audio=Path(wav).name, audio_sha256=sha256(wav)) as file:
        _put_motion(file, performance, expression, prosody)
        _put_speech(file, speech, prosody)
        _put_gestures(file, performance.gestures)


def read_take(truth, wav, *, fps=15.0, subject, clip, audio_path=""):
    """The Clip of a take at another frame rate: frame i shows the truth at i/fps, low-passed below half the new rate.

    truth, wav : the two files of `write_take`, refused with CospeechError when they do not belong together.
    T = round(duration * fps). `audio_path` becomes the clip's `audio` (relative to the clip file).
    """
    from cospeech.speech import integrated_loudness, load_audio, speech_features

    positions, rotation, expression, words = read_motion(truth, wav, fps)
    frames = len(positions)
    samples, sample_rate = load_audio(wav)
    return Clip(
        subject,
        clip,
        fps,
        positions.astype(np.float32),
        speech_features(samples, sample_rate, fps, frames=frames),
        expression=expression.astype(np.float32),
        rotation=rotation.astype(np.float32),
        face_confidence=np.ones(frames, np.float32),
        face_model=FACE_MODEL,
        words=words,
        audio=audio_path,
        sample_rate=sample_rate,
        loudness_lufs=float(integrated_loudness(samples, sample_rate)),
        source=Path(truth).name,
        source_sha256=sha256(truth),
    )


def read_motion(truth, wav, fps):
    """(positions (T, 55, 3) metres, rotation (T, 3), expression (T, 64), `Words`) of a take; see `read_take`."""
    with reading_hdf5(truth, SCHEMA) as file:
        if file.attrs["audio_sha256"] != sha256(wav):
            raise CospeechError(f"{wav}: not the sound that belongs to {truth}; make both again")
        rate, seconds = float(file.attrs["fps"]), float(file.attrs["seconds"])
        frames = round(seconds * fps)
        take = lambda name: _resampled(file[name][()].astype(np.float64), rate, fps, frames)
        positions = with_bone_lengths(take("motion/positions"), bone_lengths(file["motion/positions"][:1]))
        words = Words(file["words/start"][()], file["words/end"][()], list(file["words/text"].asstr()[()]))
        return positions, take("face/rotation"), np.clip(take("face/expression"), 0, 1), words


def _sentences(voice, seconds, rng):
    """What may be said in `seconds`, more than enough, each sentence with its own arousal and pause."""
    arousal, said = 0.0, []
    steps = np.array(voice["arousal"], float)
    base = np.array([voice[key] for key in ("rate", "pitch", "range", "volume")], float)
    median, deviation = voice["pause"]
    for text, opens in monologue(seconds / 60 * voice["rate"] * 1.3 + 60, rng):
        arousal = AROUSAL_MEMORY * arousal + np.sqrt(1 - AROUSAL_MEMORY**2) * rng.normal()
        rate, pitch, span, volume = np.clip(base + np.clip(arousal, -2, 2) * steps, 5, [260, 99, 99, 85]).round()
        pause = median * np.exp(deviation * rng.normal()) + voice["paragraph"] * opens
        pause = 0.4 if not said else min(pause, 3.5)
        said.append({"text": text, "rate": rate, "pitch": pitch, "range": span, "volume": volume, "pause": pause})
    return said


def _write_wav(path, speech):
    from cospeech.speech import write_wav

    write_wav(path, speech.samples.astype(np.float32) / 32768, speech.rate)


def _put_motion(file, performance, expression, prosody):
    put(file, "motion/positions", performance.positions.astype(np.float32))
    put(file, "face/rotation", performance.rotation.astype(np.float32))
    put(file, "face/expression", expression.astype(np.float32))
    file["face"].attrs.update(model=FACE_MODEL, E=len(COSPEECH64))
    put(file, "prosody/loudness_db", prosody.loudness.astype(np.float32))
    put(file, "prosody/pitch_hz", prosody.pitch.astype(np.float32))


def _put_text(file, name, strings):
    data = np.array([s.encode() for s in strings], dtype=object)
    file.create_dataset(name, data=data, dtype=h5py.string_dtype("utf-8"), shape=(len(data),))


def _put_speech(file, speech, prosody):
    words, phonemes = speech.words, speech.phonemes
    for name, array in (
        ("words/start", words.start),
        ("words/end", words.end),
        ("words/sentence", speech.sentence),
        ("words/emphasized", speech.emphasized),
        ("words/stressed", prosody.stressed),
        ("words/accent_time", prosody.accent_time),
        ("words/accent", prosody.accent),
        ("phonemes/start", phonemes.start),
        ("phonemes/end", phonemes.end),
        ("phonemes/stress", phonemes.stress),
        ("phonemes/word", phonemes.word),
    ):
        put(file, name, array)
    _put_text(file, "words/text", words.text)
    _put_text(file, "phonemes/ipa", phonemes.ipa)


def _put_gestures(file, gestures):
    _put_text(file, "gestures/form", [g.form for g in gestures])
    _put_text(file, "gestures/hand", [g.hand for g in gestures])
    put(file, "gestures/word", np.array([g.word for g in gestures], int))
    for name in ("size", "strength", *PHASES):
        put(file, f"gestures/{name}", np.array([getattr(g, name) for g in gestures], float))


def _resampled(values, rate, fps, frames):
    """(N, ...) at `rate` -> (T, ...) at i/fps: linear-phase low-pass (Hamming sinc, gain 1/2 at 0.9 of half the new
    rate), then a cubic spline through the frames."""
    if fps < rate:
        taps = 8 * int(np.ceil(rate / fps)) + 1
        values = convolve1d(values, firwin(taps, PASSBAND * fps / 2, fs=rate), axis=0, mode="nearest")
    if len(values) == frames and fps == rate:
        return values
    at = np.minimum(np.arange(frames) / fps, (len(values) - 1) / rate)
    return CubicSpline(np.arange(len(values)) / rate, values, axis=0)(at)
