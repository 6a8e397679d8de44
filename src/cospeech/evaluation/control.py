"""Is a control kept, and what does the resynchroniser make of it? Thesis Table 5.3, for any speaker.

Every control of the table is put on the whole of every test clip. What is kept are the control signals frame by frame;
tables and figures are made from them.
"""

from dataclasses import dataclass, fields

import numpy as np

from cospeech.errors import CospeechError
from cospeech.evaluation.generated import generate_clips
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.formats.result_table import mean_and_deviation, write_table
from cospeech.matching.control.controls import Wanted
from cospeech.matching.control.signals import SIGNALS

SCHEMA = "cospeech.control"
BEFORE = "knn"  # whose motion the refined ones start from
REFINED = ("resync",)
FREE = "unconstrained"
TABLE = (
    ("left_wrist_height", "high"),
    ("left_wrist_height", "low"),
    ("left_wrist_speed", "fast"),
    ("left_wrist_speed", "slow"),
    ("symmetry", "asymmetric"),
    ("symmetry", "symmetric"),
)


@dataclass
class ControlStudy:
    """The control signals of one subject's test clips (schema `cospeech.control`, version 1).

    thresholds : {(signal, level): value in the signal's unit}. valid : {clip: (T,) bool}, frames that count.
    series : {(clip, model, signal, level): (T,) float32}; level `FREE` is the same signal without any control.
    """

    subject: str
    fps: float
    thresholds: dict
    valid: dict
    series: dict

    @property
    def models(self):
        """Names of the models, in order."""
        return list(dict.fromkeys(model for _, model, _, _ in self.series))

    def values(self, model, signal, level):
        """The signal over the frames of all clips that count, (N,)."""
        return np.concatenate([self.series[clip, model, signal, level][v] for clip, v in self.valid.items()])

    def write(self, path):
        """Write results/<subject>/evaluation/control.h5."""
        with writing_hdf5(path, SCHEMA, subject=self.subject, fps=self.fps) as file:
            for (signal, level), threshold in self.thresholds.items():
                file.create_dataset(f"threshold/{signal}/{level}", data=threshold, track_times=False)
            for clip, valid in self.valid.items():
                put(file, f"clip/{clip}/valid", valid)
            for (clip, *key), values in self.series.items():
                put(file, "/".join(["clip", clip, "signal", *key]), values)

    @classmethod
    def read(cls, path):
        """Read what `write` wrote; clips in the order of their names."""
        with reading_hdf5(path, SCHEMA) as file:
            levels = {(s, v): float(d[()]) for s, group in file["threshold"].items() for v, d in group.items()}
            thresholds = {key: levels[key] for key in TABLE if key in levels}
            valid = {clip: group["valid"][()] for clip, group in file["clip"].items()}
            series = {
                (clip, model, signal, level): values[()]
                for clip, group in file["clip"].items()
                for model, signals in group["signal"].items()
                for signal, levels in signals.items()
                for level, values in levels.items()
            }
            return cls(file.attrs["subject"], float(file.attrs["fps"]), thresholds, valid, series)


def study_controls(subject, generators, clips, seed=0):
    """Generate every control of `TABLE`, and no control, for every test clip: -> ControlStudy.

    Parameters
    ----------
    generators : {model: generator, or {signal: generator} for MoGlow, which has a network for each}; `knn` must be
        there.
    clips : {clip id: Clip}, the test part. seed : of the generators.

    Every motion is finished as `synthesize` does.
    """
    signals = generators[BEFORE].signals
    thresholds = {(s, level): Wanted.of(s, level).alternatives[0][0].threshold(signals) for s, level in TABLE}
    series, clips = {}, {name: clip for name, clip in sorted(clips.items()) if clip.valid.any()}
    for model, generator in generators.items():
        of_signal = generator if isinstance(generator, dict) else dict.fromkeys(SIGNALS, generator)
        free = {one: generate_clips(one, clips, model, seed, controls=[]) for one in set(of_signal.values())}
        for signal, level in TABLE:
            one = of_signal[signal]
            kept = generate_clips(one, clips, model, seed, controls=[f"{signal}={level}"])
            for key, made in ((FREE, free[one]), (level, kept)):
                for name, clip in made.items():
                    values = SIGNALS[signal](clip.positions, clip.fps).astype(np.float32)
                    series[name, model, signal, key] = values
    series = {key: values for name in clips for key, values in series.items() if key[0] == name}
    valid = {name: clip.valid for name, clip in clips.items()}
    if not valid:
        raise CospeechError(f"{subject}: no test clip has a valid frame; change 'split:'")
    return ControlStudy(subject, next(iter(clips.values())).fps, thresholds, valid, series)


@dataclass(frozen=True)
class ControlRow:
    """A line of Table 5.3, in the signal's unit, over all frames of all test clips; deviations are the sample's.

    kept : share of frames that keep the bound. change : mean |difference| from the k-NN motion under the same control,
    NaN for what does not refine it. free_* : the same without control (MoGlow: with the median for a target).
    """

    subject: str
    signal: str
    level: str
    unit: str
    model: str
    threshold: float
    mean: float
    deviation: float
    kept: float
    change: float
    free_mean: float
    free_deviation: float
    free_kept: float
    frames: int
    clips: int


def control_rows(study):
    """The lines of Table 5.3 for one subject, k-NN before the resynchroniser: list of ControlRow."""
    models = sorted(study.models, key=lambda model: model != BEFORE)
    return [_row(study, *key, model) for key in study.thresholds for model in models]


def _row(study, signal, level, model):
    threshold, upper = study.thresholds[signal, level], SIGNALS[signal].levels[level]
    values, free = (study.values(model, signal, key).astype(np.float64) for key in (level, FREE))
    kept = lambda x: float(np.mean(x >= threshold if upper else x <= threshold))
    change = np.nan
    if model in REFINED:
        change = float(np.abs(values - study.values(BEFORE, signal, level)).mean())
    told, untold = (map(float, mean_and_deviation(x)) for x in (values, free))
    return ControlRow(
        study.subject,
        signal,
        level,
        SIGNALS[signal].unit,
        model,
        threshold,
        *told,
        kept(values),
        change,
        *untold,
        kept(free),
        len(values),
        len(study.valid),
    )


def write_csv(path, rows):
    """results/tables/table_5_3.csv: one line a subject, control and model, "n/a" where a number does not apply."""
    names = [field.name for field in fields(ControlRow)]
    write_table(path, names, ([getattr(row, name) for name in names] for row in rows))


def write_hdf5(path, rows):
    """results/tables/table_5_3.h5: the same as arrays, one a column (schema `cospeech.control_table`, version 1)."""
    with writing_hdf5(path, "cospeech.control_table") as file:
        for field in fields(ControlRow):
            column = [getattr(row, field.name) for row in rows]
            put(file, field.name, [text.encode() for text in column] if field.type is str else column)
