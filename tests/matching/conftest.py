"""Small databases: smooth random motion, and one made of few different frames so that everything ties."""

import numpy as np
import pytest

from cospeech.matching import Database


@pytest.fixture(scope="session")
def random_takes():
    """(rng, lengths) -> smooth random motions (T, 55, 3) and speech features (T, 28), one pair per length."""

    def make(rng, lengths):
        positions = [np.cumsum(rng.normal(size=(n, 55, 3)), axis=0).astype(np.float32) * 0.01 for n in lengths]
        features = [np.cumsum(rng.normal(size=(n, 28)), axis=0).astype(np.float32) * 0.3 for n in lengths]
        return positions, features

    return make


@pytest.fixture(scope="session")
def database(random_takes):
    """Nine clips from three takes."""
    positions, features = random_takes(np.random.default_rng(1), (300, 64, 290))
    return Database.from_arrays(positions, features, ["one", "two", "three"])


@pytest.fixture(scope="session")
def tied(random_takes):
    """Twelve clips whose frames are drawn from six different poses and six different sounds: every rank is tied."""
    rng = np.random.default_rng(2)
    tied = Database.from_arrays(*random_takes(rng, (256, 256, 256)), ["one", "two", "three"])
    few = np.array([0, 7, 19, 23, 40, 51])
    tied.pose = tied.pose[0, rng.choice(few, size=(12, 64))]
    tied.audio = tied.audio[0, rng.choice(few, size=(12, 64))]
    tied.real = tied.real & (rng.random((12, 64)) < 0.8)
    tied.real[4] = False
    tied.eligible &= tied.real
    return tied


@pytest.fixture(scope="session")
def single(random_takes):
    """One clip."""
    return Database.from_arrays(*random_takes(np.random.default_rng(3), (80,)), ["only"])
