"""HA2G's hot paths: six levels against one generator of as many parameters, a training step in parts, 60 s of speech.

    python benchmarks/bench_ha2g.py [--width 0.2] [--layers 2] [--blocks 1 1 1 1] [--batch 32] [--threads 1]

On random windows. GRUs are compiled, and beside them as torch has them. The sizes are those of the arguments;
`--width 1 --layers 4 --blocks 3 4 6 3` are the published ones. Processor seconds count, so that a busy machine changes
the ratios little.
"""

import argparse
import tempfile
from functools import partial
from pathlib import Path

import torch
from timing import PROCESSOR, fastest, timed

from cospeech.gestures.ha2g import losses
from cospeech.gestures.ha2g.dataset.corpus import FRAMES, SEED_FRAMES
from cospeech.gestures.ha2g.dataset.levels import level_table
from cospeech.gestures.ha2g.networks.gru import GRU
from cospeech.gestures.ha2g.networks.hierarchical_audio_learner import FEATURES, SpectrogramEncoder
from cospeech.gestures.ha2g.networks.hierarchical_pose_inferer import Cascade, Level, inferred_levels
from cospeech.gestures.ha2g.networks.style import LOOKS, FrameStyle
from cospeech.learning.weights import OnnxNetwork, export_onnx

STYLE = 18
processor_seconds = partial(fastest, clock=PROCESSOR, warm=True)


def size(network):
    return sum(parameter.numel() for parameter in network.parameters())


def equal_holistic(table, cascade, conditions, layers):
    """One level of the whole pose whose number of parameters is nearest to the cascade's."""
    channels = 3 * table.vectors
    of = lambda hidden: Level(channels, conditions, hidden, layers, 0.3)
    low, high = 8, 2048
    while high - low > 2:
        middle = (low + high) // 2 // 2 * 2
        low, high = (middle, high) if size(of(middle)) < size(cascade) else (low, middle)
    holistic = Cascade([table.channels(len(table.levels) - 1)], conditions, layers=1, width=0.02)
    holistic.levels[0] = of(high)
    return holistic


class Speaking(torch.nn.Module):
    """Audio encoder and cascade as they run when generating."""

    def __init__(self, audio, cascade):
        super().__init__()
        self.audio, self.cascade = audio, cascade

    def forward(self, mel, seed, style):
        heard = self.audio(mel).mean(1)
        conditions = torch.cat([heard, style[:, None].expand(-1, FRAMES, -1)], dim=2)
        return self.cascade(seed, [conditions] * len(self.cascade.levels))[-1]


def train_step(network, *given):
    sum(made.sum() for made in network(*given)).backward()


def speech(network, mel, seed, style, threads):
    """Seconds on the clock for 30 windows, each begun with the last poses of the one before, and the export's."""
    with tempfile.TemporaryDirectory() as folder:
        path, example = Path(folder, "model.onnx"), {"mel": mel[:1], "seed": seed[:1], "style": style[:1]}
        settings = {"multiple": 1}
        exported, _ = timed(lambda: export_onnx(network, path, example, ["poses"], settings, sequences=False))
        onnx = OnnxNetwork(path, threads)

        def speak():
            before = seed[:1].numpy()
            for _ in range(30):
                before = onnx(mel=mel[:1].numpy(), seed=before, style=style[:1].numpy())[0][:, -SEED_FRAMES:]

        return timed(speak)[0], exported


def looking(width, batch, side=64, speakers=2):
    """Processor seconds of looking at each speaker of a batch once, and at the frames of each of its windows."""
    pictures = torch.randint(256, (speakers, 16, side, side, 3), dtype=torch.uint8)
    style, weights = FrameStyle([of_one.numpy() for of_one in pictures], STYLE, width), torch.eye(speakers)
    weights = weights[torch.arange(batch) % speakers]
    frames = torch.rand(LOOKS * batch, 3, side, side) * 255
    once = processor_seconds(lambda: train_step(style, weights))
    return once, processor_seconds(lambda: train_step(style.encoder, frames))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--width", type=float, default=0.2)
    parser.add_argument("--layers", type=int, default=2)
    parser.add_argument("--blocks", type=int, nargs=4, default=[1, 1, 1, 1])
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(arguments.threads)
    table, conditions, layers, batch = level_table("expressive43"), FEATURES + STYLE, arguments.layers, arguments.batch
    channels = [table.channels(level) for level in inferred_levels(table)]
    cascade = Cascade(channels, conditions, arguments.width, layers)
    holistic = equal_holistic(table, cascade, conditions, layers)
    seed, heard = torch.randn(batch, SEED_FRAMES, 126), [torch.randn(batch, FRAMES, conditions)] * len(channels)
    print(f"six levels ({size(cascade):,} parameters) and one ({size(holistic):,}), forward and backward:")
    for made_by, torchs in (("compiled", False), ("torch's GRU", True)):
        for module in (*cascade.modules(), *holistic.modules()):
            if isinstance(module, GRU):
                module.twice = torchs
        six = processor_seconds(lambda: train_step(cascade, seed, heard))
        one = processor_seconds(lambda: train_step(holistic, seed, heard))
        print(f"    {made_by}: {1e3 * six:.0f} ms and {1e3 * one:.0f} ms, ratio {six / one:.2f}")

    audio, mel = SpectrogramEncoder(arguments.blocks, arguments.width), torch.rand(batch, 128, 70) * -80
    print(f"audio encoder: {1e3 * processor_seconds(lambda: train_step(audio, mel)):.0f} ms")
    once, each = looking(arguments.width, batch)
    print(f"identity encoder: {1e3 * once:.0f} ms, for each window {1e3 * each:.0f} ms, ratio {each / once:.1f}")
    vectors = torch.randn(batch, FRAMES, table.vectors, 3, requires_grad=True)
    angles = processor_seconds(lambda: losses.included_angles(vectors, table).sum().backward())
    words, features = torch.randn(batch * FRAMES, FEATURES), torch.randn(3, batch * FRAMES, FEATURES).requires_grad_()
    contrast = processor_seconds(lambda: losses.contrastive(words, features, 0.1).backward())
    print(f"included angles: {1e3 * angles:.0f} ms, contrastive loss on all frames: {1e3 * contrast:.0f} ms")

    seconds, exported = speech(Speaking(audio, cascade), mel, seed, torch.randn(batch, STYLE), arguments.threads)
    print(f"60 s of speech through onnxruntime, {arguments.threads} threads: {seconds:.2f} s (export {exported:.0f} s)")


if __name__ == "__main__":
    main()
