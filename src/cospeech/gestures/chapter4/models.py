"""The generators that are networks of their own, by the name a configuration gives them."""

from dataclasses import replace

from cospeech.gestures.generator import MODELS
from cospeech.learning.settings import settings_of


def training_task(name, recordings, settings, seed):
    """The training `Task` of one of chapter 4's models on `Recordings`."""
    return gesture_task(name, recordings.clips, settings, seed, recordings.control.get(MODELS[name].signal))


def gesture_task(model, clips, settings, seed, control=None):
    """The training `Task` of one of chapter 4's models on clips; `settings` is its section of the budget, a dict.

    control : for MoGlow's control variants, their signal in every clip, list of (T,).
    """
    if MODELS[model].section == "moglow":
        from cospeech.gestures.chapter4.moglow import MoGlowTask, Settings

        return MoGlowTask(clips, settings_of(Settings(), settings, model), seed, model, control)
    if model == "lstm":
        from cospeech.gestures.chapter4.lstm import LSTMTask, Settings

        return LSTMTask(clips, settings_of(Settings(), settings, model), seed)
    from cospeech.gestures.chapter4.gesture_gan import GestureTask, Settings

    defaults = replace(Settings(), **MODELS[model].defaults)
    return GestureTask(clips, settings_of(defaults, settings, model), seed, model)
