"""`cospeech generate` with a network of many speakers: `--subject` is the ensemble, `--style` whose manner it takes."""

from pathlib import Path

from cospeech.commands.results import configuration
from cospeech.errors import CospeechError


def ensemble_folder(options):
    """The folder of the ensemble that --subject names, or None where it names no ensemble."""
    results = Path(configuration(options.config).get("results_dir", "results"))
    return results / options.subject if (results / options.subject / "corpus.h5").is_file() else None


def generate_shared(options, folder, write):
    """Generate motion for a speech with a network of `folder`; `write(clip, samples, rate)` writes the file."""
    from cospeech.files import sha256
    from cospeech.gestures.ha2g.long_speech import SharedGenerator
    from cospeech.speech import load_audio, words_of_speech
    from cospeech.synthesis import synthesize

    matching = ("k", "placement", "control", "keyword", "gestures", "seams")
    asked = [name for name in matching if getattr(options, name) is not None] + ["explain"] * options.explain
    if asked:
        raise CospeechError(f"--{asked[0]} is about matches, which {options.model} has none of; use knn or resync")
    network = _network(folder, options.model)
    generator = SharedGenerator(network / "model.onnx", options.threads)
    samples, rate = load_audio(options.audio)
    words = None
    if "words" in generator.inputs:
        words = words_of_speech(options.audio, samples, rate, options.words, options.recognize)
    clip = synthesize(
        generator.hearing(samples, rate, words), samples, rate, subject=options.subject, clip=Path(options.audio).stem,
        model=network.name, seed=options.seed, words=words, smoothing=options.smoothing or 0.0,
        audio=str(Path(options.audio).resolve()), source=Path(options.audio).name, source_sha256=sha256(options.audio),
        replace=options.replace, style=options.style, initial=options.initial or "random",
    )  # fmt: skip
    write(clip, options.out, samples, rate)
    print(f"{options.out}: {clip.frames} frames, {clip.duration:.2f} s at {clip.fps:g} fps")


def _network(folder, model):
    """The folder of a network by its name, `ha2g_1`, or by its row alone, `ha2g`, which is that of the first seed."""
    trained = sorted(file.parent for file in folder.glob("models/*/model.onnx"))
    for network in trained:
        if model in (network.name, network.name.rpartition("_")[0]):
            return network
    known = ", ".join(network.name for network in trained) or "none; run snakemake with config/ha2g.yaml first"
    raise CospeechError(f"model {model!r}: not trained for {folder.name}; trained there: {known}")
