"""The network of thesis 3.3: ResNet-50 features, explicit 2D heatmaps, lifting to 3D, and a weak-perspective camera.

    images (B, 3, 256, 256) -> Res4f (B, 1024, 16, 16) -> Res5a (B, 1024, 16, 16) -> F3D = [h2D, d] (B, 64, 16, 16)
    -> z (B, 1024) -> f3D -> pose (B, 21, 3)     and     z -> f_c -> camera (B, 4) -> points (B, 21, 2)

The numbers are the published ones; all of them are fields of `Design`. Where the thesis is silent: F3D is a 1 x 1
convolution, Res5a keeps ResNet's inner width of 512 and has the plain shortcut (it changes neither size nor channels),
f_c has one hidden layer of 256.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import nn

from cospeech.errors import CospeechError, notice
from cospeech.learning.weights import load_torchvision
from cospeech.posenet import EVALUATED, JOINTS21
from cospeech.posenet.camera import weak_perspective
from cospeech.posenet.datasets.parts import PARTS

STRIDE = 16  # s in thesis 3.3.4: image pixels per heatmap pixel, along one side
EXPANSION = 4  # a bottleneck's output channels over its width
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet's RGB, for which the weights were trained


@dataclass(frozen=True)
class Design:
    """Everything that fixes a network's shape.

    joints : names of the J joints predicted in 3D. root : the one at the origin. parents : J indices, -1 for the root.
    heatmaps : names of the K joints with a heatmap, each one of `joints`.
    unit : metres in which poses are predicted, so that every part is about one unit large.
    input : side of the square crop in pixels, a multiple of 16.
    blocks : bottlenecks in levels 2 to 4. width : of level 2; levels 3 and 4 are 2 and 4 times as wide.
    free : channels of F3D beside the heatmaps. latent : size of z and of f3D's layers. camera : hidden size of f_c.
    """

    joints: tuple = JOINTS21.names
    root: str = "pelvis"
    parents: tuple = JOINTS21.parents
    heatmaps: tuple = EVALUATED
    unit: float = 1.0
    input: int = 256
    blocks: tuple = (3, 4, 6)
    width: int = 64
    free: int = 50
    latent: int = 1024
    camera: int = 256

    def __post_init__(self):
        missing = [name for name in (self.root, *self.heatmaps) if name not in self.joints]
        if missing:
            raise CospeechError(f"pose network: {missing[0]!r} is not among its joints {', '.join(self.joints)}")
        if len(self.parents) != len(self.joints):
            raise CospeechError(f"pose network: {len(self.parents)} parents for {len(self.joints)} joints")
        if self.input < STRIDE or self.input % STRIDE:
            raise CospeechError(f"pose network: input {self.input} is not a multiple of {STRIDE}")
        if len(self.blocks) != 3 or min(self.blocks) < 1:
            raise CospeechError(f"pose network: blocks {self.blocks} are not three counts of at least 1")
        if self.channels < len(self.heatmaps):
            raise CospeechError(f"pose network: width {self.width} is too small for {len(self.heatmaps)} heatmaps")

    @property
    def channels(self):
        """Channels of level 4 and of Res5a: 16 times the width (1024)."""
        return 4 * EXPANSION * self.width

    @property
    def side(self):
        """Side of a heatmap (16)."""
        return self.input // STRIDE


def _design(part, unit):
    skeleton = part.skeleton
    return Design(skeleton.names, skeleton.names[skeleton.root], skeleton.parents, part.heatmaps, unit)


DESIGNS = {name: _design(part, 1.0 if name == "body" else 0.1) for name, part in PARTS.items()}  # by part


class Output(NamedTuple):
    """What `PoseNet` returns for B crops.

    pose (B, J, 3) : root-relative joints in the design's unit (body: metres), in the crop's virtual camera frame.
    points (B, J, 2) : their projection (equation 3.2), in the crop's coordinates, -1 to 1.
    camera (B, 4) : alpha_x, alpha_y, c_x, c_y. heatmaps (B, K, h, w) : h2D. intermediate : the same of res4d and res5a.
    """

    pose: torch.Tensor
    points: torch.Tensor
    camera: torch.Tensor
    heatmaps: torch.Tensor
    intermediate: tuple


class Bottleneck(nn.Module):
    """ResNet's block, (B, C, h, w) -> (B, out, h / stride, w / stride), with torchvision's parameter names.

    width : channels of the 3 x 3 convolution. out : 4 times the width by default.
    """

    def __init__(self, channels, width, stride=1, out=None):
        super().__init__()
        out = out or EXPANSION * width
        self.conv1, self.bn1 = nn.Conv2d(channels, width, 1, bias=False), nn.BatchNorm2d(width)
        self.conv2, self.bn2 = nn.Conv2d(width, width, 3, stride, padding=1, bias=False), nn.BatchNorm2d(width)
        self.conv3, self.bn3 = nn.Conv2d(width, out, 1, bias=False), nn.BatchNorm2d(out)
        self.downsample = None
        if stride != 1 or channels != out:
            self.downsample = nn.Sequential(nn.Conv2d(channels, out, 1, stride, bias=False), nn.BatchNorm2d(out))

    def forward(self, x):
        shortcut = x if self.downsample is None else self.downsample(x)
        x = torch.relu(self.bn1(self.conv1(x)))
        x = torch.relu(self.bn2(self.conv2(x)))
        return torch.relu(self.bn3(self.conv3(x)) + shortcut)


def level(channels, width, blocks, stride):
    """One level of ResNet: `blocks` bottlenecks, the first with the stride."""
    first, rest = Bottleneck(channels, width, stride), range(blocks - 1)
    return nn.Sequential(first, *(Bottleneck(EXPANSION * width, width) for _ in rest))


class Backbone(nn.Module):
    """ResNet up to Res4f, then Res5a without stride. Names are those of torchvision's resnet50, whose `layer4` and `fc`
    it lacks; its own `res5a` is trained from scratch.

    images (B, 3, S, S), normalised -> res4d, res5a, each (B, channels, S / 16, S / 16)
    """

    def __init__(self, design):
        super().__init__()
        w, (two, three, four) = design.width, design.blocks
        self.conv1, self.bn1 = nn.Conv2d(3, w, 7, 2, padding=3, bias=False), nn.BatchNorm2d(w)
        self.layer1 = level(w, w, two, 1)
        self.layer2 = level(EXPANSION * w, 2 * w, three, 2)
        self.layer3 = level(2 * EXPANSION * w, 4 * w, four, 2)
        self.res5a = Bottleneck(design.channels, 8 * w, out=design.channels)
        self.tap = four // 2  # res4d is block 3 of 6
        for module in self.modules():
            if isinstance(module, nn.Conv2d):  # He et al. 2015, as ResNet is trained from scratch
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x):
        x = torch.relu(self.bn1(self.conv1(x)))
        x = self.layer2(self.layer1(nn.functional.max_pool2d(x, 3, 2, padding=1)))
        res4d = self.layer3[: self.tap + 1](x)
        return res4d, self.res5a(self.layer3[self.tap + 1 :](res4d))


class Lift(nn.Module):
    """f3D (after Martinez et al. 2017): z (B, latent) -> (B, out). Four layers with ReLU, then a linear one; z is added
    to the output of the second."""

    def __init__(self, latent, out):
        super().__init__()
        self.layers = nn.ModuleList(nn.Linear(latent, latent) for _ in range(4))
        self.out = nn.Linear(latent, out)

    def forward(self, z):
        first, second, third, fourth = self.layers
        x = z + torch.relu(second(torch.relu(first(z))))
        return self.out(torch.relu(fourth(torch.relu(third(x)))))


class PoseNet(nn.Module):
    """images (B, 3, S, S) RGB in 0 to 1 -> `Output`. `heatmap_joints`: indices among the J joints of the K heatmaps."""

    def __init__(self, design=None):
        super().__init__()
        self.design = design = design or Design()
        self.root = design.joints.index(design.root)
        self.heatmap_joints = [design.joints.index(name) for name in design.heatmaps]
        features = len(design.heatmaps) + design.free
        self.backbone = Backbone(design)
        self.f3d = nn.Conv2d(design.channels, features, 1)
        self.z = nn.Linear(features * design.side**2, design.latent)
        self.lift = Lift(design.latent, 3 * len(design.joints))
        self.camera = nn.Sequential(nn.Linear(design.latent, design.camera), nn.ReLU(), nn.Linear(design.camera, 4))
        with torch.no_grad():  # starts near one metre to half a crop, centred: about a person in a tight crop
            self.camera[2].bias.copy_(torch.tensor([1.0, 1.0, 0.0, 0.0]))
        for name, values in {"mean": MEAN, "std": STD}.items():
            self.register_buffer(name, torch.tensor(values)[:, None, None], persistent=False)

    def forward(self, images):
        res4d, res5a = self.backbone((images - self.mean) / self.std)
        count = len(self.heatmap_joints)
        return self.lifted(self.f3d(res5a), (res4d[:, :count], res5a[:, :count]))

    def lifted(self, f3d, intermediate=()):
        """What follows F3D (B, K + free, side, side): `Output`."""
        z = self.z(f3d.flatten(1))
        pose = self.lift(z).unflatten(1, (-1, 3))
        pose = pose - pose[:, self.root : self.root + 1]
        camera = self.camera(z)
        heatmaps = f3d[:, : len(self.heatmap_joints)]
        return Output(pose, weak_perspective(pose, camera), camera, heatmaps, intermediate)


def images_of(batch):
    """A Batch's crops as the network reads them: (N, 3, S, S) float32 RGB, 0 to 1."""
    return torch.from_numpy(batch.images).permute(0, 3, 1, 2).float().div_(255)


# ---- heatmaps -------------------------------------------------------------------------------------------------------


def heatmap_targets(points, side, sigma=1.0):
    """Target maps: points (..., K, 2) in the crop's coordinates -> (..., K, side, side), Gaussians with a peak of 1.

    sigma is in heatmap pixels (not published). The peak lies where the joint does, between pixels too.
    """
    axis = (2 * torch.arange(side, dtype=points.dtype, device=points.device) + 1) / side - 1
    x, y = torch.exp(-0.5 * ((axis - points[..., None]) * side / (2 * sigma)).square()).unbind(-2)
    return y[..., :, None] * x[..., None, :]


def heatmap_peaks(heatmaps):
    """Where maps are highest: (..., h, w) -> points (..., 2) in the crop's coordinates, and the maxima (...,).

    The maximum is the confidence of thesis 4.3. Accurate to a pixel of the map.
    """
    height, width = heatmaps.shape[-2:]
    score, index = heatmaps.flatten(-2).max(dim=-1)
    x, y = index % width, index // width
    return torch.stack([(2 * x + 1) / width - 1, (2 * y + 1) / height - 1], dim=-1), score


# ---- ImageNet weights -----------------------------------------------------------------------------------------------


def load_imagenet(network, path):
    """Put ImageNet weights of ResNet-50 in torchvision's layout (.safetensors, or .pth) into a network's backbone.

    `layer4` and `fc` of the file are not used; Res5a and all that follows keeps its initialization. Nothing else than
    tensors is read from a .pth. Without a path a notice says that training starts from scratch. Raises CospeechError
    when the file is unreadable or of another network.
    """
    if path is None:
        return notice("pose network: no ImageNet weights were named, the backbone is trained from scratch")
    load_torchvision(network.backbone, path, "resnet50", "only width 64 and blocks (3, 4, 6)", without=["res5a."])
