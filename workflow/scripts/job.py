"""What surrounds the one library call of every script: threads, the rule's log, and mistakes as one line.

The library is imported inside `with job():`, after the number of threads is set.
"""

import os
import sys
import traceback
import warnings
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import __main__

snakemake = __main__.snakemake  # Snakemake puts it into the namespace of the script that it runs
os.environ["NUMBA_NUM_THREADS"] = str(snakemake.threads)  # Snakemake itself sets those of OpenMP and BLAS


class Tee:
    """Text goes to log and terminal, but progress bars (they start with a carriage return) only to a terminal."""

    def __init__(self, log, terminal):
        self.log, self.terminal = log, terminal

    def write(self, text):
        progress = text.startswith("\r")
        if not progress:
            self.log.write(text)
        if not progress or self.terminal.isatty():
            self.terminal.write(text)
        return len(text)

    def flush(self):
        self.log.flush()
        self.terminal.flush()

    def isatty(self):
        return self.terminal.isatty()


@contextmanager
def job():
    """Run the block with its output in the rule's log; a CospeechError becomes one line and exit status 2."""
    from cospeech.errors import CospeechError, CospeechNotice

    label = " ".join([snakemake.rule, *snakemake.wildcards])

    def show(message, category, filename, line, *_):
        if issubclass(category, CospeechNotice):
            print(f"{label}: note: {message}", file=sys.stderr)
        else:
            log.write(warnings.formatwarning(message, category, filename, line))

    Path(snakemake.log[0]).parent.mkdir(parents=True, exist_ok=True)
    with open(snakemake.log[0], "w", encoding="utf-8", buffering=1) as log:
        tee = Tee(log, sys.stderr)
        with redirect_stdout(tee), redirect_stderr(tee), warnings.catch_warnings():
            warnings.showwarning = show
            warnings.simplefilter("always", CospeechNotice)
            try:
                yield
            except CospeechError as error:
                print(f"{label}: error: {error}", file=sys.stderr)
                sys.exit(2)
            except KeyboardInterrupt:
                print(f"{label}: interrupted", file=sys.stderr)
                sys.exit(130)
            except Exception:
                log.write(traceback.format_exc())
                raise
