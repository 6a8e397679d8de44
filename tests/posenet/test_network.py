"""The pose network: published shapes and size, learnability, and ImageNet weights in torchvision's layout."""

import dataclasses

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from cospeech.errors import CospeechError, CospeechNotice
from cospeech.posenet import EVALUATED, JOINTS21
from cospeech.posenet.network import DESIGNS, Design, PoseNet, heatmap_peaks, heatmap_targets, load_imagenet
from cospeech.posenet.training import pose_losses as losses

TINY = Design(input=64, blocks=(1, 1, 2), width=8, free=18, latent=64, camera=16)


@pytest.fixture(scope="module")
def full():
    torch.manual_seed(0)
    return PoseNet().eval()


def resnet50_layout():
    """{name: shape} of torchvision's resnet50 state_dict, written down from the publication's table."""
    shapes = {"conv1.weight": (64, 3, 7, 7), "fc.weight": (1000, 2048), "fc.bias": (1000,)}
    norms = {"bn1": 64}
    channels = 64
    for layer, (blocks, width) in enumerate([(3, 64), (4, 128), (6, 256), (3, 512)], start=1):
        for block in range(blocks):
            name, out = f"layer{layer}.{block}", 4 * width
            shapes[f"{name}.conv1.weight"] = (width, channels, 1, 1)
            shapes[f"{name}.conv2.weight"] = (width, width, 3, 3)
            shapes[f"{name}.conv3.weight"] = (out, width, 1, 1)
            norms |= {f"{name}.bn1": width, f"{name}.bn2": width, f"{name}.bn3": out}
            if block == 0:
                shapes[f"{name}.downsample.0.weight"] = (out, channels, 1, 1)
                norms[f"{name}.downsample.1"] = out
            channels = out
    for name, width in norms.items():
        shapes |= {f"{name}.{part}": (width,) for part in ("weight", "bias", "running_mean", "running_var")}
    return shapes


def imagenet(seed=0):
    generator = torch.Generator().manual_seed(seed)
    return {name: torch.rand(shape, generator=generator) for name, shape in resnet50_layout().items()}


# ---- shapes ---------------------------------------------------------------------------------------------------------


def test_published_shapes(full):
    with torch.inference_mode():
        res4d, res5a = full.backbone(torch.zeros(2, 3, 256, 256))
        f3d, output = full.f3d(res5a), full(torch.rand(2, 3, 256, 256))
    assert res4d.shape == res5a.shape == (2, 1024, 16, 16)
    assert f3d.shape == (2, 64, 16, 16) and full.z.out_features == 1024
    assert output.pose.shape == (2, 21, 3) and output.points.shape == (2, 21, 2) and output.camera.shape == (2, 4)
    assert output.heatmaps.shape == (2, 14, 16, 16)
    assert [maps.shape for maps in output.intermediate] == [(2, 14, 16, 16)] * 2


def test_size_is_that_of_the_re_creation(full):
    assert sum(p.numel() for p in full.parameters()) == pytest.approx(33.3e6, rel=0.002)


def test_backbone_up_to_res4f_has_resnets_parameters(full):
    ours = {n: tuple(t.shape) for n, t in full.backbone.state_dict().items() if not n.startswith("res5a")}
    expected = {n: s for n, s in resnet50_layout().items() if not n.startswith(("layer4", "fc"))}
    assert {n: s for n, s in ours.items() if not n.endswith("num_batches_tracked")} == expected


def straight_resnet(x, weights, blocks=(3, 4, 6)):
    """ResNet-50 v1.5 to Res4f from its weights alone: batch norms as plain arithmetic, the stride in the 3 x 3."""

    def norm(x, name):
        mean, var, scale, shift = (
            weights[f"{name}.{part}"][:, None, None] for part in ("running_mean", "running_var", "weight", "bias")
        )
        return (x - mean) / (var + 1e-5).sqrt() * scale + shift

    def conv(x, name, stride=1, padding=0):
        return torch.conv2d(x, weights[f"{name}.weight"], stride=stride, padding=padding)

    x = torch.max_pool2d(norm(conv(x, "conv1", 2, 3), "bn1").clamp(min=0), 3, 2, 1)
    for layer, count in enumerate(blocks, start=1):
        for block in range(count):
            name, stride = f"layer{layer}.{block}", 2 if layer > 1 and block == 0 else 1
            y = norm(conv(x, f"{name}.conv1"), f"{name}.bn1").clamp(min=0)
            y = norm(conv(y, f"{name}.conv2", stride, 1), f"{name}.bn2").clamp(min=0)
            y = norm(conv(y, f"{name}.conv3"), f"{name}.bn3")
            if block == 0:
                x = norm(conv(x, f"{name}.downsample.0", stride), f"{name}.downsample.1")
            x = (x + y).clamp(min=0)
    return x


def test_backbone_computes_resnet_50(full):
    images = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        expected = full.backbone.res5a(straight_resnet(images, full.backbone.state_dict()))
        torch.testing.assert_close(full.backbone(images)[1], expected, rtol=1e-4, atol=1e-4)


def test_heatmaps_and_taps_are_the_first_channels(full):
    images = torch.rand(1, 3, 256, 256)
    with torch.inference_mode():
        output = full(images)
        normalized = (images - torch.tensor([0.485, 0.456, 0.406])[:, None, None]) / full.std
        x = torch.relu(full.backbone.bn1(full.backbone.conv1(normalized)))
        x = full.backbone.layer2(full.backbone.layer1(torch.nn.functional.max_pool2d(x, 3, 2, 1)))
        for block in full.backbone.layer3[:4]:  # a, b, c, d
            x = block(x)
        torch.testing.assert_close(output.intermediate[0], x[:, :14])
        x = full.backbone.res5a(full.backbone.layer3[5](full.backbone.layer3[4](x)))
        torch.testing.assert_close(output.intermediate[1], x[:, :14])
        torch.testing.assert_close(output.heatmaps, full.f3d(x)[:, :14])


def test_pose_is_relative_to_the_root_and_points_are_its_projection(full):
    with torch.inference_mode():
        pose, points, camera, *_ = full(torch.rand(2, 3, 256, 256))
    assert (pose[:, JOINTS21.root] == 0).all() and pose.abs().sum() > 0
    torch.testing.assert_close(points[:, 3, 1], camera[:, 1] * pose[:, 3, 1] + camera[:, 3])
    torch.testing.assert_close(points[:, JOINTS21.root], camera[:, 2:])


def test_lifting_adds_z_to_the_output_of_its_second_layer(full):
    z = torch.randn(3, 1024)
    w = full.lift.state_dict()
    first, second, third, fourth = ((w[f"layers.{i}.weight"], w[f"layers.{i}.bias"]) for i in range(4))
    with torch.no_grad():
        x = (z @ first[0].T + first[1]).clamp(min=0)
        x = (x @ second[0].T + second[1]).clamp(min=0) + z
        x = (x @ third[0].T + third[1]).clamp(min=0)
        x = (x @ fourth[0].T + fourth[1]).clamp(min=0)
        torch.testing.assert_close(full.lift(z), x @ w["out.weight"].T + w["out.bias"])
        assert all(matrix.shape == (1024, 1024) for matrix, _ in (first, second, third, fourth))


@pytest.mark.parametrize("part", DESIGNS)
def test_one_class_serves_body_hand_and_face(part):
    design = dataclasses.replace(DESIGNS[part], input=48, blocks=(1, 1, 1), width=16, latent=32)
    joints, maps = {"body": (21, 14), "hand": (21, 21), "face": (68, 68)}[part]
    output = PoseNet(design).eval()(torch.rand(1, 3, 48, 48))
    assert output.pose.shape == (1, joints, 3) and output.heatmaps.shape == (1, maps, 3, 3)


def test_heatmap_joints_are_found_by_name():
    assert PoseNet(TINY).heatmap_joints == JOINTS21.joints(*EVALUATED)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"input": 250}, "250 is not a multiple of 16"),
        ({"root": "hips"}, "'hips' is not among"),
        ({"blocks": (3, 4)}, "three counts"),
        ({"width": 0}, "too small for 14"),
    ],
)
def test_a_design_that_cannot_be_is_refused(change, words):
    with pytest.raises(CospeechError, match=words):
        dataclasses.replace(Design(), **change)


# ---- learning -------------------------------------------------------------------------------------------------------


def random_labels(count, rng):
    """Random poses whose 2D labels are a true weak-perspective view; the last sample has no 3D label."""
    pose = torch.tensor(rng.normal(0, 0.3, (count, 21, 3)), dtype=torch.float32)
    pose -= pose[:, JOINTS21.root : JOINTS21.root + 1]
    points = (0.8 * pose[:, JOINTS21.joints(*EVALUATED), :2]).clamp(-1, 1)
    child, parent = losses.bones(JOINTS21.parents)
    lengths = torch.zeros(count, 21)
    lengths[:, child] = (pose[:, child] - pose[:, parent]).norm(dim=2)
    labelled = torch.arange(count) < count - 1
    visible = torch.ones(count, 14, dtype=torch.bool)
    return losses.Labels(points, visible, heatmap_targets(points, TINY.side), pose, labelled, lengths)


def test_it_learns_a_handful_of_random_samples_by_heart():
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    images, labels = torch.tensor(rng.random((4, 3, 64, 64)), dtype=torch.float32), random_labels(4, rng)
    network = PoseNet(TINY)
    optimizer = torch.optim.Adam(network.parameters(), 2e-3)
    first = None
    for _ in range(250):
        terms, loss = losses.total_loss(network(images), labels, network.heatmap_joints)
        first = first or {name: term.item() for name, term in terms.items()}
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    last = {name: term.item() for name, term in terms.items()}
    assert all(last[name] < 0.1 * first[name] for name in first), (first, last)
    error = (network(images).pose - labels.pose)[:3].norm(dim=2).mean()
    assert error < 0.05  # metres, of poses whose joints lie about half a metre from the pelvis


def test_every_parameter_gets_a_gradient():
    rng = np.random.default_rng(1)
    network = PoseNet(TINY)
    _, loss = losses.total_loss(network(torch.rand(4, 3, 64, 64)), random_labels(4, rng), network.heatmap_joints)
    loss.backward()
    assert [name for name, p in network.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0] == []


# ---- heatmaps -------------------------------------------------------------------------------------------------------


def test_heatmap_targets_peak_at_the_joint():
    points = torch.tensor([[[-1 + 1 / 16, -1 + 3 / 16], [0.0, 0.0]]])  # centre of pixel (0, 1); a corner of four pixels
    maps = heatmap_targets(points, 16)
    assert maps.shape == (1, 2, 16, 16)
    assert maps[0, 0, 1, 0] == 1 and maps[0, 0, 1, 1].item() == pytest.approx(np.exp(-0.5))
    assert maps[0, 0, 3, 1].item() == pytest.approx(np.exp(-(4 + 1) / 2))  # row is y, column is x
    torch.testing.assert_close(maps[0, 1, 7:9, 7:9], torch.full((2, 2), float(np.exp(-0.25))))


def test_peaks_give_back_the_joints_within_half_a_pixel():
    points = torch.rand(5, 14, 2) * 1.8 - 0.9
    found, score = heatmap_peaks(heatmap_targets(points, 16, sigma=1.5))
    assert (found - points).abs().max() <= 1 / 16 + 1e-6
    assert score.shape == (5, 14) and (score > 0.85).all() and (score <= 1).all()


# ---- ImageNet weights -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["safetensors", "pth"])
def test_imagenet_weights_fill_the_backbone_and_nothing_else(tmp_path, full, suffix):
    weights, path = imagenet(), tmp_path / f"resnet50.{suffix}"
    save_file(weights, path) if suffix == "safetensors" else torch.save(weights, path)
    network = PoseNet()
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    load_imagenet(network, path)
    for name, tensor in network.state_dict().items():
        key = name.removeprefix("backbone.")
        expected = weights[key] if key in weights else before[name]
        assert torch.equal(tensor, expected), name
    assert torch.equal(network.backbone.layer3[5].bn3.running_var, weights["layer3.5.bn3.running_var"])


def test_without_weights_there_is_a_notice():
    with pytest.warns(CospeechNotice, match="from scratch"):
        load_imagenet(PoseNet(TINY), None)


class NotATensor:
    """What a hostile or foreign checkpoint may hold."""


@pytest.mark.parametrize(
    "kind", ["missing", "cut.pth", "cut.safetensors", "object.pth", "list.pth", "other.safetensors"]
)
def test_unusable_weights_get_one_line_with_the_file(tmp_path, kind):
    path = tmp_path / ("none.pth" if kind == "missing" else kind)
    if kind == "cut.pth":
        torch.save({"conv1.weight": torch.zeros(9)}, path)
        path.write_bytes(path.read_bytes()[:200])
    elif kind == "cut.safetensors":
        save_file({"conv1.weight": torch.zeros(9)}, path)
        path.write_bytes(path.read_bytes()[:50])
    elif kind == "object.pth":
        torch.save({"conv1.weight": NotATensor()}, path)
    elif kind == "list.pth":
        torch.save([torch.zeros(1)], path)
    elif kind == "other.safetensors":
        save_file({"encoder.weight": torch.zeros(9)}, path)
    with pytest.raises(CospeechError, match=path.name):
        load_imagenet(PoseNet(TINY), path)


def test_weights_of_another_width_name_the_parameter(tmp_path):
    save_file(imagenet(), tmp_path / "resnet50.safetensors")
    with pytest.raises(CospeechError, match=r"conv1.weight is \(64, 3, 7, 7\), this network's \(8, 3, 7, 7\)"):
        load_imagenet(PoseNet(TINY), tmp_path / "resnet50.safetensors")
