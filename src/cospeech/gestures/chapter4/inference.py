"""The chapter 4 networks at work: speech features in, motion out, through onnxruntime."""

import numpy as np

from cospeech.body.physique import Build
from cospeech.gestures.chapter4.vectors import vectors_to_motion
from cospeech.gestures.generator import Speech
from cospeech.learning.weights import OnnxNetwork


class GestureGenerator:
    """Any network of chapter 4 from its ONNX file."""

    def __init__(self, path, threads=None):
        self.network = OnnxNetwork(path, threads)
        self.description = self.network.description
        self.build = Build.of(self.description)

    @classmethod
    def load(cls, name, folder, threads=None):
        """The network `name` of the subject whose results lie in `folder`."""
        return cls(folder / "models" / name / "model.onnx", threads)

    def generate(self, speech, *, seed=0):
        """Speech -> Motion of T frames with head rotation and, if trained on faces, expression.

        The network is deterministic: `seed` is accepted, as by every generator, and changes nothing.
        """
        del seed
        vectors = self.network.run_long(features=Speech.of(speech).features)
        return vectors_to_motion(vectors, self.description["face_model"], self.build)


class Sampler(GestureGenerator):
    """`moglow` from its ONNX file: motion drawn from the distribution that it has learnt.

    `targets` of a control variant: {percentile: value} of its signal in the training part; None of `moglow` itself.
    """

    @property
    def targets(self):
        found = self.description.get("targets")
        return found and {int(percentile): value for percentile, value in found.items()}

    def generate(self, speech, *, seed=0, temperature=1.0, target=None):
        """Speech -> Motion of T frames with head rotation; another `seed`, other motion.

        temperature : deviation of the noise; below 1 the motion is nearer to the likeliest. target : of a control
        variant, what its signal shall be, a number or (T,), in its unit; None is the training part's median.
        """
        features = Speech.of(speech).features
        channels = sum(self.description["channels"][part] for part in ("body", "hands"))
        noise = temperature * np.random.default_rng(seed).standard_normal((len(features), channels), dtype=np.float32)
        given = {"features": features, "noise": noise}
        if self.targets:
            wanted = self.targets[50] if target is None else target
            given["control"] = np.broadcast_to(np.asarray(wanted, np.float32), len(features))[:, None]
        return vectors_to_motion(self.network.run_long(**given), build=self.build)
