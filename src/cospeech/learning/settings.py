"""Settings of a training: a dataclass whose fields are the keys of a budget file's section."""

from dataclasses import fields, is_dataclass, replace

from cospeech.errors import CospeechError


def settings_of(defaults, mapping, section):
    """`defaults` (a dataclass instance) with the values of `mapping`; an unknown key or a wrong type is one clear line.

    Dicts are merged, lists become tuples where the default is one.
    """
    if not is_dataclass(defaults):
        raise TypeError("defaults must be a dataclass instance")
    known = {f.name: getattr(defaults, f.name) for f in fields(defaults)}
    changes = {}
    for key, value in mapping.items():
        if key not in known:
            raise CospeechError(f"budget: unknown key '{section}.{key}'; known: {', '.join(known)}")
        changes[key] = _converted(f"{section}.{key}", value, known[key])
    return replace(defaults, **changes)


def _converted(key, value, default):
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
        raise CospeechError(f"budget: {key} is {value!r}, expected something like {default!r}")
    return value
