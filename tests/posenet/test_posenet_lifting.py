"""The stage that looks at no images, and the learning curve."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cospeech.posenet.evaluation.accuracy import scores
from cospeech.posenet.network import heatmap_peaks
from cospeech.posenet.store import Store
from cospeech.posenet.training.augment import augment, augment_labels
from cospeech.posenet.training.curve import LearningCurve, learning_curve
from cospeech.posenet.training.loader import Mixture
from cospeech.posenet.training.stages import LIFTED, PoseTask, Settings, train_posenet
from tests.posenet.stick_people import stick_people, write_stick_people

TINY = Settings(
    pretraining=4,
    pretraining_batch=8,
    lifting=5,
    steps=11,
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
    return write_stick_people(tmp_path_factory.mktemp("people") / "train.h5", studio=24, wild=24)


def task_of(people, settings=TINY, **options):
    return PoseTask(Mixture([people]), settings, 0, **options)


def test_labels_move_as_those_of_images_do():
    batch = stick_people(12, "studio")
    seen = augment(batch, np.random.default_rng(3), 32, margin=1.3, colour=0)
    alone = augment_labels(replace(batch, images=None), np.random.default_rng(3), 32, side=64, margin=1.3)
    assert alone.images is None and len(alone) == 12
    for name in ("joints2d", "visible", "joints3d"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(seen, name))


def test_lifting_trains_what_follows_f3d_and_nothing_else(people):
    task = task_of(people)
    assert [task.stage(step)[0] for step in (0, 3, 4, 8, 9, 19)] == [
        *["pretraining"] * 2,
        *["lifting"] * 2,
        *["training"] * 2,
    ]
    before = {name: tensor.clone() for name, tensor in task.network.state_dict().items()}
    terms = task.iterate(TINY.pretraining, None)
    assert set(terms) == {"pose", "bone_vector", "projection"}
    after = task.network.state_dict()
    changed = {name.split(".")[0] for name, tensor in after.items() if not torch.equal(tensor, before[name])}
    assert changed == {"z", "lift", "camera"}
    task.loader.close()


def test_it_is_fed_heatmaps_of_visible_joints_of_people_with_3d_labels(people):
    task = task_of(people, replace(TINY, input=128, augment={"scale": 0.0, "rotate": 0.0, "translate": 0.0}))
    maps, labels = task.draw(TINY.pretraining)
    assert maps.shape == (LIFTED, 24, 8, 8) and labels.labelled.all()
    assert maps[:, 14:].abs().max() == 0
    peaks, strength = heatmap_peaks(maps[:, :14])
    clear = labels.visible & (strength > 0.7)
    assert clear.sum() > 0.5 * labels.visible.sum()
    off = (peaks - labels.points).norm(dim=2)[clear]  # a map's pixel is 0.25 wide: half of it, or one more by the noise
    assert off.median() < 0.18 and off.max() < 0.5
    assert (strength[~labels.visible] < 0.4).all()


def test_lifting_alone_learns_to_lift(people):
    """On heatmaps drawn without images the error falls well under that of the mean pose."""
    task = task_of(people, replace(TINY, pretraining=0, lifting=120, input=64, latent=64))
    for step in range(120):
        task.iterate(step, None)
    maps, labels = task.draw(119)
    with torch.inference_mode():
        pose = task.network.lifted(maps).pose
    error, of_mean = (
        (p - labels.pose).norm(dim=2).mean() for p in (pose, torch.from_numpy(np.float32(task.people.mean_pose / 1000)))
    )
    task.loader.close()
    assert error < 0.75 * of_mean


def test_learning_curve_is_pck_on_people_not_trained_on(people, tmp_path):
    test = write_stick_people(tmp_path / "test.h5", studio=9, wild=5, size=32, seed=4)
    settings = replace(TINY, pretraining=4, lifting=0, steps=16)
    task = train_posenet([people], settings, seed=0, folder=tmp_path / "out", test=[test])
    steps, curve = learning_curve(tmp_path / "out/history.h5")
    assert steps.tolist() == [2, 4, 6, 8, 10, 12, 14, 16, 18, 20] and set(curve) == {"studio", "wild"}
    store = Store(test)
    with torch.inference_mode():
        images = torch.from_numpy(store[:].images).permute(0, 3, 1, 2).float() / 255
        pose = 1000 * task.network.eval()(images).pose.numpy()
    for domain, values in curve.items():
        mine = store.tags["domain"] == domain
        expected = scores(pose[mine], store.joints3d[mine], "scale", task.curve)["PCK"]
        assert values[-1] == pytest.approx(expected, abs=0.5)


def test_looking_at_the_curve_changes_no_weights(people, tmp_path):
    test = write_stick_people(tmp_path / "test.h5", studio=3, wild=3, size=32, seed=4)
    for name, options in {"with": {"test": [test]}, "without": {}}.items():
        train_posenet([people], TINY, seed=0, folder=tmp_path / name, **options)
    files = [tmp_path / name / "weights.safetensors" for name in ("with", "without")]
    assert files[0].read_bytes() == files[1].read_bytes()
    steps, curve = learning_curve(tmp_path / "without/history.h5")
    assert len(steps) == 0 and curve == {}


def test_the_curve_looks_at_the_same_people_of_every_domain(tmp_path, people):
    test = write_stick_people(tmp_path / "test.h5", studio=700, wild=2, size=32, seed=4)
    curve = LearningCurve([test], "body", TINY.design("body"))
    assert {name: len(batch) for name, batch in curve.people.items()} == {"studio": 300, "wild": 2}
    assert set(curve(task_of(people).network)) == {"PCK studio", "PCK wild"}
