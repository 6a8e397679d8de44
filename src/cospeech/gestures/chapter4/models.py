"""The generators that are networks of their own, by the name a configuration gives them."""

from dataclasses import replace

from cospeech.gestures.generator import MODELS, section_of
from cospeech.learning.settings import settings_of


def training_task(name, recordings, settings, seed):
    """The training `Task` of one of chapter 4's models on `Recordings`."""
    return gesture_task(name, recordings.clips, settings, seed, recordings.control.get(MODELS[name].signal))


def defaults_of(model):
    """The `Settings` of one of chapter 4's models as published, which its section of the budget changes."""
    if section_of(model) == "moglow":
        from cospeech.gestures.chapter4.moglow import Settings
    elif model == "lstm":
        from cospeech.gestures.chapter4.lstm import Settings
    else:
        from cospeech.gestures.chapter4.gesture_gan import Settings
    return replace(Settings(), **MODELS[model].defaults)


def gesture_task(model, clips, settings, seed, control=None):
    """The training `Task` of one of chapter 4's models on clips; `settings` is its section of the budget, a dict.

    control : for MoGlow's control variants, their signal in every clip, list of (T,).
    """
    settings = settings_of(defaults_of(model), settings, model)
    if section_of(model) == "moglow":
        from cospeech.gestures.chapter4.moglow import MoGlowTask

        return MoGlowTask(clips, settings, seed, model, control)
    if model == "lstm":
        from cospeech.gestures.chapter4.lstm import LSTMTask

        return LSTMTask(clips, settings, seed)
    from cospeech.gestures.chapter4.gesture_gan import GestureTask

    return GestureTask(clips, settings, seed, model)
