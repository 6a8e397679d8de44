"""The resynchroniser at work: k-NN motion and speech in, refined motion out, through onnxruntime."""

from dataclasses import replace

import numpy as np

from cospeech.learning.weights import OnnxNetwork
from cospeech.skeleton import UPPER55, from_parent_relative, to_parent_relative


class Resynchronizer:
    """`resync`: the k-NN search followed by the conditional GAN (thesis section 5.3.3)."""

    def __init__(self, knn, path, threads=None):
        self.knn = knn
        self.network = OnnxNetwork(path, threads)
        self.bone_lengths = np.array(self.network.description["bone_lengths"], np.float32)

    def generate(self, features, *, seed=0, **options):
        """features (T, 28) and the options of the k-NN search -> Motion of T frames."""
        matched = self.knn.generate(features, seed=seed, **options)
        relative = to_parent_relative(matched.positions).reshape(len(matched), -1)
        refined = self.network.run_long(features=features, matched=relative)["motion"]
        relative = refined.reshape(matched.positions.shape)
        relative[:, UPPER55.root] = 0  # the pelvis is the origin, where the network puts it only nearly
        positions = from_parent_relative(relative)
        return replace(matched, positions=positions, bone_lengths=self.bone_lengths)
