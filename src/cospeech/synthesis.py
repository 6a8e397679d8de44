"""Every generator of `gestures.generator.MODELS` from training to a clip: `train`, `load`, `synthesize`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError
from cospeech.files import sha256
from cospeech.gestures.generator import SMOOTHING, find, resolve


def train(name, recordings, settings, *, seed, folder, checkpoint=None, threads=None):
    """Train one network on `Recordings` and write weights.safetensors, model.onnx and history.h5 into `folder`.

    Parameters
    ----------
    name : a model that is trained, or a table's row. settings : dict, the budget's section for it (see
        `gestures.generator.settings_for`); missing keys have the published values.
    checkpoint : path for resuming; outside `folder`. threads : int, CPU threads of torch.
    """
    import torch

    from cospeech.learning.fit import fit

    model = find(name)
    if not model.task:
        raise CospeechError(f"model {name!r} learns nothing, it only generates")
    if threads:
        torch.set_num_threads(threads)
    if model.signal:
        from cospeech.matching.control.signals import SIGNALS

        values = [SIGNALS[model.signal](clip.positions, clip.fps) for clip in recordings.clips]
        recordings = replace(recordings, control={model.signal: values})
    task = resolve(model.task)(model.of or name, recordings, settings, seed)
    fit(task, folder, seed=seed, data=recordings.digest(), label=f"{recordings.who} {name}", checkpoint=checkpoint)


def load(name, folder, threads=None, **options):
    """The generator `name` of whoever's results lie in `folder`: a subject, or an ensemble of many.

    options : `audio_rank`, of models that search: see `cospeech.matching.knn.KNN.load`.
    """
    given = {key: value for key, value in options.items() if value is not None}
    model = find(name)
    if unknown := set(given) - set(model.options):
        option = unknown.pop()
        raise CospeechError(f"{option.replace('_', ' ')}: {name} ranks no matches; use knn or resync")
    return resolve(model.generator).load(name, Path(folder), threads, **given)


def smooth(motion, sigma=SMOOTHING):
    """The published zero-phase Gaussian over time on joints and head rotation, not on expression. sigma in frames."""
    blur = lambda x: None if x is None or not sigma else gaussian_filter1d(x, sigma, axis=0, mode="nearest")
    if not sigma:
        return motion
    return replace(motion, positions=blur(motion.positions), rotation=blur(motion.rotation))


def finished(motion, smoothing, replacements=(), fps=15.0):
    """What all generated motion goes through last: smoothing, frames from elsewhere, then the speaker's bones.

    The bones come last because a Gaussian over positions shortens them. smoothing : sigma in frames. replacements :
    see `synthesize`.
    """
    motion = smooth(motion, smoothing)
    if replacements:
        from cospeech.matching.control.replace import replaced

        motion = replaced(motion, replacements, fps)
    return motion.whole()


def synthesize(generator, speech, *, subject, clip, model, seed=0, smoothing=None, audio="", replace=(), **options):
    """Speech in, a generated Clip of round(duration * fps) frames out.

    Parameters
    ----------
    speech : `Speech`. subject, clip, model : what the clip is called.
    smoothing : sigma in frames; None is the model's own. The value is kept in the clip's attribute `smoothing`.
    audio : path of the sound as the clip shall name it, relative to the clip's folder.
    replace : frames to take from other clips, see `cospeech.matching.control.replace.Replacement.of`.
    options : passed to the generator (k, initial, style...).
    """
    speech.check_length()
    smoothing = find(model).smoothing if smoothing is None else smoothing
    motion = finished(generator.generate(speech, seed=seed, **options), smoothing, replace, speech.fps)
    source = {"source": Path(speech.path).name, "source_sha256": sha256(speech.path)} if speech.path else {}
    return Clip(
        subject,
        clip,
        speech.fps,
        motion.positions.astype(np.float32),
        speech.features,
        rotation=motion.rotation,
        expression=motion.expression,
        face_model=motion.face_model,
        words=speech.words or Words.none(),
        audio=audio,
        sample_rate=speech.rate,
        loudness_lufs=speech.loudness,
        generator=model,
        extra={"smoothing": float(smoothing), "seed": seed},
        trace=motion.trace,
        **source,
    )
