"""`cospeech generate`: speech in, gestures of a trained subject out."""

import argparse
from pathlib import Path

from cospeech.commands.results import configuration, subject_folder
from cospeech.errors import CospeechError


def add(commands):
    """Register the command."""
    generate = commands.add_parser(
        "generate", help="speech in, gestures out", description=_generate.__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )  # fmt: skip
    option = generate.add_argument
    option("--subject", required=True, metavar="NAME", help="whose gestures: a subject that the workflow has trained")
    option("--model", required=True, metavar="MODEL", help="regression, gesture_gan, knn or resync")
    option("--audio", required=True, metavar="FILE", help="speech: any sound file, or a film with sound")
    option("--out", required=True, metavar="FILE", help="file to write: .bvh .glb .csv .h5 or .mp4")
    option("--config", metavar="FILE", help="configuration that names results_dir and fps")
    option("--seed", type=int, default=0, help="start of all random choices")
    option("--k", type=int, help="knn, resync: take the k-th best match (default: 1, the best)")
    option(
        "--initial", choices=["mean", "random"], help="knn, resync: the pose before the first frame (default: random)"
    )
    option("--control", action="append", metavar="CONTROL", help="knn, resync: how the hands shall move, and when: "
        "'left_wrist_height=high@2.0-5.5', 'strict symmetry=<0.05', 'left_wrist_speed=fast and not reach=low@3-6'; "
        "several hold together")  # fmt: skip
    option("--list-controls", action=_ListControls, help="list what can be controlled, and exit")
    option("--explain", action="store_true", help="knn, resync: tell where every window of 8 frames is from, and why")
    option("--smoothing", type=float, metavar="FRAMES", help="sigma of the Gaussian over time (default: as published)")
    option("--threads", type=int, help="CPU threads for the networks (default: all)")
    generate.set_defaults(run=_generate)


class _ListControls(argparse.Action):
    """Prints the control signals and exits, whatever else is asked, as --help does."""

    def __init__(self, option_strings, dest, help):
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser, *_):
        from cospeech.matching.controls import listing

        print(listing())
        parser.exit()


def _generate(options):
    """Generate motion for a speech with a trained model, and write it in the format that the suffix of --out names."""
    from cospeech.files import sha256
    from cospeech.speech import find_words, load_audio
    from cospeech.synthesis import check_model, load_generator, synthesize

    check_model(options.model)
    chosen = _search_options(options)
    _check_suffix(options.out)
    config = configuration(options.config)
    folder = subject_folder(Path(config.get("results_dir", "results")), options.subject)
    samples, rate = load_audio(options.audio)
    generator = load_generator(options.model, folder, options.threads)
    matches = []
    if options.explain:
        chosen["report"] = matches.append
    clip = synthesize(
        generator, samples, rate, subject=options.subject, clip=Path(options.audio).stem, model=options.model,
        fps=float(config.get("fps", 15)), seed=options.seed, words=find_words(options.audio),
        smoothing=options.smoothing, audio=str(Path(options.audio).resolve()), source=Path(options.audio).name,
        source_sha256=sha256(options.audio), **chosen,
    )  # fmt: skip
    _write(clip, options.out, samples, rate)
    print(f"{options.out}: {clip.frames} frames, {clip.duration:.2f} s at {clip.fps:g} fps")
    for match in matches:
        from cospeech.matching.controls import explain

        print(explain(match))


def _search_options(options):
    """What is asked of the k-NN search, for the generators that have one."""
    asked = {name: getattr(options, name) for name in ("k", "initial", "control")}
    asked = {name: value for name, value in asked.items() if value is not None}
    named = [*asked, *(["explain"] if options.explain else [])]
    if named and options.model not in ("knn", "resync"):
        raise CospeechError(f"--{named[0]} is about matches, which {options.model} has none of; use knn or resync")
    if "control" in asked:
        from cospeech.matching.controls import Control

        asked["controls"] = [Control.parse(text) for text in asked.pop("control")]
    return asked


def _write(clip, out, samples, rate):
    if Path(out).suffix.lower() == ".mp4":
        from cospeech.render.video import render_video

        render_video(out, [(f"{clip.subject} · {clip.generator}", clip)], audio=(samples, rate))
    else:
        from cospeech.formats.export import export_clip

        export_clip(clip, out)


def _check_suffix(out):
    known = (".bvh", ".glb", ".csv", ".h5", ".mp4")
    if Path(out).suffix.lower() not in known:
        raise CospeechError(f"{out}: unknown suffix {Path(out).suffix!r}; choose one of {' '.join(known)}")
