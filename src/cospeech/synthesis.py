"""Every generator under one interface, from training to a clip: `train_model`, `load_generator`, `synthesize`.

A generator has `generate(features (T, 28), *, seed=0, ...) -> Motion` of T frames, any T.
"""

import json
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError, notice
from cospeech.gestures.chapter4.models import CONTROLLED, GESTURES, gesture_task
from cospeech.split import Split

TRAINED = (*GESTURES, "resync")  # have weights under results/<subject>/models/
MATCHED = ("knn", "knn_published", "resync")  # need the subject's database
BASELINES = ("mean_pose", "random")  # need the subject's training part alone
MODELS = (*GESTURES, *MATCHED, *BASELINES)
AUDIO_RANKS = ("plain", "learned")
RANK = Path("models", "audio_rank", "weights.safetensors")  # of the learned one, under a subject's folder
SMOOTHING = 1.5  # frames; published Gaussian on body, hands and head rotation at 15 Hz (thesis section 4.3)


def check_model(model):
    """CospeechError that lists the known models, unless `model` is one."""
    if model not in MODELS:
        raise CospeechError(f"model {model!r} is not known; known: {', '.join(MODELS)}")


def train_model(model, clips, settings, *, seed, folder, checkpoint=None, database=None, starts=None, threads=None):
    """Train one network and write weights.safetensors, model.onnx and history.h5 into `folder`.

    Parameters
    ----------
    model : one of `TRAINED`.
    clips : list of Clip, the training part.
    settings : dict, the budget's section for this model; missing keys have the published values.
    checkpoint : path for resuming; outside `folder`. database : Database of the training part, for `resync`.
    starts : seconds at which each clip begins in its take, for `resync`; None when all begin at 0.
    threads : int, CPU threads of torch.
    """
    import torch

    from cospeech.learning.training import finish, train
    from cospeech.learning.weights import export_onnx, save_weights

    if threads:
        torch.set_num_threads(threads)
    task = _task(model, clips, settings, seed, database, starts)
    identity = sha256(json.dumps(task.description, sort_keys=True, default=str).encode())
    for clip in clips:
        identity.update(clip.features.tobytes() + clip.positions.tobytes())
    history = train(
        task, task.settings.steps, seed=seed, checkpoint=checkpoint, identity=identity.hexdigest(),
        label=f"{clips[0].subject} {model}",
    )  # fmt: skip
    module, example, outputs = task.export()
    folder = Path(folder)
    save_weights(folder / "weights.safetensors", module.state_dict(), task.description)
    export_onnx(module, folder / "model.onnx", example, outputs, task.description)
    history.write(folder / "history.h5")
    finish(checkpoint)


def _task(model, clips, settings, seed, database, starts):
    if model == "resync":
        from cospeech.matching.resync.gan import ResyncTask, settings_from

        return ResyncTask(clips, settings_from(settings), seed, database, starts)
    return gesture_task(model, clips, settings, seed, _control_of(model, clips))


def _control_of(model, clips):
    """What a control variant is told in training: its signal in every clip, list of (T,); None for other models."""
    if model not in CONTROLLED:
        return None
    from cospeech.matching.control.signals import SIGNALS

    return [SIGNALS[CONTROLLED[model]](clip.positions, clip.fps) for clip in clips]


def training_part(subject_folder):
    """The clips of the training part of the subject whose results lie in `subject_folder`, cut to it."""
    folder = Path(subject_folder)
    ranges = Split.read(folder / "split.h5").of("train")
    return [Clip.read(folder / "clips" / f"{take}.h5").section(start, stop) for take, start, stop in ranges]


def load_generator(model, subject_folder, threads=None, audio_rank=None):
    """The generator `model` of the subject whose results lie in `subject_folder`, ready to `generate`.

    audio_rank : how a model that searches compares speech: "plain" as published, "learned" with motion, by the networks
        of `cospeech.matching.search.similarity`. None is learned, or plain with a notice where these are not trained,
        and plain for `knn_published`.
    """
    check_model(model)
    audio_rank = audio_rank or _usual_rank(model, Path(subject_folder))
    if audio_rank not in AUDIO_RANKS:
        raise CospeechError(f"audio rank {audio_rank!r} is not known; known: {', '.join(AUDIO_RANKS)}")
    if audio_rank != "plain" and model not in MATCHED:
        raise CospeechError(f"audio rank: {model} ranks no matches; use knn or resync")
    subject_folder = Path(subject_folder)
    onnx = subject_folder / "models" / model / "model.onnx"
    if model in GESTURES:
        return load_network(model, onnx, threads)
    if model in BASELINES:
        from cospeech.gestures.baselines import MeanPose, RandomTake

        return {"mean_pose": MeanPose, "random": RandomTake}[model](training_part(subject_folder))
    from cospeech.matching import KNN, Database
    from cospeech.matching.knn import DEFAULTS

    database = Database.load(subject_folder / "database.h5")
    if audio_rank == "learned":
        from cospeech.matching.search.similarity import Similarity

        database = Similarity.load(subject_folder / RANK).applied(database)
    if model == "knn_published":
        return KNN(database)
    knn = KNN(database, **DEFAULTS)
    if model == "knn":
        return knn
    from cospeech.matching.resync.refine import Resynchronizer

    return Resynchronizer(knn, onnx, threads)


def _usual_rank(model, subject_folder):
    if model not in MATCHED or model == "knn_published":
        return "plain"
    if not (subject_folder / RANK).is_file():
        notice(f"{subject_folder / RANK}: not trained yet; matches are ranked by sound alone")
        return "plain"
    return "learned"


def load_network(model, onnx, threads=None):
    """The generator of one of `GESTURES` from its ONNX file, wherever that lies."""
    from cospeech.gestures.chapter4.inference import GestureGenerator, Sampler

    if model in CONTROLLED:
        return ControlledSampler(CONTROLLED[model], Sampler(onnx, threads))
    return (Sampler if model == "moglow" else GestureGenerator)(onnx, threads)


class ControlledSampler:
    """A control variant of MoGlow, asked as the search is: `controls` such as `left_wrist_height=high@2.0-5.5`.

    What is a bound for the search is a target here: the 85th or 15th percentile of the training part, or the value.
    """

    def __init__(self, signal, sampler):
        self.signal, self.sampler = signal, sampler

    def generate(self, features, *, seed=0, controls=(), words=None, temperature=1.0):
        """features (T, 28) -> Motion of T frames; where no control holds, the target is the median."""
        del words
        target = self.target(controls, len(features))
        return self.sampler.generate(features, seed=seed, temperature=temperature, target=target)

    def target(self, controls, frames):
        """(T,) in the signal's unit; of controls that overlap the last one holds."""
        from cospeech.matching.control.controls import Control

        percentiles, fps = self.sampler.targets, self.sampler.description["fps"]
        target = np.full(frames, percentiles[50], np.float32)
        for control in map(Control.of, controls):
            control.check_times(frames, fps)
            bounds = [bound for alternative in control.wanted.alternatives for bound in alternative]
            if len(bounds) != 1 or bounds[0].signal != self.signal:
                raise CospeechError(f"control {control.text!r}: this network knows one level or value of {self.signal}")
            (bound,), stop = bounds, frames if np.isinf(control.end) else round(control.end * fps)
            target[round(control.start * fps) : stop] = percentiles[bound.at] if bound.percentile else bound.at
        return target


def usual_smoothing(model):
    """sigma in frames of the Gaussian that a model's motion gets: the published one, none for the speaker's own."""
    return 0.0 if model in ("knn", "knn_published", "random") else SMOOTHING


def smooth(motion, sigma=SMOOTHING):
    """The published zero-phase Gaussian over time on joints and head rotation, not on expression. sigma in frames."""
    blur = lambda x: None if x is None or not sigma else gaussian_filter1d(x, sigma, axis=0, mode="nearest")  # noqa: E731
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


def synthesize(
    generator, samples, rate, *, subject, clip, model, fps=15.0, seed=0, words=None, smoothing=None, audio="",
    source="", source_sha256="", replace=(), **options,
):  # fmt: skip
    """Speech in, a generated Clip of round(duration * fps) frames out.

    Parameters
    ----------
    samples (N,) float32 mono, rate : the speech.
    smoothing : sigma in frames; None is the published 1.5 for networks and none for plain k-NN, whose frames are the
        speaker's own. The value is kept in the clip's attribute `smoothing`.
    replace : frames to take from other clips at last, see `cospeech.matching.control.replace.Replacement.of`.
    options : passed to the generator (k, initial, mask...); `words` too, when there are controls that may need them.
    """
    from cospeech.speech import integrated_loudness, speech_features

    frames = round(len(samples) / rate * fps)
    if not frames:
        raise CospeechError(
            f"{source or clip}: {len(samples) / rate:.3f} s of sound is less than one frame at {fps} fps"
        )
    features = speech_features(samples, rate, fps, frames)
    if smoothing is None:
        smoothing = usual_smoothing(model)
    if options.get("controls"):
        options["words"] = words
    motion = finished(generator.generate(features, seed=seed, **options), smoothing, replace, fps)
    return Clip(
        subject, clip, fps, motion.positions.astype(np.float32), features,
        rotation=motion.rotation, expression=motion.expression, face_model=motion.face_model,
        words=words or Words.none(), audio=audio, sample_rate=rate, loudness_lufs=integrated_loudness(samples, rate),
        source=source, source_sha256=source_sha256, generator=model,
        extra={"smoothing": float(smoothing), "seed": seed}, trace=motion.trace,
    )  # fmt: skip
