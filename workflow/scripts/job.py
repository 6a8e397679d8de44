"""What surrounds the one library call of every script: threads, the rule's log, and mistakes as one line."""

import os
import sys
import traceback
import warnings
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

from tee import Tee, warnings_to

import __main__

snakemake = __main__.snakemake  # Snakemake puts it into the namespace of the script that it runs
# Before the library is imported, inside `with job():`; Snakemake itself sets the threads of OpenMP and BLAS.
os.environ["NUMBA_NUM_THREADS"] = str(snakemake.threads)


@contextmanager
def job():
    """Run the block with its output in the rule's log; a CospeechError becomes one line and exit status 2."""
    from cospeech.errors import CospeechError, CospeechNotice

    label = " ".join([snakemake.rule, *snakemake.wildcards])
    Path(snakemake.log[0]).parent.mkdir(parents=True, exist_ok=True)
    with open(snakemake.log[0], "w", encoding="utf-8", buffering=1) as log:
        tee = Tee(log, sys.stderr)
        with redirect_stdout(tee), redirect_stderr(tee), warnings.catch_warnings():
            warnings.showwarning = warnings_to(tee, label, CospeechNotice)
            warnings.simplefilter("always", CospeechNotice)
            try:
                yield
            except (CospeechError, KeyboardInterrupt) as error:
                print(f"{label}: error: {str(error) or 'interrupted'}", file=sys.stderr)
                sys.exit(2)
            except Exception:
                log.write(traceback.format_exc())
                raise
