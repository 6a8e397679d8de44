"""Training the pose network: what it is fed, both stages, interruptions, and that it learns."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.learning import training
from cospeech.learning.training import History
from cospeech.posenet.network import PoseNet
from cospeech.posenet.store import Store, write_store
from cospeech.posenet.training.loader import Loader, Mixture
from cospeech.posenet.training.stages import ROWS, PoseTask, Settings, train_posenet
from tests.posenet.stick_people import BACKGROUND, stick_people, write_stick_people

TINY = Settings(
    pretraining=6,
    pretraining_batch=8,
    steps=14,
    batch=8,
    optimizer="adam",
    schedule="cosine",
    learning_rate=2e-3,
    input=32,
    blocks=(1, 1, 1),
    width=8,
    free=10,
    latent=32,
    camera=8,
)

pytestmark = pytest.mark.filterwarnings("ignore:pose network. no ImageNet")


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    folder = tmp_path_factory.mktemp("people")
    return write_stick_people(folder / "train.h5", studio=24, wild=24)


def task_of(people, settings=TINY, seed=0, **options):
    return PoseTask(Mixture([people]), settings, seed, **options)


# ---- what it is fed -------------------------------------------------------------------------------------------------


def test_stage_1_sees_2d_labels_alone_and_stage_2_a_mix(people):
    task = task_of(people, replace(TINY, studio=0.25))
    assert not task.draw(0)[1].labelled.any()
    for step in (TINY.pretraining, TINY.pretraining + 3):
        images, labels = task.draw(step)
        assert labels.labelled.sum() == 2 and len(labels.labelled) == 8
        assert images.shape == (8, 3, 32, 32) and images.min() >= 0 and images.max() <= 1


def test_each_stage_trains_what_the_thesis_says(people):
    task = task_of(people)
    before = {name: tensor.clone() for name, tensor in task.network.named_parameters()}
    terms = task.iterate(0, None)
    assert set(terms) == {"heatmap"}
    changed = {name.split(".")[0] for name, p in task.network.named_parameters() if not torch.equal(p, before[name])}
    assert changed == {"backbone", "f3d"}
    terms = task.iterate(TINY.pretraining, None)
    assert set(terms) == {"heatmap", "pose", "bone_vector", "bone_length", "projection"}
    assert all(not torch.equal(p, before[name]) for name, p in task.network.named_parameters() if "lift" in name)
    task.loader.close()


def test_labels_are_the_batchs_in_the_networks_units(people):
    task = task_of(people)
    batch = Store(people)[np.arange(5)]
    small = replace(batch, joints2d=batch.joints2d / 2 - 0.25)  # from 64 to 32 pixels
    labels = task.labels(small, task.lengths[np.zeros(5, int)])
    np.testing.assert_allclose(labels.pose.numpy(), batch.joints3d / 1000, rtol=1e-6)
    np.testing.assert_allclose(labels.points.numpy(), (batch.joints2d + 0.5) / 32 - 1, rtol=1e-5, atol=1e-6)
    assert labels.heatmaps.shape == (5, 14, 2, 2)
    measured = np.linalg.norm(batch.joints3d[:, 3] - batch.joints3d[:, 2], axis=1)  # right elbow from shoulder
    assert measured.min() / 1000 < labels.lengths[0, 3] < measured.max() / 1000


def test_small_parts_are_predicted_in_tenths_of_metres(tmp_path):
    hands = write_stick_people(tmp_path / "hands.h5", studio=4, wild=4, part="hand")
    task = task_of(hands)
    labels = task.labels(Store(hands)[np.arange(3)], task.lengths[:1].repeat(3, 0))
    np.testing.assert_allclose(labels.pose.numpy(), Store(hands).joints3d[:3] / 100, rtol=1e-6)
    assert task.iterate(TINY.pretraining, None)["pose"] > 0
    task.loader.close()


def test_stores_are_counted_through(tmp_path, people):
    other = write_stick_people(tmp_path / "more.h5", studio=5, wild=0, size=48, seed=3)
    both = Mixture([people, other])
    assert len(both.labelled3d) == 53 and both.labelled3d[48:].all()
    batch = both.crops(np.array([50, 0, 30]), np.random.default_rng(0), 32)
    assert batch.images.shape == (3, 32, 32, 3) and batch.labelled3d.tolist() == [True, False, True]
    hands = write_stick_people(tmp_path / "hands.h5", studio=2, wild=2, part="hand")
    with pytest.raises(CospeechError, match=r"hands.h5: shows a hand"):
        Mixture([people, hands])


def test_studio_people_stand_before_wild_backgrounds_when_asked(tmp_path):
    store = tmp_path / "masked.h5"
    batches = []
    for domain in ("studio", "wild"):
        batch = stick_people(6, domain)
        person = (batch.images != BACKGROUND[domain]).any(axis=3)
        batches.append(replace(batch, mask=np.where(person, 255, 0).astype(np.uint8)))
    write_store(store, batches, part="body", source="sticks")
    still = dict.fromkeys(("scale", "rotate", "translate", "colour", "flip"), 0.0)
    grey = {}
    for share in (0.0, 1.0):
        mixture = Mixture([store], backgrounds=True)
        crops = mixture.crops(np.arange(6), np.random.default_rng(0), 64, **still, replace=share)
        grey[share] = np.median(crops.images)
    assert abs(grey[0.0] - BACKGROUND["studio"]) < 5 and abs(grey[1.0] - BACKGROUND["wild"]) < 12


def test_nobody_with_3d_labels_is_one_line(tmp_path):
    wild = write_stick_people(tmp_path / "wild.h5", studio=0, wild=4)
    with pytest.raises(CospeechError, match=r"wild.h5: nobody has 3D labels"):
        task_of(wild)


def test_people_without_2d_only_ones_fill_the_batch(tmp_path):
    task = task_of(write_stick_people(tmp_path / "studio.h5", studio=6, wild=0))
    assert task.draw(0)[1].labelled.all() and task.draw(TINY.pretraining)[1].labelled.all()


@pytest.mark.parametrize("prefetch", [0, 3])
def test_loader_gives_each_step_its_own_batch_whatever_was_asked_before(prefetch):
    loader = Loader(lambda step: step * 10, steps=6, prefetch=prefetch)
    assert [loader.take(step) for step in (3, 4, 5)] == [30, 40, 50]
    assert loader.coming == {}
    loader.close()


# ---- schedules ------------------------------------------------------------------------------------------------------


def test_published_schedule_decays_and_starts_again_in_stage_2(people):
    task = task_of(people, replace(TINY, pretraining=100, schedule="exponential", decay=0.1, decay_steps=50))
    rate = task.learning_rate
    assert rate(0) == rate(100) == TINY.learning_rate
    assert rate(50) == pytest.approx(rate(0) / 10) and rate(149) == pytest.approx(TINY.learning_rate * 0.1 ** (49 / 50))


def test_cosine_schedule_warms_up_and_ends_at_nothing(people):
    task = task_of(people, replace(TINY, pretraining=100, steps=200))
    rates = [task.learning_rate(step) for step in range(300)]
    assert max(rates[:100]) == pytest.approx(TINY.learning_rate, rel=0.02) and rates[0] < 0.3 * TINY.learning_rate
    assert rates[99] < 0.01 * TINY.learning_rate and rates[299] < 0.01 * TINY.learning_rate < rates[110]


def test_discrepancy_slows_pre_trained_layers_in_stage_2_alone(people):
    task = task_of(people, replace(TINY, discrepancy=100.0, optimizer="adadelta"))
    shares = {name: [g["share"] for g in optimizer.param_groups] for name, optimizer in task.optimizers.items()}
    assert shares == {"pretraining": [1.0, 1.0], "training": [0.01, 1.0]}
    slow = {id(p) for p in task.optimizers["training"].param_groups[0]["params"]}
    assert slow == {id(p) for n, p in task.network.named_parameters() if n.startswith(("backbone", "f3d"))}
    assert all(g["rho"] == 0.9 for g in task.optimizers["training"].param_groups)


@pytest.mark.parametrize("change", [{"optimizer": "sgd"}, {"schedule": "step"}, {"studio": 1.5}])
def test_impossible_settings_name_the_key(change):
    with pytest.raises(CospeechError, match=f"posenet.{next(iter(change))}"):
        replace(TINY, **change)


def test_rows_of_the_ablation_differ_in_what_table_3_6_says(people):
    terms = {}
    for row in ROWS:
        task = task_of(people, TINY.row(row))
        terms[row] = {name for name, value in task.iterate(TINY.pretraining, None).items() if value > 0}
        assert set(task.iterate(0, None)) == {"heatmap"}  # the same pre-training
        task.loader.close()
    direct = {"pose", "bone_vector"}
    assert terms == {
        "baseline": direct,
        "latent": {*direct, "bone_length", "heatmap"},
        "projection": {*direct, "bone_length", "projection"},
        "both": {*direct, "bone_length", "heatmap", "projection"},
    }


# ---- whole trainings ------------------------------------------------------------------------------------------------


def test_interrupted_training_ends_in_the_same_bytes(people, tmp_path, monkeypatch):
    options = {"seed": 3}
    train_posenet([people], TINY, folder=tmp_path / "whole", **options)
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    iterate = PoseTask.iterate

    def interrupted(self, step, rng):
        if step == TINY.pretraining + 5:
            raise KeyboardInterrupt
        return iterate(self, step, rng)

    monkeypatch.setattr(PoseTask, "iterate", interrupted)
    resumed = {"folder": tmp_path / "resumed", "checkpoint": tmp_path / "c.pt", **options}
    with pytest.raises(KeyboardInterrupt):
        train_posenet([people], TINY, **resumed)
    assert not (tmp_path / "resumed").exists()
    monkeypatch.setattr(PoseTask, "iterate", iterate)
    with pytest.warns(CospeechNotice, match="resumed after 11"):
        train_posenet([people], TINY, **resumed)
    whole, again = (folder / "weights.safetensors" for folder in (tmp_path / "whole", tmp_path / "resumed"))
    assert whole.read_bytes() == again.read_bytes()
    assert not (tmp_path / "c.pt").exists()
    assert History.read(tmp_path / "resumed/history.h5").step[-1] == 20


def test_training_beats_the_mean_pose(tmp_path):
    train = write_stick_people(tmp_path / "train.h5", studio=300, wild=300)
    still = {"scale": 0.0, "rotate": 0.0, "translate": 0.0, "colour": 0.0, "flip": 0.0}
    settings = replace(TINY, pretraining=20, steps=150, batch=32, width=12, latent=64, augment=still)
    task = train_posenet([train], settings, seed=0, folder=tmp_path / "out")
    test = Store(write_stick_people(tmp_path / "test.h5", studio=100, wild=0, seed=9))
    with torch.inference_mode():
        images = torch.from_numpy(test[:].images).permute(0, 3, 1, 2).float() / 255
        pose = 1000 * task.network.eval()(torch.nn.functional.avg_pool2d(images, 2)).pose.numpy()
    error, of_mean = (np.linalg.norm(p - test.joints3d, axis=2).mean() for p in (pose, task.people.mean_pose))
    assert error < 0.9 * of_mean
    assert load_file(tmp_path / "out/weights.safetensors").keys() == PoseNet(task.design).state_dict().keys()
