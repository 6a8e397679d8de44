"""The generators that are networks of their own, by the name a configuration gives them."""

from dataclasses import replace

from cospeech.learning.settings import settings_of

ADVERSARY = {"regression": "none", "gesture_gan": "audio_pose", "velocity_gan": "velocity"}  # of the chapter 4 network
# MoGlow trained with a control signal as one more input, one network for each, as thesis chapter 5 compares against.
CONTROLLED = {"moglow_height": "left_wrist_height", "moglow_speed": "left_wrist_speed", "moglow_symmetry": "symmetry"}
GESTURES = (*ADVERSARY, "lstm", "moglow", *CONTROLLED)


def gesture_task(model, clips, settings, seed, control=None):
    """The training `Task` of one of `GESTURES` on clips; `settings` is the budget's section of that name, a dict.

    control : for those of `CONTROLLED`, their signal in every clip, list of (T,).
    """
    if model == "moglow" or model in CONTROLLED:
        from cospeech.gestures.chapter4.moglow import MoGlowTask, Settings

        return MoGlowTask(clips, settings_of(Settings(), settings, model), seed, model, control)
    if model == "lstm":
        from cospeech.gestures.chapter4.lstm import LSTMTask, Settings

        return LSTMTask(clips, settings_of(Settings(), settings, model), seed)
    from cospeech.gestures.chapter4.gesture_gan import GestureTask, Settings

    defaults = replace(Settings(), adversary=ADVERSARY[model])
    return GestureTask(clips, settings_of(defaults, settings, model), seed, model)
