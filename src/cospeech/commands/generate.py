"""`cospeech generate`: speech in, gestures of a trained subject out."""

import argparse
from pathlib import Path

from cospeech.commands.results import configuration, subject_folder
from cospeech.errors import CospeechError
from cospeech.gestures.generator import MODELS, find


def add(commands):
    """Register the command."""
    generate = commands.add_parser(
        "generate",
        help="speech in, gestures out",
        description=_generate.__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    option = generate.add_argument
    option("--subject", metavar="NAME", help="whose gestures: a subject that the workflow has trained")
    option("--model", metavar="MODEL", help=f"{', '.join(MODELS)} (docs/models.md)")
    option("--audio", metavar="FILE", help="speech: any sound file, or a film with sound")
    option("--out", metavar="FILE", help="file to write: .bvh .glb .csv .h5 or .mp4")
    option("--config", metavar="FILE", help="configuration that names results_dir and fps")
    option("--seed", type=int, default=0, help="start of all random choices")
    option("--k", type=int, help="knn, resync: take the k-th best match (default: 1, the best)")
    option(
        "--initial", choices=["mean", "random"], help="knn, resync: the pose before the first frame (default: random)"
    )
    option(
        "--placement",
        choices=["published", "continued", "any_frame", "any_frame_continued"],
        help="knn, resync: where in the database a window may start (default: any_frame_continued; docs/matching.md)",
    )
    option(
        "--control",
        action="append",
        metavar="CONTROL",
        help="knn, resync: how the hands shall move, and when: "
        "'left_wrist_height=high@2.0-5.5', 'strict symmetry=<0.05', 'left_wrist_speed=fast and not reach=low@3-6'; "
        "several hold together",
    )
    option(
        "--keyword",
        action="append",
        metavar="WORD=GESTURE",
        help="knn, resync: where WORD is spoken, the gesture "
        "of that tag, as in huge=wide: an entry of --gestures, or else a word of the training takes",
    )
    option("--gestures", metavar="FILE", help="knn, resync: YAML file of gestures for --keyword (docs/control.md)")
    option("--words", metavar="FILE", help="word times of the speech (default: the .tsv, .TextGrid... beside it)")
    option("--recognize", action="store_true", help="recognise the words of the speech where no file tells them")
    option(
        "--seams",
        choices=["off", "blend", "inertialize"],
        help="knn, resync: what happens where one window of 8 "
        "frames follows another (default: inertialize; published: off)",
    )
    option(
        "--audio-rank",
        choices=["plain", "learned"],
        help="knn, resync: rank matches by how alike the speech "
        "sounds, as published, or by what fits the motion (default: learned, where it was trained)",
    )
    option(
        "--replace",
        action="append",
        default=[],
        metavar="FRAMES",
        help="take frames from a clip file at last: "
        "'3.0-4.5=other.h5@10.2', these seconds from its second 10.2 on; without @ where it joins best",
    )
    option(
        "--list-controls",
        action="store_true",
        help="list what can be controlled, with the thresholds of --subject if given, and exit",
    )
    option("--explain", action="store_true", help="knn, resync: tell where every window of 8 frames is from, and why")
    option(
        "--style",
        metavar="SPEAKERS",
        help="ha2g and others of many speakers, whose ensemble is the --subject: "
        "calm or calm=0.7,lively=0.3 or a file of reference frames or random (default: everyone's manner)",
    )
    option("--smoothing", type=float, metavar="FRAMES", help="sigma of the Gaussian over time (default: as published)")
    option("--threads", type=int, help="CPU threads for the networks (default: all)")
    generate.set_defaults(run=_run)


def _run(options):
    if options.list_controls:
        _list_controls(options)
    else:
        _generate(options)


def _list_controls(options):
    from cospeech.matching.explain import listing

    signals = None
    if options.subject:
        from cospeech.matching import Database
        from cospeech.matching.control.signals import ControlSignals

        folder, _ = _results(options)
        signals = ControlSignals(Database.load(folder / "database.h5"))
    print(listing(signals))


def _results(options):
    """The subject's folder, and the frame rate of its motion."""
    config = configuration(options.config)
    folder = subject_folder(Path(config.get("results_dir", "results")), options.subject)
    return folder, float(config.get("fps", 15))


def _generate(options):
    """Generate motion for a speech with a trained model, and write it in the format that the suffix of --out names."""
    from cospeech.gestures.generator import Speech
    from cospeech.synthesis import load, synthesize

    for name in ("subject", "model", "audio", "out"):
        if getattr(options, name) is None:
            raise CospeechError(f"--{name} is missing; `cospeech generate --help` tells what it is")
    chosen = _asked(options, find(options.model))
    _check_suffix(options.out)
    folder, fps = _results(options)
    rank = {"audio_rank": chosen.pop("audio_rank", None)}
    generator = load(options.model, folder, options.threads, **rank)
    speech = Speech.load(options.audio, fps, options.words, options.recognize)
    clip = synthesize(
        generator,
        speech,
        subject=options.subject,
        clip=Path(options.audio).stem,
        model=options.model,
        seed=options.seed,
        smoothing=options.smoothing,
        audio=str(Path(options.audio).resolve()),
        replace=options.replace,
        **chosen,
    )
    _write(clip, options.out, speech)
    print(f"{options.out}: {clip.frames} frames, {clip.duration:.2f} s at {clip.fps:g} fps")
    if options.explain:
        from cospeech.matching.explain import explain

        print(explain(clip.trace, clip.fps))


def _asked(options, model):
    """What is asked of the generator; CospeechError for what it does not know."""
    from cospeech.gestures.generator import MATCHING

    given = {name: getattr(options, name) for name in (*MATCHING, "style")}
    asked = {name: value for name, value in given.items() if value is not None and value is not False}
    for name in asked:
        if name == "style" and name not in model.options:
            raise CospeechError(f"--style mixes the speakers of an ensemble, and {options.subject!r} is none")
        if name not in model.options:
            dashed = name.replace("_", "-")
            raise CospeechError(f"--{dashed} is about matches, which {options.model} has none of; use knn or resync")
    if "gestures" in asked and "keyword" not in asked:
        raise CospeechError("--gestures has gestures for --keyword; name one, as in --keyword huge=wide")
    asked.pop("explain", None)
    controls, keywords = asked.pop("control", []), asked.pop("keyword", [])
    if controls or keywords:
        from cospeech.matching.control.controls import Control
        from cospeech.matching.control.keywords import Keyword

        asked["controls"] = [*map(Control.parse, controls), *map(Keyword.parse, keywords)]
    return asked


def _write(clip, out, speech):
    if Path(out).suffix.lower() == ".mp4":
        from cospeech.render.video import render_video

        render_video(out, [(f"{clip.subject} · {clip.generator}", clip)], audio=(speech.samples, speech.rate))
    else:
        from cospeech.formats.export import export_clip

        export_clip(clip, out)


def _check_suffix(out):
    known = (".bvh", ".glb", ".csv", ".h5", ".mp4")
    if Path(out).suffix.lower() not in known:
        raise CospeechError(f"{out}: unknown suffix {Path(out).suffix!r}; choose one of {' '.join(known)}")
