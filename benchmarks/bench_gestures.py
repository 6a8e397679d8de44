"""MoGlow's sampling in one ONNX scan against a loop over frames, and one hour of speech through every network.

    python benchmarks/bench_gestures.py [--seconds 60] [--hour 3600]

Networks of the demo budget's size with first weights, on noise for speech: their time and memory do not depend on what
they have learnt. Every line is measured in this one run.
"""

import argparse
import resource
import tempfile
from pathlib import Path

import numpy as np
import torch
from timing import timed

from cospeech.clip import Clip
from cospeech.files import read_yaml
from cospeech.gestures.chapter4.models import gesture_task
from cospeech.gestures.generator import find, resolve
from cospeech.learning.weights import export_onnx

FPS = 15.0
BUDGET = Path(__file__).parents[1] / "config" / "budgets" / "demo.yaml"


def speaker(frames=256):
    """A clip of noise, whose shapes are all that counts."""
    rng = np.random.default_rng(0)
    noise = lambda *shape: rng.normal(size=(frames, *shape)).astype(np.float32)
    return Clip("bench", "take", FPS, noise(55, 3), noise(28), rotation=noise(3), expression=noise(64), face_model="f")


def network(model, settings, folder):
    """(the generator of a model from its ONNX file, its torch module)."""
    torch.manual_seed(0)
    task = gesture_task(model, [speaker()], settings, seed=0)
    module, example, outputs = task.export()
    export_onnx(module, folder / f"{model}.onnx", example, outputs, task.description)
    return resolve(find(model).generator)(folder / f"{model}.onnx", threads=1), module


def frame_loop(module, features, noise):
    """The same sampling with a call for each frame and numpy arrays between them."""
    with torch.inference_mode():
        heard = module.heard(torch.from_numpy(features.T[None].copy()))
        states = torch.zeros(module.settings.flows, 4, 1, module.settings.hidden)
        past, found = np.zeros((1, module.settings.history * noise.shape[1]), np.float32), []
        for frame, z in enumerate(noise):
            condition = torch.cat([torch.from_numpy(past), heard[:, frame]], dim=1)
            x, states = module.flow.inverse_step(torch.from_numpy(z[None]), condition, states, module.inverses)
            x = (x + condition @ module.prediction).numpy()
            past = np.concatenate([past[:, x.shape[1] :], x], axis=1)
            found.append(x[0])
    return np.array(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--hour", type=float, default=3600.0, help="seconds of the long speech")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    budget, rng = read_yaml(BUDGET), np.random.default_rng(0)
    speech = lambda seconds: rng.normal(size=(round(seconds * FPS), 28)).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        for model in ("regression", "lstm", "moglow"):
            generator, module = network(model, budget[model], Path(folder))
            if model == "moglow":
                features = speech(arguments.seconds)
                noise = rng.normal(size=(len(features), 168)).astype(np.float32)
                scan = timed(lambda g=generator, x=features: g.generate(x))[0]
                loop = timed(lambda m=module, x=features, z=noise: frame_loop(m, x, z))[0]
                about = f"moglow, {arguments.seconds:.0f} s"
                print(f"{about}: scan {scan:.2f} s, frame by frame {loop:.2f} s, ratio {loop / scan:.1f}")
            features = speech(arguments.hour)
            took = timed(lambda g=generator, x=features: g.generate(x))[0]
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
            print(f"{model}, {arguments.hour:.0f} s: {took:.1f} s, {peak:.2f} GB at most so far", flush=True)


if __name__ == "__main__":
    main()
