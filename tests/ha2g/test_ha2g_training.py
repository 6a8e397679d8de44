"""HA2G and its baselines in training: they learn what speech does to poses, and export what they have learnt."""

import warnings

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from cospeech.clip import Clip, Words
from cospeech.errors import CospeechError
from cospeech.gestures.ha2g.dataset.collect import Take, collect
from cospeech.gestures.ha2g.dataset.filters import Filters
from cospeech.gestures.ha2g.hierarchy import published
from cospeech.gestures.ha2g.models import MODELS, ha2g_task
from cospeech.learning.training import train
from cospeech.learning.weights import OnnxNetwork, export_onnx
from tests.conftest import make_clip

ANYTHING = Filters(words=0, difference=0.0, spine_most=360.0, spine_mean=360.0, wrist=0.0)
TINY = {"width": 0.06, "batch": 8}
SMALL = {
    "ha2g": TINY | {"blocks": [1, 1, 1, 1], "layers": 1},
    "trimodal": TINY | {"layers": 1},
    "seq2seq": TINY,
    "speech2gesture": TINY,
    "joint_embedding": TINY | {"layers": 1},
}


def spoken_take(seed, subject, frames):
    """A body that leans left and right as the higher of two tones outweighs the lower, and a word at every turn."""
    rng = np.random.default_rng(seed)
    lean = 4 * gaussian_filter1d(rng.normal(size=frames), 4)
    pose = make_clip(0).positions[0]
    turns = Rotation.from_rotvec(np.outer(lean, [0, 0, 0.5])).as_matrix()
    time = np.arange(round(frames / 15 * 16000)) / 16000
    strength = np.interp(time, (np.arange(frames) + 0.5) / 15, lean)
    samples = 0.1 * (np.sin(4000 * np.pi * time) * np.exp(strength) + np.sin(800 * np.pi * time) * np.exp(-strength))
    turned = np.flatnonzero(np.diff(np.sign(lean))) / 15
    words = Words(turned, turned + 0.01, ["left" if lean[round(t * 15)] > 0 else "right" for t in turned])
    positions = np.einsum("tij,pj->tpi", turns, pose).astype(np.float32)
    clip = Clip(subject, f"take{seed}", 15.0, positions, np.zeros((frames, 28), np.float32), words=words)
    return Take(clip, samples.astype(np.float32))


def corpus_of(seeds, frames=300, levels="ted10", speakers=("one", "two")):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return collect(
            {name: [spoken_take(seed + 100 * i, name, frames) for seed in seeds] for i, name in enumerate(speakers)},
            levels,
            filters=ANYTHING,
        )


@pytest.fixture(scope="module")
def corpus():
    return corpus_of(range(3))


@pytest.fixture(scope="module")
def trained(corpus):
    torch.set_num_threads(1)
    settings = SMALL["ha2g"] | {"steps": 70, "batch": 16, "width": 0.12, "learning_rate": 0.003, "r1": 1.0}
    task = ha2g_task("ha2g", corpus, settings, seed=0)
    task.history = train(task, 70, seed=0)
    return task


def generate(task, windows, mean, speaker=None):
    """The trained network on windows of another corpus of the same speakers: whole unit vectors (n, 34, 3V)."""
    network, own = task.generator.eval(), task.corpus.mean
    given = {name: torch.from_numpy(np.ascontiguousarray(windows[name])) for name in ("mel", "speaker")}
    given["seed"] = torch.from_numpy(windows["poses"][:, :4] + mean - own)
    given["speaker"] = task.weights_of(given["speaker"]) if speaker is None else speaker
    given["style"] = torch.zeros(len(given["mel"]), task.settings.style)
    with torch.no_grad():
        poses = network(*(given[name] for name in network.inputs)).numpy() + own
    network.train()
    return poses


def test_ha2g_learns_more_than_the_mean_pose_and_than_holding_still(trained):
    other = corpus_of([11, 12], 150)
    windows = other.windows(slice(None))
    true = windows["poses"] + other.mean
    error = np.abs(generate(trained, windows, other.mean) - true)[:, 4:].mean()
    assert error < 0.75 * np.abs(trained.corpus.mean - true)[:, 4:].mean()
    assert error < 0.75 * np.abs(true[:, 3:4] - true)[:, 4:].mean()


def test_ha2g_hears_the_speech_and_not_only_the_seed_poses(trained):
    other = corpus_of([11, 12], 150)
    windows = other.windows(slice(None))
    true = windows["poses"] + other.mean
    right = np.abs(generate(trained, windows, other.mean) - true).mean()
    wrong = np.abs(generate(trained, windows | {"mel": windows["mel"][::-1]}, other.mean) - true).mean()
    assert right < 0.8 * wrong


def test_discriminator_joins_after_its_warm_up_and_stays_even(trained):
    losses = trained.history.losses
    joined = np.isfinite(losses["discriminator"])
    assert joined.tolist() == np.isfinite(losses["adversarial"]).tolist() == [step >= 7 for step in range(70)]
    assert np.mean(losses["discriminator"][-20:]) > 0.3  # it has not run away
    assert {"huber", "divergence", "diverging", "contrastive", "physical"} <= losses.keys()


@pytest.mark.parametrize("model", ["ha2g", "trimodal"])
def test_only_a_discriminator_of_mixed_batches_sees_that_motion_is_too_small(model, corpus):
    """Alone in its batch, a third of the motion is to batch norm what the whole of it is."""
    apart = {}
    for mixed in (False, True):
        task = ha2g_task(model, corpus, SMALL[model] | {"steps": 1, "dropout": 0.0, "mixed": mixed}, 0)
        real = torch.from_numpy(corpus.windows(slice(None), ("poses",))["poses"])
        scores, of_less = task.scores(real, real / 3)
        apart[mixed] = ((scores - of_less).abs().mean() / scores.std()).item()
    assert apart[False] < 0.05 < 0.2 < apart[True]


def test_speakers_are_mixed_by_weight(trained):
    windows = trained.corpus.windows(np.arange(1))
    weights = [torch.tensor([w]) for w in ([1.0, 0.0], [0.5, 0.5], [0.0, 1.0])]
    one, both, two = (generate(trained, windows, trained.corpus.mean, w) for w in weights)
    assert np.abs(one - two).max() > 1e-4
    assert np.abs(both - (one + two) / 2).max() < 0.5 * np.abs(one - two).max()  # between them


def test_same_seed_same_network(corpus):
    def weights(seed):
        task = ha2g_task("ha2g", corpus, SMALL["ha2g"] | {"steps": 2}, seed)
        train(task, 2, seed=seed)
        return torch.cat([parameter.flatten() for parameter in task.generator.parameters()])

    assert torch.equal(weights(1), weights(1))
    assert not torch.equal(weights(1), weights(2))


@pytest.mark.parametrize("model", MODELS)
def test_every_network_learns_a_few_windows_by_heart(model):
    torch.set_num_threads(1)
    few = corpus_of([5], 80, speakers=["one"])
    steps = 90 if model in ("seq2seq", "joint_embedding") else 50
    settings = SMALL[model] | {"steps": steps, "learning_rate": 0.01, "width": 0.1, "batch": 4}
    settings |= {"weights": {"adversarial": 0.0}} if model == "speech2gesture" else {"dropout": 0.0}
    task = ha2g_task(model, few, settings, 0)
    history = train(task, steps, seed=0)
    kind = {"ha2g": "huber", "trimodal": "huber", "seq2seq": "error", "speech2gesture": "distance"}
    curve = np.array(history.losses[kind.get(model, "from_speech")])
    curve = curve[np.isfinite(curve)]
    share = 0.85 if model == "joint_embedding" else 0.6  # its one vector has to tell all 34 frames
    assert curve[-10:].mean() < share * curve[:5].mean()


@pytest.mark.parametrize("model", ["ha2g", "joint_embedding"])  # every kind of layer; all are compared when written
def test_exports_equal_torch(model, corpus, tmp_path):
    settings = SMALL[model] | {"steps": 1, "width": 0.02} | ({"preset": "released"} if model == "ha2g" else {})
    task = ha2g_task(model, corpus, settings, 0)
    for step in range(2):
        task.iterate(step, np.random.default_rng(step))
    network, example, outputs = task.export()
    export_onnx(network, tmp_path / "model.onnx", example, outputs, task.description, sequences=False)
    onnx = OnnxNetwork(tmp_path / "model.onnx", 1)
    assert onnx.outputs == ["poses"] and set(network.inputs) == set(example) == set(onnx.description["inputs"])
    given = {name: torch.randn_like(x) for name, x in example.items()}
    given["words"] = torch.randint(corpus.vocabulary.size, (1, 34)).float()
    with torch.no_grad():
        expected = network(*(given[name] for name in example)).numpy()
    found = onnx(**{name: x.numpy() for name, x in given.items()})[0]
    assert found.shape == (1, 34, 27)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_every_ablation_trains(corpus):
    rows = [
        {"audio_levels": ["low"]},
        {"in_level_negatives": False},
        {"cross_level_negatives": False},
        {"text": False},
        {"pose_hierarchy": "none"},
        {"pose_hierarchy": "body"},
        {"pose_hierarchy": "hands"},
        {"same_audio": True},
        {"weights": {"physical": 0.0}},
        {"preset": "released"},
        {"style_input": False, "contrast_frames": 20},
    ]
    for row in rows:
        task = ha2g_task("ha2g", corpus, TINY | {"steps": 1, "width": 0.02, "layers": 1, "blocks": [1] * 4} | row, 0)
        losses = task.iterate(0, np.random.default_rng(0))
        assert all(np.isfinite(float(value)) for value in losses.values())
        assert ("physical" in losses) == (row.get("weights") is None)
        assert ("contrastive" in losses) == row.get("text", True)
        for key in row.keys() - {"weights", "audio_levels"}:
            assert task.description["settings"][key] == row[key]


def test_presets_are_the_published_ones():
    paper, released = published("paper", "expressive43"), published("released", "expressive43")
    assert (paper.batch, paper.epochs, paper.weights["huber"], paper.slope) == (64, 180, 166.7, 0.2)
    assert (released.batch, released.epochs, released.weights["huber"], released.slope) == (96, 100, 250, 0.01)
    assert (paper.text_input, released.text_input) == (False, True)
    ted = published("released", "ted10")
    assert (ted.batch, ted.epochs, ted.weights["huber"]) == (256, 100, 70)
    for settings in (paper, released, ted):
        assert (settings.learning_rate, settings.betas, settings.discriminator_rate) == (5e-4, (0.5, 0.999), 0.2)
        assert {name: settings.weights[name] for name in ("adversarial", "divergence", "diverging", "physical")} == {
            "adversarial": 5,
            "divergence": 0.1,
            "diverging": 0.05,
            "physical": 0.01,
        }


def test_epochs_become_steps(corpus):
    task = ha2g_task("trimodal", corpus, TINY | {"epochs": 3.0, "batch": 7, "layers": 1}, 0)
    assert task.settings.steps == round(3 * len(corpus) / 7)


@pytest.mark.parametrize(
    ("model", "settings", "complaint"),
    [
        ("ha3g", {}, "model 'ha3g' is not known; known: ha2g, trimodal"),
        ("ha2g", {"preset": "newest"}, "ha2g.preset"),
        ("ha2g", {"pose_hierarchy": "feet"}, "ha2g.pose_hierarchy"),
        ("ha2g", {"audio_levels": ["deep"]}, "ha2g.audio_levels"),
        ("ha2g", {"coordinator": "none"}, "ha2g.coordinator"),
        ("seq2seq", {"r1": 1.0}, "unknown key 'seq2seq.r1'"),
    ],
)
def test_mistakes_are_one_clear_line(model, settings, complaint, corpus):
    with pytest.raises(CospeechError, match=r"^[^\n]*$") as error:
        ha2g_task(model, corpus, settings, 0)
    assert complaint in str(error.value)
