"""Word vectors from the files that people have: fastText's .vec and .bin, and GloVe's .txt.

Files hold millions of words, a training knows hundreds: text files are read line by line and only wanted lines parsed;
a .bin is mapped, and only the rows that make up wanted words are touched.
"""

import mmap
import struct
from pathlib import Path

import numpy as np

from cospeech.errors import CospeechError
from cospeech.gestures.ha2g.dataset.vocabulary import DIMENSIONS

MAGIC = 793712314  # of fastText's binary files
PACKED = {b"\x1f\x8b": "gzip", b"PK": "zip"}


def read_embeddings(path, wanted, dimensions=DIMENSIONS):
    """{word: (dimensions,) float32} of the `wanted` words that the file has.

    Text: one word and its numbers per line, UTF-8, with or without fastText's first line of counts. A .bin makes up
    every word from its parts, known or not. CospeechError of other files and other dimensions.
    """
    path = Path(path)
    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    with open(path, "rb") as file:
        head = file.read(4)
    packed = next((kind for mark, kind in PACKED.items() if head.startswith(mark)), None)
    if packed:
        raise CospeechError(f"{path}: is a {packed} file; unpack it first")
    if head == struct.pack("<i", MAGIC):
        return _read_binary(path, wanted, dimensions)
    return _read_text(path, wanted, dimensions)


def _read_text(path, wanted, dimensions):
    keys, found = {word.encode(): word for word in wanted}, {}
    with open(path, "rb") as file:
        for number, line in enumerate(file, 1):
            word, _, rest = line.rstrip().partition(b" ")
            if number == 1:
                fields = len(rest.split())
                if fields != 1:  # GloVe: no line of counts
                    _check_dimensions(path, fields, dimensions)
                elif word.isdigit() and rest.isdigit():
                    _check_dimensions(path, int(rest), dimensions)
                    continue
                else:
                    raise CospeechError(f"{path}: line 1: expected a word and {dimensions} numbers between spaces")
            if word in keys:
                found[keys[word]] = _numbers(path, number, rest, dimensions)
    return found


def _numbers(path, number, text, dimensions):
    try:
        vector = np.array(text.split(), np.float32)
    except ValueError as error:
        raise CospeechError(f"{path}: line {number}: expected numbers after the word; is it UTF-8 text?") from error
    if len(vector) != dimensions or not np.isfinite(vector).all():
        raise CospeechError(f"{path}: line {number}: not {dimensions} finite numbers; is the file damaged?")
    return vector


def _check_dimensions(path, found, dimensions):
    if found != dimensions:
        raise CospeechError(f"{path}: vectors of {found} dimensions, the networks are made for {dimensions}")


class _Binary:
    """The header, dictionary and input matrix of a fastText .bin (version 12, as fastText writes since 2017)."""

    def __init__(self, path, data):
        self.path, self.data, self.at = path, data, 0
        _, version = self.take("ii")
        if version not in (11, 12):
            raise CospeechError(f"{path}: fastText binary version {version}, expected 11 or 12; save it as .vec")
        arguments = self.take("12id")
        self.dimensions, self.bucket, self.shortest, self.longest = (arguments[i] for i in (0, 8, 9, 10))
        size, _, labels, _, pruned = self.take("iiiqq")
        if labels or pruned >= 0:
            raise CospeechError(f"{path}: a fastText classifier or a pruned model; word vectors are expected")
        self.rows = {}
        for row in range(size):
            if (end := data.find(b"\0", self.at)) < 0:
                raise ValueError("the dictionary has no end")
            self.rows[data[self.at : end]] = row
            self.at = end + 1 + 9  # behind the count (8 bytes) and the kind (1 byte)
        (quantized,) = self.take("?")
        if quantized:
            raise CospeechError(f"{path}: quantized fastText vectors (.ftz); use the .bin or .vec file")
        count, width = self.take("qq")
        self.matrix = np.frombuffer(data, "<f4", count * width, self.at).reshape(count, width)

    def take(self, layout):
        """Numbers at the current place."""
        values = struct.unpack_from("<" + layout, self.data, self.at)
        self.at += struct.calcsize("<" + layout)
        return values

    def vector(self, word):
        """The mean of the word's row, if it has one, and of those of its parts (Bojanowski et al. 2017)."""
        rows = [self.rows[word.encode()]] if word.encode() in self.rows else []
        rows += [len(self.rows) + fnv(part) % self.bucket for part in parts(word, self.shortest, self.longest)]
        return self.matrix[rows].mean(axis=0) if rows else None


def parts(word, shortest, longest):
    """The character n-grams of <word>, as bytes; single characters of its ends are none."""
    text, found = f"<{word}>", []
    for start in range(len(text)):
        for stop in range(start + max(shortest, 1), min(start + longest, len(text)) + 1):
            if stop - start > 1 or 0 < start < len(text) - 1:
                found.append(text[start:stop].encode())
    return found


def fnv(text):
    """fastText's FNV-1a hash of bytes, which it takes as signed."""
    value = 2166136261
    for byte in text:
        value ^= byte | (0xFFFFFF00 if byte > 127 else 0)
        value = value * 16777619 & 0xFFFFFFFF
    return value


def _read_binary(path, wanted, dimensions):
    with open(path, "rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)  # let go with the matrix that lies in it
    try:
        model = _Binary(path, data)
        _check_dimensions(path, model.dimensions, dimensions)
        vectors = {word: model.vector(word) for word in wanted}
    except (struct.error, ValueError, IndexError) as error:
        raise CospeechError(f"{path}: the fastText file is truncated or damaged") from error
    return {word: vector for word, vector in vectors.items() if vector is not None}
