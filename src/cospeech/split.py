"""Train, validation and test parts of a subject's clips: disjoint in time, and in take where there are takes enough."""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.files import put, reading_hdf5, writing_hdf5

SCHEMA = "cospeech.split"
PARTS = ("train", "val", "test")


@dataclass
class Split:
    """{part: [(clip id, first frame, frame after the last), ...]}; no range reaches into another part's."""

    ranges: dict

    def of(self, part):
        """The ranges of `train`, `val` or `test`."""
        return self.ranges[part]

    def write(self, path):
        with writing_hdf5(path, SCHEMA) as file:
            for part in PARTS:
                group = file.create_group(part)
                group.create_dataset("clip", data=[r[0] for r in self.ranges[part]], dtype="S128")
                put(group, "start", np.array([r[1] for r in self.ranges[part]], np.int64))
                put(group, "stop", np.array([r[2] for r in self.ranges[part]], np.int64))

    @classmethod
    def read(cls, path):
        with reading_hdf5(path, SCHEMA) as file:
            columns = {part: [file[part][name][()] for name in ("clip", "start", "stop")] for part in PARTS}
        rows = {part: list(zip(*columns[part], strict=True)) for part in PARTS}
        return cls({p: [(clip.decode(), int(a), int(b)) for clip, a, b in rows[p]] for p in PARTS})


def split_clips(clips, parts, shares, by="take", seed=0):
    """Assign clips to parts.

    Parameters
    ----------
    clips : {clip id: number of frames}.
    parts : {clip id: "train", "val", "test" or None}; a named part is kept and, but for train, has what it needs: the
        rest is shared out among the others.
    shares : {"train": 0.8, "val": 0.1, "test": 0.1}, wanted shares of the frames.
    by : "take" gives whole clips to parts (in a seeded order); "time" cuts every clip into three stretches. With
        fewer clips than parts to fill, "take" falls back to "time" with a notice.

    Raises CospeechError when train or test end up without a frame.
    """
    ranges = {part: [(c, 0, n) for c, n in clips.items() if parts.get(c) == part] for part in PARTS}
    free = {clip: frames for clip, frames in clips.items() if not parts.get(clip)}
    wanted = [part for part in PARTS if shares.get(part, 0) > 0 and not ranges[part]]
    if free and by == "take" and len(free) < len(wanted):
        notice(f"split: {len(free)} take(s) for {len(wanted)} parts, so takes are cut in time instead of kept whole")
        by = "time"
    assign = _by_take if by == "take" else _by_time
    left = {part: share for part, share in shares.items() if part in wanted or part == "train"}
    for part, found in assign(free, left, seed).items():
        ranges[part] += found
    for part in ("train", "test"):
        if not ranges[part]:
            raise CospeechError(
                f"split: part '{part}' is empty; give more takes, larger shares or 'part:' in the takes"
            )
    return Split({part: sorted(ranges[part]) for part in PARTS})


def _by_take(clips, shares, seed):
    """Whole clips: test (at least one) and val get clips until nearest to their share, train the rest."""
    order = list(np.random.default_rng(seed).permutation(sorted(clips)))
    total, ranges = sum(clips.values()), {part: [] for part in PARTS}
    for part in ("test", "val"):
        target, got = shares.get(part, 0) * total, 0
        while len(order) > 1 and target and ((part == "test" and not got) or got + clips[order[-1]] / 2 <= target):
            clip = str(order.pop())
            ranges[part].append((clip, 0, clips[clip]))
            got += clips[clip]
    ranges["train"] = [(str(clip), 0, clips[clip]) for clip in order]
    return ranges


def _by_time(clips, shares, seed):
    """Every clip from its start: the train share, then val, then test."""
    del seed
    ranges = {part: [] for part in PARTS}
    cuts = np.cumsum([0.0] + [shares.get(part, 0) for part in PARTS])
    for clip, frames in sorted(clips.items()):
        edges = np.rint(cuts / cuts[-1] * frames).astype(int)
        for part, start, stop in zip(PARTS, edges, edges[1:], strict=False):
            if stop > start:
                ranges[part].append((clip, int(start), int(stop)))
    return ranges
