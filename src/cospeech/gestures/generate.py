"""The chapter 4 networks at work: speech features in, motion out, through onnxruntime."""

import numpy as np

from cospeech.gestures.vectors import vectors_to_motion
from cospeech.weights import OnnxNetwork


class GestureGenerator:
    """Any network of `gestures.models` from its ONNX file."""

    def __init__(self, path, threads=None):
        self.network = OnnxNetwork(path, threads)
        self.description = self.network.description

    def generate(self, features, *, seed=0):
        """features (T, 28) -> Motion of T frames with head rotation and, if trained on faces, expression.

        The network is deterministic: `seed` is accepted, as by every generator, and changes nothing.
        """
        del seed
        vectors = self.network.run_long(features=features)
        return vectors_to_motion(vectors, self.description["face_model"])


class Sampler(GestureGenerator):
    """`moglow` from its ONNX file: motion drawn from the distribution that it has learnt."""

    def generate(self, features, *, seed=0, temperature=1.0):
        """features (T, 28) -> Motion of T frames with head rotation; another `seed`, other motion.

        temperature : deviation of the noise; below 1 the motion is nearer to the likeliest.
        """
        channels = sum(self.description["channels"][part] for part in ("body", "hands"))
        noise = temperature * np.random.default_rng(seed).standard_normal((len(features), channels), dtype=np.float32)
        return vectors_to_motion(self.network.run_long(features=features, noise=noise))
