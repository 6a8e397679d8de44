"""The commands of `cospeech`, a file a group; each has `add(commands)`, which registers its parsers."""
