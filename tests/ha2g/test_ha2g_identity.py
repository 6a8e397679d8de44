"""Speakers known by what they look like: the published encoder, what it learns, and people whom it has never met."""

import re
import warnings

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from cospeech import synthesis
from cospeech.demo import write_take
from cospeech.demo.film import build_set, film_take
from cospeech.demo.take import read_motion
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.gestures.generator import Recordings, Speech
from cospeech.gestures.ha2g.dataset.bones import bone_vectors
from cospeech.gestures.ha2g.dataset.collect import collect
from cospeech.gestures.ha2g.dataset.corpus import Corpus
from cospeech.gestures.ha2g.dataset.filters import Filters
from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.gestures.ha2g.dataset.references import ReferenceFrames, take_reference_frames
from cospeech.gestures.ha2g.long_speech import MultiSpeakerGenerator
from cospeech.gestures.ha2g.models import ha2g_task
from cospeech.gestures.ha2g.networks.identity import IdentityEncoder, ResNet18, export_identity, load_imagenet
from cospeech.gestures.ha2g.networks.style import FrameStyle, StyleCoordinator
from cospeech.learning.training import train
from cospeech.learning.weights import load_weights
from cospeech.skeleton import UPPER55
from cospeech.track import Points, Track
from tests.ha2g.test_ha2g_training import spoken_take

ANYTHING = Filters(words=0, difference=0.0, spine_most=360.0, spine_mean=360.0, wrist=0.0)
SMALL = {"width": 0.12, "blocks": [1, 1, 1, 1], "layers": 1, "batch": 8, "learning_rate": 0.003, "dropout": 0.0}
pytestmark = pytest.mark.filterwarnings("ignore::cospeech.errors.CospeechNotice")
RED, BLUE = (150, 60, 60), (60, 60, 150)


def snapshots(colour, seed, count=6, side=64):
    """Noisy pictures of somebody all in one colour."""
    noise = np.random.default_rng(seed).integers(-50, 50, (count, side, side, 3))
    return (np.array(colour) + noise).astype(np.uint8)


def mirrored(take):
    """The same speech with the opposite motion."""
    take.clip.positions = take.clip.positions * np.float32([-1, 1, 1])
    return take


@pytest.fixture(scope="module")
def corpus():
    """Red people lean to where the higher tone tells them, blue ones away from it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        takes = {"red": [spoken_take(s, "red", 300) for s in range(3)]}
        takes["blue"] = [mirrored(spoken_take(s, "blue", 300)) for s in range(3)]
        references = {"red": snapshots(RED, 0), "blue": snapshots(BLUE, 1), "nobody asked": snapshots(RED, 2)}
        return collect(takes, "ted10", filters=ANYTHING, references=references)


@pytest.fixture(scope="module")
def trained(corpus, tmp_path_factory):
    """The folder of a trained network and of its identity encoder."""
    folder = tmp_path_factory.mktemp("ha2g")
    torch.set_num_threads(1)
    with pytest.warns(CospeechNotice, match="no ImageNet weights were named, it is trained from scratch"):
        synthesis.train("ha2g", Recordings(corpus=corpus), SMALL | {"steps": 80}, seed=0, folder=folder)
    export_identity(folder / "weights.safetensors", folder / "identity.onnx")
    return folder


@pytest.fixture(scope="module")
def generator(trained):
    return MultiSpeakerGenerator(trained / "model.onnx", 1)


def lean(motion):
    """How far the body leans to its left at every frame."""
    spine = bone_vectors(motion.positions, motion.rotation, level_table("ted10"))[:, 0]
    return np.arctan2(spine[:, 0], spine[:, 1])


def obedience(generator, style):
    """Correlation of the motion that a style gives to a new speech with the lean that the speech asks for."""
    take = spoken_take(50, "red", 200)
    motion = generator.generate(Speech(take.samples, 16000), style=style, initial="mean")
    return np.corrcoef(lean(motion), lean(take.clip))[0, 1]


def unseen_speaker(path, colour, seed):
    """A file of reference frames of somebody else of that colour."""
    pictures = snapshots(colour, seed, 5)
    ReferenceFrames("stranger", pictures, ["a"] * 5, np.arange(5.0), np.ones(5, np.float32)).write(path)
    return str(path)


def test_encoder_is_resnet18_without_pooling_and_classifier():
    """torchvision's resnet18 has 11 689 512 parameters, of which its classifier has 513 000."""
    network = ResNet18().eval()
    assert sum(parameter.numel() for parameter in network.parameters()) == 11_689_512 - 513_000
    names = network.state_dict().keys()
    assert {"conv1.weight", "bn1.running_var", "layer1.1.bn2.bias", "layer4.0.downsample.1.weight"} <= names
    assert not any("layer1" in name and "downsample" in name for name in names)
    with torch.no_grad():
        assert network(torch.zeros(1, 3, 224, 224)).shape == (1, 512, 7, 7)
    assert IdentityEncoder(224, 18).mean.in_features == 512 * 7 * 7
    assert IdentityEncoder(64, 18, 0.2)(torch.zeros(2, 3, 64, 64))[0].shape == (2, 18)


def test_speakers_mix_by_weight_and_nobody_is_the_prior():
    torch.manual_seed(0)
    style = FrameStyle([snapshots(RED, 0), snapshots(BLUE, 1, count=3)], 18, 0.1).eval()
    with torch.no_grad():
        each = style.encoder(torch.from_numpy(snapshots(BLUE, 1, count=3)).permute(0, 3, 1, 2).float())[0]
    torch.testing.assert_close(style(torch.eye(2))[0][1], each.mean(0))
    mean, _ = style(torch.tensor([[0.25, 0.75], [0.0, 0.0]]))
    torch.testing.assert_close(mean[0], 0.25 * style.means[0] + 0.75 * style.means[1])
    assert not mean[1].any()


def test_training_looks_at_the_speakers_of_the_batch_alone():
    torch.manual_seed(0)
    style, seen = FrameStyle([snapshots(RED, 0), snapshots(BLUE, 1), snapshots(RED, 2)], 18, 0.1).train(), []
    style.encoder.register_forward_pre_hook(lambda module, given: seen.append(given[0]))
    weights = torch.eye(3)[[2, 0, 0, 2]]
    mean, log_variance = style(weights)
    assert seen[0].shape == (2 * 4, 3, 64, 64) and mean.shape == log_variance.shape == (4, 18)
    torch.testing.assert_close(mean[0], mean[3])
    assert (mean[0] - mean[1]).abs().max() > 1e-3
    mean.sum().backward()
    assert style.encoder.backbone.conv1.weight.grad.abs().sum() > 0


def test_released_coordinator_hears_the_style_where_nobody_has_a_number():
    torch.manual_seed(0)
    coordinator = StyleCoordinator("mlp", 0, 16, 6)
    styles = torch.randn(2, 16)
    shares = coordinator(torch.zeros(2, 2), styles)
    assert (shares[0] - shares[1]).abs().max() > 1e-3
    torch.testing.assert_close(shares.sum(2), torch.ones(2, 6))


def test_corpus_keeps_the_pictures_of_its_speakers_and_of_nobody_else(corpus, tmp_path):
    corpus.write(tmp_path / "corpus.h5")
    back = Corpus.read(tmp_path / "corpus.h5")
    assert set(back.references) == {"red", "blue"} and back.digest() == corpus.digest()
    np.testing.assert_array_equal(back.references["blue"], snapshots(BLUE, 1))
    named = Corpus(**vars(corpus) | {"references": {}})
    named.write(tmp_path / "named.h5")
    assert not Corpus.read(tmp_path / "named.h5").references and named.digest() != corpus.digest()


def test_a_speaker_without_reference_frames_is_one_line():
    takes = {name: [spoken_take(0, name, 100)] for name in ("red", "blue")}
    with pytest.raises(CospeechError, match=r"^blue: has no reference frames.*film blue too, leave blue out, or set"):
        collect(takes, "ted10", filters=ANYTHING, references={"red": snapshots(RED, 0)})
    references = {"red": snapshots(RED, 0), "blue": snapshots(BLUE, 0, side=96)}
    with pytest.raises(CospeechError, match=r"several sizes, \[64, 96\]"):
        collect(takes, "ted10", filters=ANYTHING, references=references)


def test_training_tells_the_speakers_apart(generator):
    assert obedience(generator, "red") > 0.5 and obedience(generator, "blue") < -0.5


def test_who_was_never_seen_moves_like_those_who_look_like_them(generator, tmp_path):
    red, blue = unseen_speaker(tmp_path / "red.h5", RED, 70), unseen_speaker(tmp_path / "blue.h5", BLUE, 71)
    assert obedience(generator, red) > 0.5 and obedience(generator, blue) < -0.5


def test_known_and_unknown_speakers_mix_by_weight(trained, tmp_path):
    """The style that the network is given: known speakers as weights, the others as their share of a vector."""
    given = []

    class Listening:
        def __init__(self, network):
            self.network, self.description = network, network.description

        def __call__(self, **inputs):
            given.append(inputs)
            return self.network(**inputs)

    whole = MultiSpeakerGenerator(trained / "model.onnx", 1)
    generator = MultiSpeakerGenerator(Listening(whole.network), identity=trained / "identity.onnx")
    path = unseen_speaker(tmp_path / "red.h5", RED, 70)
    generator.generate(Speech(np.zeros(8000, np.float32), 16000), style=f"blue=1,{path}=3")
    np.testing.assert_allclose(given[0]["speaker"], [[0.0, 0.25]])
    np.testing.assert_allclose(given[0]["style"][0], 0.75 * whole.style_vector(path), rtol=1e-5)
    generator.generate(Speech(np.zeros(8000, np.float32), 16000), style="blue=1,red=3")
    np.testing.assert_allclose(given[1]["speaker"], [[0.75, 0.25]])
    assert not given[1]["style"].any()


def test_a_speaker_by_name_is_that_speaker_by_their_own_pictures(trained, generator, corpus, tmp_path):
    """The vectors that are kept with the network against the exported encoder."""
    weights, about = load_weights(trained / "weights.safetensors")
    for row, name in enumerate(about["speakers"]):
        pictures = corpus.references[name]
        count = len(pictures)
        known = ReferenceFrames(name, pictures, ["a"] * count, np.arange(float(count)), np.ones(count, np.float32))
        known.write(tmp_path / f"{name}.h5")
        np.testing.assert_allclose(
            generator.style_vector(tmp_path / f"{name}.h5"), weights["style.means"][row], atol=1e-4
        )
        one, two = (obedience(generator, style) for style in (name, str(tmp_path / f"{name}.h5")))
        assert one == pytest.approx(two, abs=1e-3)


def test_no_picture_leaves_the_corpus(trained):
    """Neither the weights nor the networks hold pictures of people; the network does not hold the encoder either."""
    weights, about = load_weights(trained / "weights.safetensors")
    assert about["picture"] == 64 and not any("pictures" in name for name in weights)
    encoder = sum(array.nbytes for name, array in weights.items() if name.startswith("style.encoder."))
    assert encoder > 100_000
    rest = sum(array.nbytes for name, array in weights.items() if not name.startswith(("style.encoder.", "texts.")))
    # Descriptions and graph are the same for both; what the encoder takes would show.
    assert (trained / "model.onnx").stat().st_size < rest + 400_000 + encoder / 2


def test_same_seed_same_network(corpus):
    def weights(seed):
        task = ha2g_task("ha2g", corpus, SMALL | {"steps": 2, "width": 0.06}, seed)
        train(task, 2, seed=seed)
        return task.export()[0].state_dict()

    once, again, other = weights(3), weights(3), weights(4)
    assert all(torch.equal(tensor, again[name]) for name, tensor in once.items())
    assert not torch.equal(once["style.means"], other["style.means"])


def resnet18(seed=0):
    """Weights as torchvision's file has them, classifier included."""
    torch.manual_seed(seed)
    backbone = ResNet18().state_dict().items()
    drawn = {name: torch.rand_like(x) if x.is_floating_point() else x for name, x in backbone}
    return drawn | {"fc.weight": torch.rand(1000, 512), "fc.bias": torch.rand(1000)}


@pytest.mark.parametrize("suffix", ["safetensors", "pth"])
def test_imagenet_weights_fill_the_backbone(tmp_path, suffix):
    weights, path = resnet18(), tmp_path / f"resnet18.{suffix}"
    save_file(weights, path) if suffix == "safetensors" else torch.save(weights, path)
    encoder = IdentityEncoder(64, 18)
    head = encoder.mean.weight.clone()
    load_imagenet(encoder, path)
    for name, tensor in encoder.backbone.state_dict().items():
        assert torch.equal(tensor, weights[name]), name
    assert torch.equal(encoder.mean.weight, head)


def test_wrong_imagenet_weights_are_one_line(tmp_path):
    save_file(resnet18(), tmp_path / "right.safetensors")
    with pytest.raises(CospeechError, match=r"conv1\.weight is \(64, 3, 7, 7\), .*ha2g\.width 1 only"):
        load_imagenet(IdentityEncoder(64, 18, 0.2), tmp_path / "right.safetensors")
    weights = resnet18()
    del weights["layer3.1.conv2.weight"]
    save_file(weights, tmp_path / "other.safetensors")
    with pytest.raises(CospeechError, match=r"has no 'layer3\.1\.conv2\.weight'; expected resnet18's"):
        load_imagenet(IdentityEncoder(64, 18), tmp_path / "other.safetensors")
    (tmp_path / "broken.pth").write_bytes(b"no weights")
    with pytest.raises(CospeechError, match=r"broken\.pth: not a readable"):
        load_imagenet(IdentityEncoder(64, 18), tmp_path / "broken.pth")


def test_strangers_where_they_cannot_be_known_are_one_line(generator, trained, tmp_path):
    path, silence = unseen_speaker(tmp_path / "red.h5", RED, 70), np.zeros(8000, np.float32)
    about = {key: value for key, value in generator.description.items() if key != "picture"}

    class Named:
        description = about

        def __call__(self, **inputs):
            raise AssertionError("refused before")

    by_name = MultiSpeakerGenerator(Named())
    with pytest.raises(CospeechError, match=re.escape(f"{path}: ha2g knows its speakers (red, blue) by name, not by")):
        by_name.generate(Speech(silence, 16000), style=path)
    alone = MultiSpeakerGenerator(trained / "model.onnx", 1, identity=tmp_path / "identity.onnx")
    with pytest.raises(CospeechError, match=r"identity\.onnx: no such file"):
        alone.generate(Speech(silence, 16000), style=path)
    ReferenceFrames("big", snapshots(RED, 0, 2, 96), ["a"] * 2, np.arange(2.0), np.ones(2)).write(tmp_path / "big.h5")
    with pytest.raises(CospeechError, match=r"big\.h5: 96 pixels wide, the network knows pictures of 64"):
        generator.generate(Speech(silence, 16000), style=str(tmp_path / "big.h5"))
    with pytest.raises(CospeechError, match="no speaker 'green'; known: red, blue, or random"):
        generator.generate(Speech(silence, 16000), style="green")


# ---- The virtual speakers, on film ----------------------------------------------------------------------------------

SECONDS, SIZE = 5.0, (160, 120)


def filmed(folder, speaker):
    """A short film of a virtual speaker and the track of a tracker that makes no mistake: (film, Track)."""
    wav, truth, film = (folder / f"{speaker}.{suffix}" for suffix in ("wav", "h5", "mp4"))
    write_take(speaker, 0, seconds=SECONDS, seed=1, wav=wav, truth=truth)
    film_take(film, truth=truth, wav=wav, size=SIZE)
    stage = build_set(speaker, 0, 1, "studio", SIZE)
    space = stage.see(read_motion(truth, wav, 15.0)[0])
    xy = space[..., :2] / space[..., 2:] * [stage.camera.fx, stage.camera.fy] + [stage.camera.cx, stage.camera.cy]
    body = Points(UPPER55.name, xy.astype(np.float32), np.ones(xy.shape[:2], np.float32), np.ones(len(xy), bool))
    return film, Track(15.0, len(xy), *SIZE, body)


def test_virtual_speakers_are_known_again_in_frames_that_nothing_has_learned_from(tmp_path):
    """The encoder learns to tell calm from lively by the first half of a film of each, and is shown the second."""
    references, others = {}, {}
    for speaker in ("calm", "lively"):
        films, half = {"take": filmed(tmp_path, speaker)}, SECONDS / 2
        references[speaker] = take_reference_frames(speaker, films, {"take": [(0.0, half)]}, count=6, size=64)
        others[speaker] = take_reference_frames(speaker, films, {"take": [(half, SECONDS)]}, count=3, size=64)
        assert references[speaker].times.max() < half <= others[speaker].times.min()
    takes = {"calm": [spoken_take(0, "calm", 150)], "lively": [mirrored(spoken_take(1, "lively", 150))]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        references = {name: found.pictures for name, found in references.items()}
        corpus = collect(takes, "ted10", filters=ANYTHING, references=references)
    task = ha2g_task("ha2g", corpus, SMALL | {"steps": 25, "text": False, "width": 0.06, "batch": 8}, 0)
    train(task, 25, seed=0)
    style = task.export()[0].style
    for speaker, found in others.items():
        with torch.no_grad():
            mean = style.encoder(torch.from_numpy(found.pictures).permute(0, 3, 1, 2).float())[0].mean(0)
        distances = dict(zip(corpus.speakers, (mean - style.means).norm(dim=1).tolist(), strict=True))
        assert min(distances, key=distances.get) == speaker, distances
