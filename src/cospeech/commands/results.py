"""Where a command finds what the workflow made: the configuration's `results_dir`, and the subjects in it."""

from pathlib import Path

from cospeech.commands.schema import check_schema, config_schema, read_mapping
from cospeech.errors import CospeechError

DEFAULT_CONFIG = Path("config/config.yaml")


def configuration(path):
    """The configuration as a dict, from `path` or config/config.yaml; empty if neither is there.

    It is checked by the workflow's schema, but may lack keys, as what is given to `snakemake --configfile` may.
    """
    if path is None and not DEFAULT_CONFIG.is_file():
        return {}
    path = Path(path or DEFAULT_CONFIG)
    config = read_mapping(path)
    check_schema(config, config_schema() | {"required": []}, path)
    return config


def subject_folder(results, subject):
    """Folder of a subject or ensemble that has been trained; CospeechError that lists those there are."""
    trained = sorted(f.parent.name for name in ("split.h5", "corpus.h5") for f in results.glob(f"*/{name}"))
    if subject not in trained:
        known = f"trained there: {', '.join(trained)}" if trained else "run `snakemake --cores 2` first"
        raise CospeechError(f"subject {subject!r}: no results under {results}; {known}")
    return results / subject
