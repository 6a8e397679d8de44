"""The `cospeech` command: what a person does by hand once models are trained.

It reads the configuration only for where results lie and at which rate the subjects were made; everything else is the
library's functions with plain arguments.
"""

import argparse
import sys
import warnings
from pathlib import Path

from cospeech import __version__
from cospeech.errors import CospeechError, CospeechNotice

DEFAULT_CONFIG = Path("config/config.yaml")
EXAMPLES = """examples:
  cospeech generate --subject calm --model resync --audio talk.wav --out talk.bvh
  cospeech generate --subject calm --model knn --k 3 --initial random --seed 7 --audio talk.wav --out talk.mp4
  cospeech generate --subject calm --model knn --control left_wrist_height=high@2.0-5.5 --audio talk.wav --out talk.bvh
  cospeech export results/calm/synthesis/resync/take05.h5 take05.glb
  cospeech render results/calm/clips/take05.h5 truth.mp4
  cospeech info results/calm/database.h5
"""


def main(arguments=None):
    """Entry point; returns the exit status: 0, or 2 after one line on a user's mistake."""
    warnings.showwarning = _show_warning
    warnings.simplefilter("always", CospeechNotice)
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
    except CospeechError as error:
        print(f"cospeech: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("cospeech: interrupted; nothing half-written was left", file=sys.stderr)
        return 130
    return 0


def _show_warning(message, category, *_):
    if issubclass(category, CospeechNotice):
        print(f"cospeech: note: {message}", file=sys.stderr)


def _parser():
    parser = argparse.ArgumentParser(
        "cospeech", description=__doc__.splitlines()[0], epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"cospeech {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_generate(commands)
    export = commands.add_parser("export", help="turn a clip into BVH, GLB or CSV", description=_export.__doc__)
    export.add_argument("clip", help="a clip file (.h5), real or generated")
    export.add_argument("out", help="file to write; its suffix chooses the format: .bvh .glb .csv .h5")
    export.set_defaults(run=_export)
    render = commands.add_parser("render", help="draw a clip as a film with sound", description=_render.__doc__)
    render.add_argument("clips", nargs="+", metavar="clip", help="clip files (.h5), drawn side by side")
    render.add_argument("out", help="film to write (.mp4)")
    render.add_argument("--audio", help="sound of the film (default: the first clip's own)")
    render.set_defaults(run=_render)
    info = commands.add_parser("info", help="say what a file of this project holds", description=_info.__doc__)
    info.add_argument("file", help="any .h5 or .safetensors file of this project")
    info.set_defaults(run=_info)
    return parser


def _add_generate(commands):
    generate = commands.add_parser(
        "generate", help="speech in, gestures out", description=_generate.__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )  # fmt: skip
    add = generate.add_argument
    add("--subject", required=True, metavar="NAME", help="whose gestures: a subject that the workflow has trained")
    add("--model", required=True, metavar="MODEL", help="regression, gesture_gan, knn or resync")
    add("--audio", required=True, metavar="FILE", help="speech: any sound file, or a film with sound")
    add("--out", required=True, metavar="FILE", help="file to write: .bvh .glb .csv .h5 or .mp4")
    add("--config", metavar="FILE", help="configuration that names results_dir and fps")
    add("--seed", type=int, default=0, help="start of all random choices")
    add("--k", type=int, help="knn, resync: take the k-th best match (default: 1, the best)")
    add("--initial", choices=["mean", "random"], help="knn, resync: the pose before the first frame (default: random)")
    add("--control", action="append", metavar="CONTROL", help="knn, resync: how the hands shall move, and when: "
        "'left_wrist_height=high@2.0-5.5', 'strict symmetry=<0.05', 'left_wrist_speed=fast and not reach=low@3-6'; "
        "several hold together")  # fmt: skip
    add("--list-controls", action=_ListControls, help="list what can be controlled, and exit")
    add("--explain", action="store_true", help="knn, resync: tell where every window of 8 frames is from, and why")
    add("--smoothing", type=float, metavar="FRAMES", help="sigma of the Gaussian over time (default: as published)")
    add("--threads", type=int, help="CPU threads for the networks (default: all)")
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
    config = _configuration(options.config)
    folder = _subject_folder(Path(config.get("results_dir", "results")), options.subject)
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


def _configuration(path):
    import yaml

    if path is None and not DEFAULT_CONFIG.is_file():
        return {}
    path = Path(path or DEFAULT_CONFIG)
    try:
        config = yaml.safe_load(path.read_text())
    except OSError as error:
        raise CospeechError(f"{path}: cannot be read ({error.strerror})") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise CospeechError(f"{path}: not valid YAML ({' '.join(str(error).split())})") from error
    if not isinstance(config, dict):
        raise CospeechError(f"{path}: expected keys and values, found {type(config).__name__}")
    return config


def _subject_folder(results, subject):
    trained = sorted(f.parent.name for f in results.glob("*/split.h5"))
    if subject not in trained:
        known = f"trained there: {', '.join(trained)}" if trained else "run `snakemake --cores 2` first"
        raise CospeechError(f"subject {subject!r}: no results under {results}; {known}")
    return results / subject


def _export(options):
    """Turn a clip file into an animation (.bvh, .glb), a table (.csv) or a copy (.h5)."""
    from cospeech.clip import Clip
    from cospeech.formats.export import export_clip

    export_clip(Clip.read(options.clip), options.out)


def _render(options):
    """Draw one or several clips side by side as an mp4 with sound."""
    from cospeech.clip import Clip
    from cospeech.render.video import render_video

    clips = [Clip.read(path) for path in options.clips]
    sound = options.audio
    if not sound and clips[0].audio:
        own = Path(options.clips[0]).parent / clips[0].audio
        sound = str(own) if own.is_file() else None
    panels = [(f"{clip.subject} · {clip.generator or 'recorded'}", clip) for clip in clips]
    render_video(options.out, panels, audio=sound)


def _info(options):
    """Print what a file holds: its schema, attributes, arrays and, for weights, what they were trained as."""
    from cospeech.describe import describe

    print(describe(options.file))


if __name__ == "__main__":
    sys.exit(main())
