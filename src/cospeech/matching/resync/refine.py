"""The resynchroniser at work: k-NN motion and speech in, refined motion out, through onnxruntime."""

from dataclasses import replace

from cospeech.body.physique import Build
from cospeech.gestures.generator import Speech
from cospeech.learning.weights import OnnxNetwork
from cospeech.matching.knn import KNN
from cospeech.skeleton import UPPER55, from_parent_relative, to_parent_relative


class Resynchronizer:
    """`resync`: the k-NN search followed by the conditional GAN (thesis section 5.3.3)."""

    def __init__(self, knn, path, threads=None):
        self.knn = knn
        self.network = OnnxNetwork(path, threads)
        self.build = Build.of(self.network.description)

    @classmethod
    def load(cls, name, folder, threads=None, audio_rank=None):
        """The network `name` of the subject whose results lie in `folder`, after the search `knn`."""
        knn = KNN.load("knn", folder, threads, audio_rank)
        return cls(knn, folder / "models" / name / "model.onnx", threads)

    def generate(self, speech, *, seed=0, **options):
        """Speech and the options of the k-NN search -> Motion of T frames."""
        speech = Speech.of(speech)
        matched = self.knn.generate(speech, seed=seed, **options)
        relative = to_parent_relative(matched.positions).reshape(len(matched), -1)
        refined = self.network.run_long(features=speech.features, matched=relative)["motion"]
        relative = refined.reshape(matched.positions.shape)
        relative[:, UPPER55.root] = 0  # the pelvis is the origin, where the network puts it only nearly
        positions = from_parent_relative(relative)
        return replace(matched, positions=positions, build=self.build)
