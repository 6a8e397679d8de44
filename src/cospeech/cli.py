"""The `cospeech` command: what a person does by hand once models are trained.

It reads the configuration only for where results lie and at which rate the subjects were made; everything else is the
library's functions with plain arguments.
"""

import argparse
import os
import sys
import warnings

from cospeech import __version__
from cospeech.commands import capture, clip_files, database, generate, player, posenet, study
from cospeech.errors import CospeechError, CospeechNotice

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
        sys.stdout.flush()
    except BrokenPipeError:  # `| head` has read what it wanted; nothing more is written, at exit either
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
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
        "cospeech",
        description=__doc__.splitlines()[0],
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"cospeech {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for group in (generate, capture, posenet, database, clip_files, player, study):
        group.add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
