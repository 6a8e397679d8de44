"""MoGlow's control variants, asked as the search is."""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.gestures.chapter4.inference import Sampler
from cospeech.gestures.generator import MODELS, Speech
from cospeech.matching.control.controls import Control


class ControlledSampler:
    """A control variant of MoGlow, asked as the search is: `controls` such as `left_wrist_height=high@2.0-5.5`.

    What is a bound for the search is a target here: the 85th or 15th percentile of the training part, or the value.
    """

    def __init__(self, signal, sampler):
        self.signal, self.sampler = signal, sampler

    @classmethod
    def load(cls, name, folder, threads=None):
        """The network `name` of the subject whose results lie in `folder`."""
        return cls(MODELS[name].signal, Sampler.load(name, folder, threads))

    def generate(self, speech, *, seed=0, controls=(), temperature=1.0):
        """Speech -> Motion of T frames; where no control holds, the target is the median."""
        target = self.target(controls, len(Speech.of(speech)))
        return self.sampler.generate(speech, seed=seed, temperature=temperature, target=target)

    def target(self, controls, frames):
        """(T,) in the signal's unit; of controls that overlap the last one holds."""
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
