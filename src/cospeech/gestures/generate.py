"""The chapter 4 networks at work: speech features in, motion out, through onnxruntime."""

from cospeech.gestures.vectors import vectors_to_motion
from cospeech.weights import OnnxNetwork


class GestureGenerator:
    """`regression` or `gesture_gan` from its ONNX file."""

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
