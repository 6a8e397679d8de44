"""Settings against their JSON Schema, with one line for the worst mistake: the workflow's check and the commands'."""

import difflib
import reprlib
from importlib.resources import files

from cospeech.errors import CospeechError
from cospeech.files import read_yaml

NAME = "is no name; use letters, digits, _ and -"
SHORT = reprlib.Repr()  # of a wrong value, as much as a line holds
SHORT.maxstring = SHORT.maxother = 60
KINDS = {
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "array": "a list",
    "object": "keys and values",
}


def read_mapping(path):
    """The mapping in a YAML file."""
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise CospeechError(f"{path}: expected keys and values, found {type(content).__name__}")
    return content


def config_schema():
    """The configuration's schema (a link to the workflow's); where it lists models they are those of the library."""
    from cospeech.gestures.generator import named

    schema = read_mapping(files("cospeech.commands") / "config.schema.yaml")
    chosen = [model for model in named(learns="speaker") if model != "mean_pose"]  # that is a row of every table
    schema["properties"]["models"]["items"] = {"enum": chosen}
    schema["properties"]["ensemble"]["properties"]["models"]["items"] = {"enum": named(learns="speakers")}
    for option in schema["properties"]["synthesis"]["items"]["dependentSchemas"].values():
        option["properties"]["model"] = {"enum": named(needs="database")}
    return schema


def check_schema(content, schema, where):
    """CospeechError `where: key: what is wrong; the remedy` on the worst mistake, unless `content` fits a JSON Schema.

    content, schema : dicts, as `read_mapping` gives them. where : the file's name, for the message.
    """
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    error = best_match(Draft202012Validator(schema).iter_errors(content))
    if error:
        raise CospeechError(f"{where}: {_line(error)}")


def _line(error):
    """A validation error as 'key: what is wrong; the remedy'."""
    key = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in error.absolute_path).lstrip(".")
    prefix = f"{key}: " if key else ""
    if error.validator == "additionalProperties":
        known = list(error.schema["properties"])
        unknown = next(name for name in error.instance if name not in known)
        close = difflib.get_close_matches(str(unknown), known, 1)
        remedy = f"did you mean {close[0]!r}?" if close else f"known: {', '.join(known)}"
        return f"{prefix}unknown key {unknown!r}; {remedy}"
    if error.validator == "required":
        missing = next(name for name in error.validator_value if name not in error.instance)
        return f"{prefix}key {missing!r} is missing"
    if error.validator == "enum":
        return f"{prefix}{SHORT.repr(error.instance)} is not one of {', '.join(map(str, error.validator_value))}"
    if error.validator == "pattern":
        return f"{prefix}{error.instance!r} {error.schema.get('description', NAME)}"
    if error.validator == "minItems":
        return f"{prefix}the list is empty; give at least one"
    if error.validator == "type":
        return f"{prefix}{_of_another_type(error.instance, error.validator_value)}"
    return f"{prefix}{error.message if len(error.message) < 300 else f'{SHORT.repr(error.instance)} does not fit'}"


def _of_another_type(value, wanted):
    """What to write where YAML gives a value of another type than was meant."""
    found = f"{SHORT.repr(value)} is not {KINDS.get(wanted, wanted)}"
    if wanted == "string" and isinstance(value, bool):
        return f"{found}: YAML reads yes, no, on and off without quotes as true and false; put it in quotes"
    if wanted == "string" and isinstance(value, (int, float)):
        return f"{found}; put it in quotes: '{value}'"
    if wanted in ("number", "integer") and isinstance(value, str):
        return f"{found}; write digits without quotes, times in seconds"
    return found
