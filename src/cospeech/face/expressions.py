"""Face models by name: what each expression coefficient means, one table each (`coefficients/*.yaml`)."""

from importlib.resources import files

from cospeech.files import read_yaml


def expression_names(model):
    """Names of the E expression coefficients of a face model, or None when the model has no table here."""
    table = files("cospeech.face") / "coefficients" / f"{model}.yaml"
    return tuple(read_yaml(table)["expressions"]) if model and table.is_file() else None


COSPEECH64 = expression_names("cospeech64")
LANDMARKS = 68  # iBUG 300-W
LIPS = slice(48, 68)  # of them
