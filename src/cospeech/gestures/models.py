"""The generators that are networks of their own, by the name a configuration gives them."""

from dataclasses import replace

from cospeech.settings import settings_of

ADVERSARY = {"regression": "none", "gesture_gan": "audio_pose", "velocity_gan": "velocity"}  # of the chapter 4 network
GESTURES = (*ADVERSARY, "lstm", "moglow")


def gesture_task(model, clips, settings, seed):
    """The training `Task` of one of `GESTURES` on clips; `settings` is the budget's section of that name, a dict."""
    if model == "moglow":
        from cospeech.gestures.moglow import MoGlowTask, Settings

        return MoGlowTask(clips, settings_of(Settings(), settings, model), seed)
    if model == "lstm":
        from cospeech.gestures.lstm import LSTMTask, Settings

        return LSTMTask(clips, settings_of(Settings(), settings, model), seed)
    from cospeech.gestures.gesture_gan import GestureTask, Settings

    defaults = replace(Settings(), adversary=ADVERSARY[model])
    return GestureTask(clips, settings_of(defaults, settings, model), seed, model)
