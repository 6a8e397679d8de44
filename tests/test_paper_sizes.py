"""config/budgets/paper.yaml runs: two iterations of every network, as large as it was published.

Everything is as published but the iterations, and what `SMALLER` says: these batches need minutes or gigabytes on two
cores, and one more window in a batch, or one more frame in MoGlow's windows, runs through no other code.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml

from cospeech.evaluation.metrics import fgd, sync_classifier
from cospeech.gestures.chapter4.models import gesture_task
from cospeech.gestures.generator import MODELS as ALL
from cospeech.gestures.ha2g.models import MODELS, ha2g_task
from cospeech.learning.settings import settings_of
from cospeech.learning.training import train
from cospeech.matching import Database
from cospeech.matching.resync.gan import ResyncTask, settings_from
from cospeech.matching.search import similarity
from cospeech.posenet.training.loader import Mixture
from cospeech.posenet.training.stages import PoseTask
from tests.ha2g.test_ha2g_training import corpus_of
from tests.posenet.stick_people import write_stick_people
from tools import config

CHAPTER4 = [name for name, model in ALL.items() if "chapter4" in model.task]

PAPER = yaml.safe_load((config.ROOT / "config/budgets/paper.yaml").read_text())
SMALLER = {
    "moglow": {"batch": 2, "frames": 10},
    "resync": {"batch": 10},
    "ha2g": {"batch": 2},
    "trimodal": {"batch": 16},
    "seq2seq": {"batch": 16},
    "speech2gesture": {"batch": 8},
    "joint_embedding": {"batch": 16},
    "posenet": {"batch": 2, "pretraining_batch": 2},
}
SEEDS = {"joint_embedding": 1}  # one iteration from speech, one from poses
STEPS = {"steps": 2, "pretraining": 2}
pytestmark = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")


def section(name):
    """A section of paper.yaml with two iterations, of each stage where there are several, and what is `SMALLER`."""
    keys = config.sections()[name].settings.__dataclass_fields__
    return PAPER[name] | {key: value for key, value in STEPS.items() if key in keys} | SMALLER.get(name, {})


def settings(name):
    return settings_of(config.sections()[name].settings, section(name), name)


@pytest.fixture(scope="module")
def database(toy_clips):
    return Database.from_arrays(
        [c.positions for c in toy_clips],
        [c.features for c in toy_clips],
        [c.clip for c in toy_clips],
        rotations=[c.rotation for c in toy_clips],
    )


@pytest.fixture(scope="module")
def corpus():
    return corpus_of([0], frames=120, levels="expressive43")


@pytest.fixture
def two_threads():
    """As a training has them; what the machine had comes back."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def learns(task, steps=2, seed=0):
    """Train; every network has changed and no loss is without a number."""
    before = {name: [p.detach().clone() for p in module.parameters()] for name, module in task.modules.items()}
    history = train(task, steps, seed=seed)
    for name, module in task.modules.items():
        assert any(not torch.equal(p, old) for p, old in zip(module.parameters(), before[name], strict=True)), name
    return history


@pytest.mark.usefixtures("two_threads")
class TestPublishedSizes:
    @pytest.mark.parametrize("model", [m for m in CHAPTER4 if m in PAPER])
    def test_chapter4(self, toy_clips, model):
        learns(gesture_task(model, toy_clips, section(model), seed=0))

    def test_resync(self, toy_clips, database):
        learns(ResyncTask(toy_clips, settings_from(section("resync")), 0, database))

    def test_audio_rank(self, database):
        similarity.train_similarity(database, settings("audio_rank"))

    def test_feature_net(self, toy_clips):
        fgd.train_feature_net(toy_clips, settings("feature_net"))

    @pytest.mark.parametrize("ruler", [name for name in fgd.PRESETS if name != fgd.OURS])
    def test_ha2g_ruler(self, toy_clips, ruler):
        fgd.train_feature_net(toy_clips, settings("ha2g_ruler"), preset=ruler)

    @pytest.mark.parametrize("frames", [64, 32, 16])
    def test_sync_classifier(self, toy_clips, frames):
        learns(sync_classifier.SyncTask(toy_clips, replace(settings("sync_classifier"), frames=frames), 0))

    @pytest.mark.parametrize("model", MODELS)
    def test_ha2g(self, corpus, model):
        history = learns(ha2g_task(model, corpus, section(model), seed=0), seed=SEEDS.get(model, 0))
        assert model != "joint_embedding" or history.losses.keys() == {"from_speech", "from_poses"}

    def test_ha2g_of_speakers_known_by_pictures(self, corpus):
        rng, shape = np.random.default_rng(0), settings("reference_frames")
        side = (shape.count, shape.size, shape.size, 3)
        pictures = {name: rng.integers(0, 256, side).astype(np.uint8) for name in corpus.speakers}
        learns(ha2g_task("ha2g", replace(corpus, references=pictures), section("ha2g"), seed=0))

    @pytest.mark.parametrize("part", ["body", "hand", "face"])
    def test_posenet(self, tmp_path, part):
        people = Mixture([write_stick_people(tmp_path / "people.h5", studio=3, wild=3, part=part)])
        task = PoseTask(people, settings("posenet"), 0)
        learns(task, task.total)
