"""Where a run was started, and the files of its configuration before Snakemake merges them."""

import os
import sys
from pathlib import Path

from cospeech.errors import CospeechError
from cospeech.files import read_yaml

DEFAULT = Path("config/config.yaml")


def check_files(workflow):
    """Is there a configuration, and does every file of it keep to `read_yaml`'s limits? Else the run ends.

    A mistake is printed as one line, which also says where there is a configuration, and ends the run with status 2.
    """
    files = [Path(file) for file in (*workflow.overwrite_configfiles, *([DEFAULT] if DEFAULT.is_file() else []))]
    try:
        if not files:
            raise CospeechError(elsewhere(workflow.basedir, "my.yaml"))
        for file in files:
            if file.suffix != ".json":
                read_yaml(os.path.relpath(file) if Path.cwd() in file.parents else file)
    except CospeechError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def elsewhere(home, files):
    """What to do where the default configuration is not found."""
    default = Path(home) / DEFAULT
    return (
        f"{DEFAULT} was not found in {Path.cwd()}; start snakemake in {home}, or give the default here, before what "
        f"differs from it: --configfile {default} {files}"
    )
