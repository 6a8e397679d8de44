"""Settings of a training: a dataclass whose fields are the keys of a budget file's section.

A field made by `key` also holds what the key means, its unit, what may stand there and what was published. The schema
of budgets, `config/budgets/paper.yaml` and the documents' tables are generated from that (`make config`).
"""

from dataclasses import dataclass, field, fields, is_dataclass, replace

from cospeech.errors import CospeechError

DEFAULT, UNPUBLISHED, LEFT_OUT = (object() for _ in range(3))  # what `published` may be besides a value
# Limits of a key, in the words of JSON Schema.
COUNT, NATURAL = {"minimum": 1}, {"minimum": 0}
POSITIVE, WEIGHT = {"exclusiveMinimum": 0}, {"minimum": 0}
SHARE, DROPOUT = {"minimum": 0, "maximum": 1}, {"minimum": 0, "exclusiveMaximum": 1}
BETAS = {"minItems": 2, "maxItems": 2, "items": {"type": "number"} | DROPOUT}
TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", tuple: "array", dict: "object"}


@dataclass(frozen=True)
class Key:
    """What a field of a `Section` says of itself; see `key`."""

    description: str
    unit: str
    limits: dict
    parts: dict
    published: object


def key(default, description, unit="", limits=None, *, parts=None, published=DEFAULT):
    """A field of a `Section`.

    limits : what may stand there, in the words of JSON Schema without the type; of a dict, for each of its values.
    parts : {entry: what it is}, of a dict.
    published : the value of paper.yaml: the default, another one, or `UNPUBLISHED`: it has the default, which nobody
        published; `LEFT_OUT`: it has none, because something else decides.
    """
    own = {"default_factory": default.copy} if isinstance(default, dict) else {"default": default}
    return field(**own, metadata={"key": Key(description, unit, limits or {}, parts or {}, published)})


def counts(length):
    """Limits of a key that is a list of so many whole numbers above 0."""
    return {"minItems": length, "maxItems": length, "items": {"type": "integer"} | COUNT}


def one_of(*names):
    """Limits of a key that is one of a few names."""
    return {"enum": list(names)}


def some_of(*names, least=0):
    """Limits of a key that is a list of some of a few names, each once."""
    return {"minItems": least, "uniqueItems": True, "items": one_of(*names)}


class Section:
    """Base of settings: `class Settings(Section, section="lstm")`. CospeechError if a value is none of its choices."""

    def __init_subclass__(cls, section):
        cls.section = section

    def __post_init__(self):
        for name, its in keys_of(self).items():
            _check_choice(f"{self.section}.{name}", getattr(self, name), its.limits)


def keys_of(settings):
    """{name: `Key`} of a dataclass or an instance; a field that `key` did not make is no key of a budget."""
    return {f.name: f.metadata["key"] for f in fields(settings) if "key" in f.metadata}


def settings_of(defaults, mapping, section):
    """`defaults` (a dataclass instance) with the values of `mapping`; an unknown key or a wrong type is one clear line.

    Dicts are merged, lists become tuples where the default is one.
    """
    if not is_dataclass(defaults):
        raise TypeError("defaults must be a dataclass instance")
    known, its = {f.name: getattr(defaults, f.name) for f in fields(defaults)}, keys_of(defaults)
    changes = {}
    for name, value in mapping.items():
        if name not in known:
            raise CospeechError(f"budget: unknown key '{section}.{name}'; known: {', '.join(known)}")
        changes[name] = _converted(f"{section}.{name}", value, known[name])
        if name in its:
            _check_choice(f"{section}.{name}", changes[name], its[name].limits)
    return replace(defaults, **changes)


def _check_choice(where, value, limits):
    if value not in limits.get("enum", [value]):
        raise CospeechError(f"budget: {where} is {value!r}; known: {', '.join(limits['enum'])}")
    choices = limits.get("items", {}).get("enum")
    if choices is None:
        return
    if len(value) < limits["minItems"]:
        raise CospeechError(f"budget: {where} is {value!r}; some of {', '.join(choices)}")
    for name in value:
        if name not in choices:
            raise CospeechError(f"budget: {where}: {name!r} is not known; known: {', '.join(choices)}")


def _converted(where, value, default):
    if isinstance(default, bool) or isinstance(value, bool):
        right = isinstance(default, bool) and isinstance(value, bool)
    elif isinstance(default, float):
        right, value = isinstance(value, (int, float)), float(value) if isinstance(value, int) else value
    elif isinstance(default, tuple):
        right, value = isinstance(value, (list, tuple)), tuple(value) if isinstance(value, list) else value
    elif isinstance(default, dict):
        right = isinstance(value, dict) and not set(value) - set(default)
        value = {**default, **value} if right else value
    else:
        right = isinstance(value, type(default))
    if not right:
        raise CospeechError(f"budget: {where} is {value!r}, expected something like {default!r}")
    return value


# ---- what is generated from the keys ---------------------------------------------------------------------------------


def described(its):
    """What a `Key` means, with its unit, in one line."""
    return its.description + (f" ({its.unit})" if its.unit else "")


def schema_of(settings):
    """The JSON Schema of a budget's section, from its dataclass."""
    its, types = keys_of(settings), {f.name: f.type for f in fields(settings)}
    return _object({name: _schema(getattr(settings, name, None), types[name], its[name]) for name in its})


def _schema(default, kind, its):
    about = {"description": described(its)}
    if kind is not dict:
        return about | ({} if "enum" in its.limits else {"type": TYPES[kind]}) | its.limits
    parts = {name: {"description": its.parts[name], "type": TYPES[type(value)]} for name, value in default.items()}
    return about | _object({name: part | its.limits for name, part in parts.items()})


def _object(properties):
    return {"type": "object", "additionalProperties": False, "properties": properties}


def published(settings):
    """{key: its value in paper.yaml} of a dataclass instance; without those that something else decides."""
    values = {name: (getattr(settings, name), its.published) for name, its in keys_of(settings).items()}
    chosen = {n: own if other in (DEFAULT, UNPUBLISHED) else other for n, (own, other) in values.items()}
    return {name: value for name, value in chosen.items() if value is not LEFT_OUT}
