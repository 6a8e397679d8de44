"""`cospeech study build` and `analyse`: a study that opens from disk, and what its participants answered."""

from pathlib import Path

from cospeech.errors import CospeechError


def add(commands):
    """Register the commands."""
    study = commands.add_parser(
        "study", help="let people judge: build a study, analyse its answers", description=__doc__.splitlines()[0]
    )
    parts = study.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_build(parts.add_parser("build", help="write a study's folder", description=_build.__doc__))
    analyse = parts.add_parser("analyse", help="tables and plots of answers", description=_analyse.__doc__)
    analyse.add_argument("study", metavar="STUDY_FOLDER", help="folder of `cospeech study build`")
    analyse.add_argument("answers", nargs="+", metavar="ANSWERS", help="files that came back (.json), or their folder")
    analyse.add_argument("--out", metavar="FOLDER", help="where results go (default: STUDY_FOLDER_results)")
    analyse.add_argument(
        "--failures", type=int, default=0, metavar="N", help="attention checks that may be failed (default: 0)"
    )
    analyse.add_argument("--seed", type=int, default=0, help="of the bootstrap (default: 0)")
    analyse.set_defaults(run=_analyse)


def _add_build(build):
    build.add_argument("--out", required=True, metavar="FOLDER", help="folder to write, new or empty")
    build.add_argument(
        "--like",
        choices=["4.1", "4.2", "5.2", "5.4"],
        metavar="TABLE",
        help="as the study of this table of the thesis: 4.1, 4.2, 5.2 or 5.4",
    )
    build.add_argument("--manifest", metavar="FILE", help="a list of clips of your own (.yaml), instead of results")
    build.add_argument("--subjects", nargs="+", metavar="NAME", help="whose test takes (default: the config's)")
    build.add_argument(
        "--methods",
        nargs="+",
        metavar="NAME",
        help="what is judged (default: ground_truth, mismatched and the config's models)",
    )
    build.add_argument("--seconds", type=float, help="length of a clip (default: 12)")
    build.add_argument("--excerpts", type=int, metavar="N", help="tracks of each subject (default: 6)")
    build.add_argument(
        "--face", help="whose face all methods wear: a method's name, or own, or none (default: ground_truth)"
    )
    build.add_argument("--pairs", action="store_true", help="pairwise preference instead of ratings")
    build.add_argument("--ties", action="store_true", default=None, help="pairs: allow `no difference`")
    build.add_argument("--points", type=int, choices=[5, 7], help="of the scale (default: 5)")
    build.add_argument(
        "--tracks", type=int, metavar="N", help="tracks that a participant gets (default: 3; of pairs 1)"
    )
    build.add_argument("--checks", type=int, metavar="N", help="attention checks (default: one for every ten clips)")
    build.add_argument("--examples", type=int, metavar="N", help="clips of the truth shown first (default: 0)")
    build.add_argument("--title", help="of the page")
    build.add_argument("--seed", type=int, help="of the order for each participant (default: the config's)")
    build.add_argument("--config", metavar="FILE", help="configuration (default: config/config.yaml)")
    build.set_defaults(run=_build)


def _build(options):
    """Write a folder whose index.html asks people to judge methods, opens from disk and gives their answers back."""
    from cospeech.commands.results import configuration
    from cospeech.study.build import build_study, settle
    from cospeech.study.stimuli import from_manifest, from_results

    config = configuration(options.config)
    names = ("seconds", "excerpts", "face", "points", "tracks", "checks", "examples", "ties", "title", "seed")
    asked = {name: getattr(options, name) for name in names} | {"kind": "pairs" if options.pairs else None}
    told = {"seed": config.get("seed", 0)} | (config.get("study") or {})
    asked = told | {name: value for name, value in asked.items() if value is not None}
    like = asked.pop("like", None) if options.like is None else options.like
    asked.pop("like", None)
    if options.manifest:
        stimuli, texts = from_manifest(options.manifest, settle(asked, like)[0]["seconds"])
        asked = texts | asked
    else:
        stimuli = from_results(*_sources(options, config), **settle(asked, like)[0])
    study = build_study(options.out, stimuli, settle(asked, like)[1])
    print(
        f"{options.out}: study {study['id']}, {len(study['stimuli'])} clips, {study['items']} judgements and "
        f"{study['checks']} attention checks a participant, about {study['minutes']:g} minutes"
    )


def _sources(options, config):
    """Results, subjects and methods that are asked for, or else those of the configuration."""
    from cospeech.commands.results import subject_folder
    from cospeech.study.stimuli import MISMATCHED, TRUTH

    results = Path(config.get("results_dir", "results"))
    subjects = options.subjects or [Path(name).stem for name in config.get("subjects", [])]
    if not subjects:
        raise CospeechError("study: no subject; give --subjects")
    for subject in subjects:
        subject_folder(results, subject)
    return results, subjects, options.methods or [TRUTH, MISMATCHED, *config.get("models", [])]


def _analyse(options):
    """Tables, plots and a page of what participants answered; whoever cannot be counted is listed with the reason."""
    from cospeech.study.analyse import analyse, write_results

    folder = Path(options.study).resolve()
    out = Path(options.out or folder.with_name(f"{folder.name}_results"))
    results = analyse(options.study, options.answers, options.failures, options.seed)
    write_results(out, results)
    print(f"{out / 'results.html'}: {len(results.participants)} participants, {len(results.left)} left out")
